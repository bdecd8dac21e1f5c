"""Record decisions of the package, to show that a change of structure changes none of them.

    scripts/run python scripts/golden.py write FOLDER           # every part, one file each
    scripts/run python scripts/golden.py write FOLDER refined   # parts that begin with "refined"
    scripts/run python scripts/golden.py compare OLD NEW        # two folders, bit by bit

Numbers are written in full, so that two commits on one machine can be compared bit by bit. Other
processors round differently: test/golden/test_golden.py compares files written with ``--digits 8``
to 1e-6.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import math
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.actions.goal_variables import goal_values
from ator_ros.domains.domain import find_domain
from ator_ros.domains.trials import (
    Trial,
    open_places,
    open_speeds,
    random_trial,
    reopened,
    with_headings,
)
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES, naive
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.experience.simulated import collect
from ator_ros.experience.table import join
from ator_ros.files import write_text
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.training import direct_of, train
from ator_ros.planning.goals import GoalStatement, PlanningError, statement_from
from ator_ros.planning.planner import chains_for
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import Command, ObjectState, RobotState, World

Json = dict[str, Any]
Opening = Callable[[TopChain], TopChain] | None
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


DEFAULT = ToolsetSource()
REFINED: dict[str, tuple[ToolsetSource, str, Opening]] = {
    "default_heading": (DEFAULT, "dribble", None),
    "default_speed": (DEFAULT, "dribble", open_speeds),
    "default_shot": (DEFAULT, "shoot", open_speeds),
    "default_place": (DEFAULT, "shoot", open_places),
    "bezier_heading": (ToolsetSource(action_set="bezier"), "dribble", None),
    "drive_speed": (ToolsetSource(domain="drive"), "", open_speeds),
    "tour_heading": (ToolsetSource(domain="tour"), "", None),
}  # fmt: skip
"""By name: source of robot and models, the chain, and what is opened."""
TEST = Path(__file__).parent.parent / "test"
EXECUTED: dict[str, tuple[ToolsetSource, str, str]] = {
    "dribble": (ToolsetSource(), "dribble", "gated_speed"),
    "shoot": (ToolsetSource(), "shoot", "gated_speed"),
    "rolling_ball": (ToolsetSource(), "rolling", "refined_along"),
    "bezier": (ToolsetSource(action_set="bezier"), "dribble", "gated"),
    "second_robot": (ToolsetSource(robot=str(TEST / "fifth.yaml")), "dribble", "bearing"),
    "drive": (ToolsetSource(domain="drive"), "", "gated"),
    "remote": (ToolsetSource(domain="tour"), "", "gated"),
    "mixed": (ToolsetSource(domain=str(TEST / "mixed.yaml")), "rounds", "bearing"),
}
"""By name: the source, the chain, and the policy that sets the subgoals."""


def _goals(chain: TopChain) -> list[Json]:
    return [{"top": call.top.name, **goal_values(call.goal)} for call in chain.calls]


def _predicted(prediction: ChainPrediction) -> Json:
    return {"cost": prediction.cost, "steps": [dict(step) for step in prediction.actions]}


def _trials(
    source: ToolsetSource,
    chain: str,
    seed: int,
    count: int,
) -> Iterator[Trial]:
    domain = find_domain(source.domain)
    name = chain or next(iter(domain.chains))
    library = domain.library(source.described(), source.action_set)
    for index in range(count):
        yield random_trial(domain, name, library, seed=seed, index=index)


def _curve(totals: FloatArray) -> list[float]:
    return [len(totals), float(np.min(totals)), float(np.sum(totals))]


def refined(name: str, count: int) -> list[Json]:
    """Return the answers of refinement, without deadline, in situations of one of `REFINED`."""
    source, chain, opening = REFINED[name]
    tools, _ = tools_of(source)
    refiner = tools.refiner(gated=True)
    found = []
    for trial in _trials(source, chain, 4001, count):
        start = naive(tools, trial).chain
        plan = trial.chain if opening is None else opening(trial.chain)
        answer = refiner.refine(trial.world, reopened(start, (call.open for call in plan.calls)))
        found.append(
            {
                "naive": _goals(start),
                "free": [[free.subgoal, free.name] for free in answer.free],
                "refined": answer.refined,
                "reason": answer.reason,
                "best": _goals(answer.best),
                "before": _predicted(answer.before),
                "after": _predicted(answer.after),
                "curves": [_curve(curve.totals) for curve in answer.curves],
            }
        )
    return found


@contextmanager
def _commands() -> Iterator[list[Command]]:
    """Collect the commands of all simulations during the block."""
    sent: list[Command] = []
    original = Simulation.command

    def command(self: Simulation, command: Command) -> None:
        sent.append(command)
        original(self, command)

    Simulation.command = command  # type: ignore[method-assign, assignment]
    try:
        yield sent
    finally:
        Simulation.command = original  # type: ignore[method-assign]


def _bearings(trial: Trial) -> TopChain:
    """Return the chain with the bearing from the preceding position as heading of each subgoal."""
    places = [trial.world.robot.pose]
    places += [call.goal.pose for call in trial.chain.calls[:-1]]
    headings = {}
    for index, (here, to) in enumerate(itertools.pairwise(places)):
        headings[index] = math.atan2(to.y - here.y, to.x - here.x)
    return with_headings(trial.chain, headings)


def executed(name: str, count: int) -> list[Json]:
    """Return durations, outcomes and commands of `count` executed chains of one of `EXECUTED`."""
    source, chain, policy = EXECUTED[name]
    domain = find_domain(source.domain)
    robot = source.described()
    library = domain.library(robot, source.action_set)
    found = []
    for trial in _trials(source, chain, 4002, count):
        executor: Any = None
        if policy == "bearing":
            set_chain = _bearings(trial)
        elif policy == "refined_along":
            sys.path.append(str(TEST))
            from refined_along import refining_along

            set_chain, executor = refining_along(tools_of(source)[0], library, trial)
        else:
            set_chain = POLICIES[policy](tools_of(source)[0], trial).chain
        with _commands() as sent:
            run = run_chain(
                robot,
                library,
                trial.world,
                set_chain,
                time_limit=domain.time_limit,
                executor=executor,
            )
        table = np.array([(command.vx, command.w) for command in sent])
        found.append(
            {
                "duration": run.duration,
                "success": run.success,
                "actions": list(run.actions),
                "again": 0 if executor is None else executor.again,
                "commands": len(sent),
                "mean_v": float(table[:, 0].mean()),
                "mean_w": float(table[:, 1].mean()),
                "hash": hashlib.sha256(table.tobytes()).hexdigest(),
            }
        )
    return found


GOALS: Sequence[Sequence[str]] = (
    ("ball_in_goal",),
    ("ball_held",),
    ("ball.x=1.0", "ball.y=0.5"),
    ("robot.x=-1.0", "robot.y=1.0"),
    ("robot.x=0.5", "robot.y=-1.0", "robot.yaw=1.0"),
)
"""Goals of plans: names of the domain's goals, or statements."""


