"""A stream of chains on a robot that has changed: what learning while playing is worth."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.situation import Situation
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.evaluation.chain_run import ChainKey, ChainRun, key_of, run_chain
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.policies import Models, reopened
from ator_ros.evaluation.toolset import ToolsetSource, make_library
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial, with_headings
from ator_ros.execution.phases import Ending
from ator_ros.execution.rolling import Remembered, Rolling
from ator_ros.execution.step_run import ActionRecord
from ator_ros.experience.episode import Episode, sample_width
from ator_ros.experience.store import RecordStore, StoreInfo
from ator_ros.geometry import wrap_angle
from ator_ros.learning.changed import CHANGES
from ator_ros.learning.exploring import Explorer
from ator_ros.learning.offline import DONE, learn_offline
from ator_ros.learning.round import CAUTION, Source, learn
from ator_ros.learning.sets import RECORDS, current_set, publish
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.gate import gate_in
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary

POLICIES = ("naive", "shipped", "learning", "offline")
ORACLE = "oracle"
_FETCHES = 2  # a lost object costs time, not the chain
_TIME = "2026-01-01T00:00:00Z"  # of sets: nothing here may depend on a clock


@dataclass(frozen=True)
class StreamSettings:
    """Everything that a stream depends on.

    Attributes
    ----------
    change : str
        Name of one of `CHANGES`.
    seed : int
        Of the situations, the offline episodes and the exploration.
    chain : str
        Name of one of the domain's chains.
    offline : int
        Episodes of each action, on the changed robot, that the offline models are learned from.
    batch : int
        Records after which the learner learns again.
    explore : float
        See `Explorer`.
    speeds : bool
        Whether arrival speeds are refined, too.
    oracle : int
        Headings of the first subgoal that the oracle executes; 0: no oracle.
    source : ToolsetSource
        Robot as described, action set, shipped models.
    """

    change: str
    seed: int
    chain: str
    offline: int = 300
    batch: int = 20
    explore: float = 0.0
    speeds: bool = False
    oracle: int = 0
    source: ToolsetSource = dataclasses.field(default_factory=ToolsetSource)


class _Played(NamedTuple):
    """A chain that was executed: how it went, the records of its actions, and what was seen to roll."""

    run: ChainRun
    records: list[ActionRecord]
    rolling: Rolling


class Stream:
    """Plays chain after chain; what was learned lies in `folder`.

    Parameters
    ----------
    settings : StreamSettings
        What is played.
    folder : Path
        For the store of records, the learned sets and the offline models; existing results are resumed.
    before : mapping, optional
        The result of the chain before.
    """

    def __init__(
        self, settings: StreamSettings, folder: Path, before: Mapping[str, Any] | None = None
    ) -> None:
        self._settings, self._folder = settings, folder
        source = settings.source
        self._domain: Domain = find_domain(source.domain)
        self._described: Robot = source.described()
        self._library: TopLibrary = make_library(self._described, source)
        self._changed = CHANGES[settings.change]
        self._actual = self._changed.robot(self._described)
        self._explorer = Explorer(settings.explore, settings.seed)
        self._rolled: Remembered = (before or {}).get("rolling", {})
        try:
            Rolling(self._described, self._rolled)
        except (ValueError, AttributeError) as error:
            raise EvaluationError(f"{folder}: rolling of the last chain: {error}") from error
        self._shipped_at = Path(source.models) if source.models else self._domain.shipped_models
        self._learner = Source(folder, self._domain, self._described, self._shipped_at)
        info = StoreInfo(self._described.digest(), self._domain.name)
        self._store = RecordStore(folder / RECORDS, info, most=100_000)
        self._asked = self._records
        self._shipped = self._models(self._shipped_at)
        offline = folder / "offline"
        if not (offline / DONE).exists():
            self._learn_offline(offline)
        self._offline = self._models(offline)
        self._learned = self._models(current_set(folder) or self._shipped_at)

    @property
    def _records(self) -> int:
        return sum(self._store.ends.values())

    def play(self, index: int) -> dict[str, Any]:
        """Play chain `index`, with every policy from the same start, and learn from what `learning` did.

        Returns
        -------
        dict
            "index"; "durations": by policy in s, `TIME_LIMIT` where it failed; "failed": the policies that
            did; "set": name of the learned set in use; "records": number of records after it; "explored":
            share of the predicted time that was spent on trying, so far; "rolling": what the learning robot
            has seen of how objects roll.
        """
        settings = self._settings
        trial = random_trial(self._domain, settings.chain, self._library, seed=settings.seed, index=index)
        naive = self._shipped.naive(trial.world, open_speeds(trial.chain))
        runs: dict[ChainKey, _Played] = {}
        execute = partial(self._executed, runs, trial)
        chains = {
            "naive": naive,
            "shipped": self._refined(self._shipped, trial, naive),
            "learning": self._refined(self._learned, trial, naive, explore=True),
            "offline": self._refined(self._offline, trial, naive),
        }
        played = {name: execute(chain).run for name, chain in chains.items()}
        if settings.oracle:
            played[ORACLE] = self._oracle(trial, naive, execute, played)
        used = current_set(self._folder)
        learning = execute(chains["learning"])
        self._rolled = learning.rolling.remembered()
        for record in learning.records:
            if record.ending in (Ending.SUCCEEDED, Ending.FAILED):  # not broken off
                self._store.append(settings.source.action_set, _episode_of(record))
        if self._records - self._asked >= settings.batch:
            self._asked = self._records
            self._learn()
        told = self._explorer
        return {
            "index": index,
            "durations": {name: round(run.duration, 3) for name, run in played.items()},
            "failed": [name for name, run in played.items() if not run.success],
            "set": used.name if used is not None else "",
            "records": self._records,
            "explored": round(told.spent / told.played, 5) if told.played else 0.0,
            "rolling": self._rolled,
        }

    def _refined(self, refiner: Refiner, trial: Trial, naive: TopChain, *, explore: bool = False) -> TopChain:
        plan = open_speeds(trial.chain) if self._settings.speeds else trial.chain
        found = refiner.refine(trial.world, reopened(naive, plan))
        if explore and self._settings.explore > 0.0:
            models, robot = refiner.models, self._described
            found = self._explorer.explored(found, lambda c: predict_chain(trial.world, c, models, robot))
        return found.chain

    def _executed(
        self,
        runs: dict[ChainKey, _Played],
        trial: Trial,
        chain: TopChain,
    ) -> _Played:
        """Execute a chain on the robot as it is, each distinct one once, with what it has seen so far."""
        key = key_of(chain)
        if key not in runs:
            records: list[ActionRecord] = []
            rolling = Rolling(self._described, self._rolled)
            run = run_chain(
                self._actual,
                self._library,
                trial.world,
                chain,
                fetches=_FETCHES,
                wheels=self._changed.wheels,
                records=records,
                rolling=rolling,
            )
            runs[key] = _Played(run, records, rolling)
        return runs[key]

    def _oracle(
        self,
        trial: Trial,
        naive: TopChain,
        execute: Callable[[TopChain], _Played],
        played: dict[str, ChainRun],
    ) -> ChainRun:
        """Return the fastest of evenly spaced headings of the first subgoal, and of what was played."""
        count = self._settings.oracle
        start = naive.calls[0].goal.pose.yaw
        headings = [wrap_angle(start + 2.0 * math.pi * k / count) for k in range(count)]
        speed = self._refined(self._offline, trial, naive).calls[0].goal.speed
        runs = list(played.values())
        for yaw in headings:
            chain = with_headings(naive, {0: yaw})
            for v in {0.0, speed}:
                goal = dataclasses.replace(chain.calls[0].goal, speed=v)
                runs.append(execute(chain.with_goal(0, goal)).run)
        return min(runs, key=lambda run: run.duration)

    def _learn(self) -> None:
        told = learn(self._learner, time=_TIME)
        if told["made"]:
            publish(self._folder, Path(told["made"]))
            self._learned = self._models(current_set(self._folder) or self._shipped_at)

    def _models(self, folder: Path) -> Refiner:
        source = self._settings.source
        models: Models = load_models(
            self._described, self._domain.known_features, action_set=source.action_set, folder=folder
        )
        place = dataclasses.replace(source, models=str(folder)).folder()
        gate = gate_in(place, source.action_set, otherwise=CAUTION)
        return Refiner(
            self._described,
            models,
            gate,
            ranges=self._domain.ranges,
            failure_cost=self._domain.time_limit,
        )

    def _learn_offline(self, folder: Path) -> None:
        """Learn models of the chain's actions from the changed robot; the gate is the shipped one."""
        settings = self._settings
        trial = random_trial(self._domain, settings.chain, self._library, seed=settings.seed, index=0)
        learn_offline(
            folder,
            self._learner,
            self._changed,
            dict.fromkeys(call.top.action for call in trial.chain.calls),
            action_set=settings.source.action_set,
            count=settings.offline,
            seed=settings.seed,
            gate=dataclasses.replace(settings.source, models=str(self._shipped_at)).folder(),
        )


def _episode_of(record: ActionRecord) -> Episode:
    """Return what a record of an action in a chain tells."""
    start = record.start
    return Episode(
        Situation(record.action, start.robot, start.objects, record.goal),
        np.empty((0, sample_width(start.objects))),
        record.duration,
        record.ending is Ending.SUCCEEDED,
        record.reason,
        record.position_error,
        record.heading_error,
        tuple(start.objects),
    )
