"""Record what the product decides, to show that a change of structure changes no decision.

    scripts/run python scripts/golden.py write FOLDER           # every part, one file each
    scripts/run python scripts/golden.py compare OLD NEW        # two folders, bit by bit

Numbers are written in full, so that two commits on one machine can be compared bit by bit. Other processors
round differently.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.actions.goal_variables import goal_values
from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES, as_planned, naive, open_places, open_speeds, reopened
from ator_ros.evaluation.toolset import ToolsetSource, make_library, tools_of
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.experience.collect import collect
from ator_ros.experience.table import join
from ator_ros.files import write_text
from ator_ros.geometry import Pose
from ator_ros.performance.training import OBSERVED, direct_of, train
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.planner import chains_for
from ator_ros.planning.search import search
from ator_ros.planning.wanted import wish_from
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import Command, ObjectState, RobotState, World

Json = dict[str, Any]
Opening = Callable[[TopChain], TopChain]

REFINED: dict[str, tuple[ToolsetSource, str, Opening, str]] = {
    "default_heading": (ToolsetSource(), "dribble", as_planned, "learned"),
    "default_speed": (ToolsetSource(), "dribble", open_speeds, "learned"),
    "default_shot": (ToolsetSource(), "shoot", open_speeds, "learned"),
    "default_place": (ToolsetSource(), "shoot", open_places, "learned"),
    "observed_speed": (ToolsetSource(), "dribble", open_speeds, "observed"),
    "bezier_heading": (ToolsetSource(action_set="bezier"), "dribble", as_planned, "learned"),
    "drive_speed": (ToolsetSource(domain="drive"), "", open_speeds, "learned"),
    "tour_heading": (ToolsetSource(domain="tour"), "", as_planned, "learned"),
}
"""By name: where robot, models and gate come from, the chain, what is opened, and the set of models."""

MIXED = """
name: mixed
tops:
  - name: visit
    action: drive
    post:
      - {variable: robot.x, target: goal.x, tolerance: 0.25}
      - {variable: robot.y, target: goal.y, tolerance: 0.25}
      - {variable: robot.yaw, target: goal.yaw, tolerance: 0.25}
  - name: dock
    action: goToPose
    post:
      - {variable: robot.x, target: goal.x, tolerance: 0.06}
      - {variable: robot.y, target: goal.y, tolerance: 0.06}
      - {variable: robot.yaw, target: goal.yaw, tolerance: 0.12}
actions:
  - name: drive
    remote:
      server: drive_to
      type: ator_interfaces/action/DriveTo
      goal: [{field: goal, source: goal}]
      success: {fields: [{field: error_code, equals: 0}]}
    stand_in: drive_to
  - name: goToPose
    local: {domain: soccer}
chains:
  - name: rounds
    start: [{x: [-3.0, 3.0], y: [-2.0, 2.0]}]
    apart: 1.0
    steps:
      - {top: visit, goal: [{x: [-3.0, 3.0], y: [-2.0, 2.0]}], open: [yaw]}
      - {top: dock, goal: [{x: [-3.0, 3.0], y: [-2.0, 2.0]}], open: [yaw]}
      - {top: visit, goal: [{x: [-3.0, 3.0], y: [-2.0, 2.0]}]}