def planned(count: int) -> list[Json]:
    """Return the planned chains for `count` goals in soccer."""
    source = ToolsetSource()
    domain = find_domain(source.domain)
    robot = source.described()
    library = domain.library(robot, source.action_set)
    named = domain.goals(robot)
    rng = np.random.default_rng(4003)
    found: list[Json] = []
    for index in range(count):
        words = GOALS[index % len(GOALS)]
        goal: list[GoalStatement]
        if words[0] in named:
            goal = list(named[words[0]].terms)
        else:
            goal = [statement_from(word) for word in words]
        robot_x, robot_y, x, y = rng.uniform(-2.0, 2.0, 4)
        yaw = rng.uniform(-3.0, 3.0)
        pose = Pose(float(robot_x), float(robot_y), float(yaw))
        world = World(
            0.0,
            RobotState(pose),
            {"ball": ObjectState(float(x), float(y))},
        )
        try:
            chains = chains_for(goal, world, library, domain.objects)
        except PlanningError as error:
            found.append({"goal": list(words), "error": str(error)})
        else:
            found.append({"goal": list(words), "chains": [_goals(chain) for chain in chains]})
    return found


def trained(episodes: int) -> list[Json]:
    """Return rules and predictions of models that are learned from a few simulated episodes."""
    domain = find_domain()
    robot = domain.robot()
    specs = domain.actions()
    frames = collect(
        [specs["goToPose"], specs["dribbleBall"]],
        domain.tops_for(robot),
        robot,
        objects=domain.objects,
        episodes=episodes,
        seed=4004,
        time_limit=domain.time_limit,
    )
    rows = join(frames)
    found = []
    for action, own in rows.groupby("action", sort=False):
        starts = own[own["t"] == 0.0]
        model = train(
            str(action),
            own,
            robot,
            features=domain.candidates(str(action)),
        )
        durations = np.asarray(model.predict(direct_of(starts)).duration).tolist()
        found.append({"model": str(action), "rules": model.rules(), "durations": durations})
    return found


