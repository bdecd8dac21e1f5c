"""What `plan` does: chains for a goal, and their predictions."""

from __future__ import annotations

import argparse
from pathlib import Path

from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_models, model_path
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.planner import chains_for
from ator_ros.planning.search import search
from ator_ros.planning.wanted import Wish, wish_from
from ator_ros.refinement.gate import gate_in, opened
from ator_ros.refinement.refiner import Judged, Refiner, choose
from ator_ros.robot.description import Robot
from ator_ros.tools.option_types import finite
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import ObjectState, RobotState, World


def run(options: argparse.Namespace, domain: Domain) -> int:
    """Do what the command line asks for; return the exit code."""
    robot = domain.robot(options.robot or None)
    named = domain.goals(robot)
    if not options.goal:
        print(f"goals of {domain.name}: {', '.join(sorted(named)) or 'none with a name'}")
        return 0
    library = domain.library(robot, options.action_set)
    world = _situation(options, domain)
    chains = chains_for(_wishes(options.goal, domain, robot), world, library, domain.objects, search)
    if not chains:
        print("the goal holds already")
        return 0
    folder = Path(options.models) if options.models else domain.shipped_models
    models = load_models(robot, domain.known_features, action_set=options.action_set, folder=folder)
    gate = gate_in(folder / model_path("gate", options.action_set).parent, options.action_set)
    refiner = Refiner(robot, models, opened(gate), ranges=library.ranges)
    judged = choose(refiner, world, chains, placeholders=True).judged
    for each, chain in sorted(zip(judged, chains, strict=True), key=lambda pair: pair[0].rank):
        print(_line(each, chain))
    return 0


def _wishes(words: list[str], domain: Domain, robot: Robot) -> list[Wish]:
    named = domain.goals(robot)
    if len(words) == 1 and "=" not in words[0]:
        if words[0] not in named:
            there = ", ".join(sorted(named)) or "none"
            raise PlanningError(f"goal: expected a statement or one of the names {there}, got {words[0]!r}")
        return list(named[words[0]].terms)
    return [wish_from(word) for word in words]


def _situation(options: argparse.Namespace, domain: Domain) -> World:
    objects: dict[str, ObjectState] = {}
    for name, *place in options.object:
        if name not in domain.objects:
            raise PlanningError(
                f"object: expected one of {', '.join(domain.objects) or 'none'}, got {name!r}"
            )
        try:
            x, y = map(finite, place)
        except argparse.ArgumentTypeError as error:
            raise PlanningError(f"object {name}: {error}") from error
        objects[name] = ObjectState(x, y)
    return World(0.0, RobotState(Pose(*options.at)), objects)


def _line(judged: Judged, planned: TopChain) -> str:
    """Return a chain as it was refined, with its prediction."""
    found, prediction = judged.refinement, judged.prediction
    chain = planned if found is None else found.chain
    steps = (
        f"{call.top.name} ({call.goal.pose.x:.2f}, {call.goal.pose.y:.2f}, {call.goal.pose.yaw:.2f} rad)"
        for call in chain.calls
    )
    time = judged.reason if prediction is None else f"{prediction.duration:.2f} s"
    return f"{time:>8}  {', '.join(steps)}"