"""
"""A domain whose chains mix an action of a server (its stand-in) and one of ours."""


def _goals(chain: TopChain) -> list[Json]:
    return [{"top": call.top.name, **goal_values(call.goal)} for call in chain.calls]


def _predicted(prediction: ChainPrediction) -> Json:
    return {"cost": prediction.cost, "steps": [dict(step) for step in prediction.actions]}


def _trials(source: ToolsetSource, chain: str, seed: int, count: int) -> Iterator[Trial]:
    domain = find_domain(source.domain)
    name, library = chain or next(iter(domain.chains)), make_library(source.described(), source)
    for index in range(count):
        yield random_trial(domain, name, library, seed=seed, index=index)


def refined(name: str, count: int) -> list[Json]:
    """Return what refinement decides in `count` situations of one of `REFINED`; no deadline."""
    source, chain, opening, models = REFINED[name]
    tools, _ = tools_of(source)
    refiner = tools.refiner(models, gated=True)
    found = []
    for trial in _trials(source, chain, 4001, count):
        start = naive(tools, trial).chain
        answer = refiner.refine(trial.world, reopened(start, opening(trial.chain)))
        found.append(
            {
                "naive": _goals(start),
                "free": [[free.subgoal, free.name] for free in answer.free],
                "refined": answer.refined,
                "reason": answer.reason,
                "best": _goals(answer.best),
                "before": _predicted(answer.before),
                "after": _predicted(answer.after),
                "curves": [
                    [len(curve.totals), float(np.min(curve.totals)), float(np.sum(curve.totals))]
                    for curve in answer.curves
                ],
            }
        )
    return found


@contextmanager
def _commands() -> Iterator[list[Command]]:
    """Collect the commands that simulations get meanwhile."""
    sent: list[Command] = []
    original = Simulation.command

    def command(self: Simulation, command: Command) -> None:
        sent.append(command)
        original(self, command)

    Simulation.command = command  # type: ignore[method-assign]
    try:
        yield sent
    finally:
        Simulation.command = original  # type: ignore[method-assign]


def _executed(library: TopLibrary, trial: Trial, policy: str, source: ToolsetSource) -> Json:
    tools, _ = tools_of(source) if policy not in ("bearing", "face_goal") else (None, None)
    choice = POLICIES[policy](tools, trial)  # type: ignore[arg-type]  # headings by place need no tools
    domain, robot = find_domain(source.domain), source.described()
    with _commands() as sent:
        run = run_chain(
            robot, library, trial.world, choice.chain, time_limit=domain.time_limit, along=choice.along
        )
    table = np.array([(command.v, command.w) for command in sent])
    return {
        "duration": run.duration,
        "success": run.success,
        "actions": list(run.actions),
        "again": run.again,
        "commands": len(sent),
        "mean_v": float(table[:, 0].mean()),
        "mean_w": float(table[:, 1].mean()),
        "hash": hashlib.sha256(table.tobytes()).hexdigest(),
    }


def executed(count: int) -> dict[str, list[Json]]:
    """Return how chains are executed, `count` of each kind."""
    with tempfile.TemporaryDirectory() as folder:
        mixed = Path(folder) / "mixed.yaml"
        mixed.write_text(MIXED, encoding="utf-8")
        fifth = str(Path(__file__).parent.parent / "test" / "fifth.yaml")
        kinds: dict[str, tuple[ToolsetSource, str, str]] = {
            "dribble": (ToolsetSource(), "dribble", "gated_speed"),
            "shoot": (ToolsetSource(), "shoot", "gated_speed"),
            "rolling_ball": (ToolsetSource(), "rolling", "refined_again"),
            "bezier": (ToolsetSource(action_set="bezier"), "dribble", "gated"),
            "second_robot": (ToolsetSource(robot=fifth), "dribble", "bearing"),
            "drive": (ToolsetSource(domain="drive"), "", "gated"),
            "remote": (ToolsetSource(domain="tour"), "", "gated"),
            "mixed": (ToolsetSource(domain=str(mixed)), "rounds", "bearing"),
        }
        return {
            name: [
                _executed(make_library(source.described(), source), trial, policy, source)
                for trial in _trials(source, chain, 4002, count)
            ]
            for name, (source, chain, policy) in kinds.items()
        }


GOALS: Sequence[Sequence[str]] = (
    ("ball_in_goal",), ("ball_held",), ("ball.x=1.0", "ball.y=0.5"), ("robot.x=-1.0", "robot.y=1.0"),
    ("robot.x=0.5", "robot.y=-1.0", "robot.yaw=1.0"),
)  # fmt: skip


def planned(count: int) -> list[Json]:
    """Return the chains that are planned for `count` goals in soccer."""
    source = ToolsetSource()
    domain, robot = find_domain(source.domain), source.described()
    library, named = make_library(robot, source), domain.goals(robot)
    rng = np.random.default_rng(4003)
    found = []
    for index in range(count):
        words = GOALS[index % len(GOALS)]
        wishes = list(named[words[0]].terms) if words[0] in named else [wish_from(word) for word in words]
        (robot_x, robot_y, x, y), yaw = rng.uniform(-2.0, 2.0, 4), rng.uniform(-3.0, 3.0)
        pose = Pose(float(robot_x), float(robot_y), float(yaw))
        world = World(0.0, RobotState(pose), {"ball": ObjectState(float(x), float(y))})
        try:
            chains = chains_for(wishes, world, library, domain.objects, search)
        except PlanningError as error:
            found.append({"goal": list(words), "error": str(error)})
        else:
            found.append({"goal": list(words), "chains": [_goals(chain) for chain in chains]})
    return found


def trained(episodes: int) -> Json:
    """Return rules of models that are learned from a few simulated episodes, and what they predict."""
    domain = find_domain()
    robot, specs = domain.robot(), domain.actions()
    frames = collect(
        [specs["goToPose"], specs["dribbleBall"]], domain.tops_for(robot), robot,
        objects=domain.objects, episodes=episodes, seed=4004, time_limit=domain.time_limit,
    )  # fmt: skip
    rows = join(frames)
    found: Json = {}
    for action, own in rows.groupby("action", sort=False):
        starts = own[own["t"] == 0.0]
        for kind, features in (("described", domain.candidates(str(action))), ("observed", OBSERVED)):
            model = train(str(action), own, robot, features=features)
            durations = model.predict(direct_of(starts)).duration
            found[f"{action}_{kind}"] = {"rules": model.rules(), "durations": [float(d) for d in durations]}
    return found


PARTS: dict[str, Callable[[], Any]] = {
    **{f"refined_{name}": (lambda name=name: refined(name, 200)) for name in REFINED},  # type: ignore[misc]
    "executed": lambda: executed(8),
    "planned": lambda: planned(50),
    "trained": lambda: trained(60),
}


def write(folder: Path, parts: Sequence[str]) -> int:
    """Write the named parts, by default all."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in parts or PARTS:
        print(f"golden: {name}", flush=True)
        write_text(folder / f"{name}.json", json.dumps(PARTS[name](), indent=None) + "\n")
    return 0


def compare(old: Path, new: Path) -> int:
    """Report which parts differ; 1 where one does."""
    differing = 0
    for file in sorted(old.glob("*.json")):
        other = new / file.name
        same = other.exists() and other.read_bytes() == file.read_bytes()
        print(f"{file.stem}: {'same' if same else 'DIFFERS'}")
        differing += not same
    return int(differing > 0)


def main() -> int:
    """Write a folder, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write")
    writing.add_argument("folder", type=Path)
    writing.add_argument("parts", nargs="*", default=[])
    comparing = commands.add_parser("compare")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    options = parser.parse_args()
    if options.command == "write":
        return write(options.folder, options.parts)
    return compare(options.old, options.new)


if __name__ == "__main__":
    sys.exit(main())