PARTS: dict[str, tuple[Callable[[int], list[Json]], int]] = {
    **{
        f"refined_{name}": (partial(refined, name), 10 if "place" in name else 30)
        for name in REFINED
    },
    **{f"executed_{name}": (partial(executed, name), 8) for name in EXECUTED},
    "planned": (planned, 50),
    "trained": (trained, 60),
}
"""By name: a function that returns the given number of entries, and that number."""


def _short(value: Any, digits: int) -> Any:
    if isinstance(value, dict):
        return {name: _short(item, digits) for name, item in value.items()}
    if isinstance(value, list):
        return [_short(item, digits) for item in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


def write(folder: Path, parts: Sequence[str], digits: int) -> int:
    """Write the parts whose names begin with one of `parts`, by default all."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (record, count) in PARTS.items():
        if not parts or name.startswith(tuple(parts)):
            print(f"golden: {name}", flush=True)
            entries = [_short(entry, digits) for entry in record(count)]
            lines = [json.dumps(entry, separators=(",", ":")) for entry in entries]
            write_text(folder / f"{name}.json", "[\n" + ",\n".join(lines) + "\n]\n")
    return 0


def compare(old: Path, new: Path) -> int:
    """Report for each part in both folders whether it differs; return 1 if one does."""
    differing = 0
    for file in sorted(old.glob("*.json")):
        other = new / file.name
        if other.exists():
            same = other.read_bytes() == file.read_bytes()
            print(f"{file.stem}: {'same' if same else 'DIFFERS'}")
            differing += not same
    return int(differing > 0)


def differences(
    expected: Any,
    found: Any,
    place: str = "",
) -> Iterator[str]:
    """Yield where `found` differs from `expected`: in a decision, or in a number by more than 1e-6.

    Hashes and numbers in texts are not compared, because processors round differently.
    """
    if isinstance(expected, dict) and isinstance(found, dict) and expected.keys() == found.keys():
        for name, value in expected.items():
            if name != "hash":
                yield from differences(value, found[name], f"{place}.{name}")
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for index, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from differences(one, other, f"{place}[{index}]")
    elif isinstance(expected, str) and isinstance(found, str):
        if _NUMBER.sub("#", expected) != _NUMBER.sub("#", found):
            yield f"{place}: expected {expected!r}, got {found!r}"
    elif isinstance(expected, float) and isinstance(found, float):
        both_nan = math.isnan(expected) and math.isnan(found)
        if not both_nan and not math.isclose(expected, found, rel_tol=1e-6, abs_tol=1e-6):
            yield f"{place}: expected {expected!r}, got {found!r}"
    elif expected != found:
        yield f"{place}: expected {expected!r}, got {found!r}"


def main() -> int:
    """Write a folder, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write")
    writing.add_argument("folder", type=Path)
    writing.add_argument("parts", nargs="*", default=[], help="beginnings of names of parts")
    writing.add_argument("--digits", type=int, default=17, help="significant digits of numbers")
    comparing = commands.add_parser("compare")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    options = parser.parse_args()
    if options.command == "write":
        return write(options.folder, options.parts, options.digits)
    return compare(options.old, options.new)


if __name__ == "__main__":
    sys.exit(main())
