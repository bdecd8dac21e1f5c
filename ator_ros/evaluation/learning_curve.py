"""Refinement gain of observed models against training episodes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.evaluation.again import same_records
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.gate_from_episodes import gate_of_episodes
from ator_ros.evaluation.policies import OBSERVED as OBSERVED_MODELS
from ator_ros.evaluation.policies import reopened
from ator_ros.evaluation.situation import Executions, Record, Settings, evaluate_trial
from ator_ros.evaluation.statistics import RESAMPLES
from ator_ros.evaluation.storage import RESULT, PartialResults, read_result
from ator_ros.evaluation.toolset import ToolsetSource, read_rows, tools_of
from ator_ros.evaluation.trials import open_speeds, random_trial
from ator_ros.geometry import FloatArray
from ator_ros.performance.model_file import load_models, model_path, save_model
from ator_ros.performance.training import OBSERVED, digest, observed_model
from ator_ros.refinement.gate import load_gate, save_gate
from ator_ros.refinement.refiner import Refiner

KINDS = {"heading": "oracle", "heading and speed": "oracle_speed"}
"""What is refined, and which oracle limits it."""
_DESCRIBED = {"heading": "gated", "heading and speed": "gated_speed"}
_SLOWER = 1.02
_GATE_SEED, _GATE_SITUATIONS = 302, 100  # of what gates are learned from


@dataclass(frozen=True)
class CurveSettings:
    """Everything that a curve depends on, but the files that `source` names.

    Attributes
    ----------
    table : str
        Table of experience.
    seed : int
        Of the situations.
    sizes : tuple of int
        Episodes of each action that are drawn from the table.
    draws : int
        Draws of each size; draw k of a smaller size is part of draw k of a greater one.
    headings : int
        Of the first subgoal that the oracle executes.
    speeds : tuple of float
        Arrival speeds in m/s that it executes with each heading, beside rest.
    margin : float or None
        See `Settings.oracle_margin`; predicted by the described models.
    source : ToolsetSource
        Robot, actions, and folder of the described models, with the observed ones and their gate in it.
    executed : str
        Folder of a finished evaluation of the same seed and described models, whose naive, described and
        oracle runs are taken; empty: they are executed.
    """

    table: str
    seed: int
    sizes: tuple[int, ...] = (50, 100, 200, 300, 400, 1000)
    draws: int = 3
    headings: int = 24
    speeds: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8)
    margin: float | None = 1.0
    source: ToolsetSource = field(default_factory=ToolsetSource)
    executed: str = ""

    @property
    def oracle(self) -> Settings:
        """Return the evaluation that executes naive and described chains, and the oracle that all share."""
        return Settings(
            self.seed,
            policies=("naive", *_DESCRIBED.values()),
            oracle=self.headings,
            oracle_margin=self.margin,
            oracle_speeds=self.speeds,
            source=self.source,
        )


class LearningCurve:
    """Learns models from parts of a table, and lets them choose in the same situations.

    Parameters
    ----------
    settings : CurveSettings
        What is learned and evaluated.
    folder : Path
        For models and results; existing ones are reused.

    Raises
    ------
    EvaluationError
        The folder holds results of other settings.
    ExperienceError, TrainingError, ModelFileError
        The table cannot be used, or too few of its episodes succeeded.
    """

    def __init__(self, settings: CurveSettings, folder: Path) -> None:
        self.settings, self._folder = settings, folder
        self._rows = read_rows([settings.table])
        self._tools, self._library = tools_of(settings.source)
        of_files = settings.source.digest((*settings.oracle.policies, OBSERVED_MODELS), settings.oracle.chain)
        tables = "".join(digest(rows) for rows in self._rows.values())
        table, executed = Path(settings.table).name, Path(settings.executed).name
        portable = dataclasses.replace(settings, table=table, executed=executed)
        self.results = PartialResults(folder, portable, of_files + tables)

    @property
    def draws(self) -> list[tuple[int, int]]:
        """Size and number of each draw; all episodes of the table can be drawn but once."""
        most = min(rows["episode"].nunique() for rows in self._rows.values())
        pairs = [
            (min(size, most), draw) for size in self.settings.sizes for draw in range(self.settings.draws)
        ]
        return list(dict.fromkeys((size, 0 if size == most else draw) for size, draw in pairs))

    def learn(self) -> Iterator[tuple[int, int]]:
        """Learn the models of each draw that are not there yet; yield it."""
        for size, draw in self.draws:
            place = self._place(size, draw)
            if not (place / "done").exists():
                parts = {action: drawn(rows, size, draw) for action, rows in self._rows.items()}
                for action, rows in parts.items():
                    self._learn(place, action, rows)
                self._learn_gate(place, parts)
                (place / "done").touch()
            yield size, draw

    def _learn(self, place: Path, action: str, rows: pd.DataFrame) -> None:
        source, tools = self.settings.source, self._tools
        features = (*OBSERVED, *tools.domain.goal_features(action, source.action_set))
        model = observed_model(action, rows, tools.robot, features)
        told = {"command": "learning_curve", "episodes": int(rows["episode"].nunique())}
        told |= model.metadata["training"]
        model = dataclasses.replace(model, metadata={"action_set": source.action_set, "training": told})
        save_model(place / model_path(action, source.action_set), model)

    def _learn_gate(self, place: Path, rows: Mapping[str, pd.DataFrame]) -> None:
        """Learn the gate from the same episodes as the models, as the tool `gate` does with `--episodes`."""
        tools, source, chain = self._tools, self.settings.source, self.settings.oracle.chain
        gate, _ = gate_of_episodes(
            tools.domain, self._library, rows, chain, seed=_GATE_SEED, situations=_GATE_SITUATIONS
        )
        told = {"command": "learning_curve", "seed": _GATE_SEED, "situations": _GATE_SITUATIONS}
        save_gate(place / model_path("gate", source.action_set), gate, told, source.action_set)

    def _place(self, size: int, draw: int) -> Path:
        place = self._folder / "models" / f"{size}-{draw}"
        (place / model_path("any", self.settings.source.action_set)).parent.mkdir(parents=True, exist_ok=True)
        return place

    @cached_property
    def _refiners(self) -> dict[str, Refiner]:
        tools, action_set = self._tools, self.settings.source.action_set
        refiners = {}
        for size, draw in self.learn():
            models = load_models(
                tools.robot,
                tools.domain.known_features,
                action_set=action_set,
                folder=self._place(size, draw),
            )
            gate = load_gate(self._place(size, draw) / model_path("gate", action_set), action_set)
            ranges, cost = tools.domain.ranges, tools.domain.time_limit
            refiners[f"{size}/{draw}"] = Refiner(tools.robot, models, gate, ranges=ranges, failure_cost=cost)
        return refiners

    def play(self, situations: int) -> Iterator[list[Record]]:
        """Evaluate situations 0 to `situations` - 1; yield all records so far after each new one."""
        yield self._records(situations)
        for index in range(situations):
            if index not in self.results.records:
                self.results.append(self._evaluated(index))
                yield self._records(situations)

    def _records(self, situations: int) -> list[Record]:
        return [self.results.records[index] for index in range(situations) if index in self.results.records]

    @cached_property
    def _executed(self) -> list[Record]:
        """The records of the evaluation that `CurveSettings.executed` names."""
        result = read_result(Path(self.settings.executed) / RESULT)
        lacking = set(self.settings.oracle.policies) - set(result["runs"].get("policies", ()))
        if lacking:
            raise EvaluationError(f"{self.settings.executed}: expected runs of {', '.join(sorted(lacking))}")
        try:
            return same_records(result, self.settings.oracle, but=("policies",))
        except EvaluationError as error:
            raise EvaluationError(f"{self.settings.executed}: {error}") from error

    def _told(self, index: int) -> Record:
        """Return the naive, described and oracle runs of a situation."""
        if not self.settings.executed:
            return evaluate_trial((self.settings.oracle, index))
        count = len(self._executed)
        if index >= count:
            raise EvaluationError(
                f"{self.settings.executed}: expected more than {index} situations, got {count}"
            )
        return self._executed[index]

    def _evaluated(self, index: int) -> Record:
        """Return durations (s) of naive, described and observed chains, by kind, and of the oracles."""
        told = self._told(index)
        tools = self._tools
        trial = random_trial(
            tools.domain, self.settings.oracle.chain, self._library, seed=self.settings.seed, index=index
        )
        execute = Executions(tools, self._library, trial)
        start = tools.refiner().naive(trial.world, open_speeds(trial.chain))
        plans = {"heading": trial.chain, "heading and speed": open_speeds(trial.chain)}
        runs: dict[str, dict[str, list[Any]]] = {}
        for kind, plan in plans.items():
            shipped = told["policies"][_DESCRIBED[kind]]
            runs[kind] = {"described": [shipped["duration"], shipped["success"]]}
            for name, refiner in self._refiners.items():
                run = execute(refiner.refine(trial.world, reopened(start, plan)).chain)
                runs[kind][name] = [round(run.duration, 3), run.success]
        # What any of them chose counts as tried, and what goes without speeds goes with them.
        best = {kind: min([told[name]["best"], *(run[0] for run in runs[kind].values())])
                for kind, name in KINDS.items()}  # fmt: skip
        best["heading and speed"] = min(best.values())
        return {"index": index, "naive": told["policies"]["naive"]["duration"], "best": best, "runs": runs}


def drawn(rows: pd.DataFrame, size: int, draw: int) -> pd.DataFrame:
    """Return the rows of `size` episodes; those of a smaller size are among those of a greater one."""
    episodes = np.sort(rows["episode"].unique())
    if size >= len(episodes):
        return rows
    chosen = np.random.default_rng(draw).permutation(episodes)[:size]
    return rows[rows["episode"].isin(chosen)]


def points(records: Sequence[Record]) -> dict[str, dict[str, dict[str, Any]]]:
    """Return by kind and size ("described", too) what the models are worth.

    Returns
    -------
    dict
        "percent" of the oracle's gain over naive, the mean over draws, with "ci95" over situations; "draws":
        that of each draw; "slower": share in % of the runs more than 2 % slower than naive; "failed": runs.
    """
    naive = np.array([record["naive"] for record in records])
    told: dict[str, dict[str, dict[str, Any]]] = {}
    for kind in KINDS:
        best = np.array([record["best"][kind] for record in records])
        names: dict[str, list[str]] = {}
        for name in records[0]["runs"][kind]:
            names.setdefault(name.partition("/")[0], []).append(name)
        told[kind] = {size: _point(records, kind, of_size, naive, best) for size, of_size in names.items()}
    return told


def _point(
    records: Sequence[Record], kind: str, names: Sequence[str], naive: FloatArray, best: FloatArray
) -> dict[str, Any]:
    runs = np.array([[record["runs"][kind][name][0] for name in names] for record in records])
    failed = sum(not record["runs"][kind][name][1] for record in records for name in names)
    gains, limit = naive[:, None] - runs, naive - best
    picked = np.random.default_rng(0).integers(0, len(records), (RESAMPLES, len(records)))
    shares = _share(gains.mean(axis=1)[picked].sum(axis=1), limit[picked].sum(axis=1))
    return {
        "percent": float(_share(gains.mean(axis=1).sum(), limit.sum())),
        "ci95": [float(value) for value in np.quantile(shares, (0.025, 0.975))],
        "draws": [float(_share(column.sum(), limit.sum())) for column in gains.T],
        "slower": 100.0 * float(np.mean(runs > _SLOWER * naive[:, None])),
        "failed": int(failed),
    }


def _share(gain: Any, limit: Any) -> Any:
    """Return gains in % of what could be gained; 0 where nothing could."""
    return 100.0 * np.where(limit > 0.0, gain / np.where(limit > 0.0, limit, 1.0), 0.0)
