"""Warm-up: compute all tables and compile all code before the first goal."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from ator_ros.actions.base import ActionError, Goal
from ator_ros.execution.predictions import Predictor
from ator_ros.geometry import Pose
from ator_ros.refinement import RefinementError
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import held_first, kept, object_fetched_by, objects_in
from ator_ros.world.state import ObjectState, RobotState, World

_OPEN = frozenset({"yaw", "speed"})


def warm_up_refinement(library: TopLibrary, refiner: Refiner) -> None:
    """Refine chains of two steps, with each TOP, whose first goal has a free heading and speed."""
    for world, chain in _chains(library):
        with contextlib.suppress(RefinementError):  # the first request reports it
            refiner.refine(world, chain)


def warm_up_predictions(library: TopLibrary, predictor: Predictor) -> None:
    """Predict one chain of two steps; no action is started."""
    for world, chain in _chains(library):
        with contextlib.suppress(RefinementError):
            predictor.chain(world, chain)
            return


def _chains(library: TopLibrary) -> Iterator[tuple[World, TopChain]]:
    """Yield chains of two steps and where they start: first, to fetch an object and to carry it."""
    usable, robot, area = library.usable(), library.robot, library.robot.scene.area
    fetching = next((top for top in usable if object_fetched_by(top)), None)
    carrying = next((top for top in usable if kept(top)), None)
    fetches = [(fetching, carrying)] if fetching is not None and carrying is not None else []
    for first, last in (*fetches, *zip(usable, usable, strict=True)):
        calls = (
            TopCall(first, library.goal(first, area.at(0.0, 0.0)), _OPEN),
            TopCall(last, library.goal(last, area.at(2.0, 1.0))),
        )
        held = area.at(-1.0, 0.5, 1.0) if held_first(first) is not None else None
        yield _world(robot, first, held), TopChain(calls)


def warm_up_actions(library: TopLibrary, predictor: Predictor) -> None:
    """Plan and predict each TOP of `library`."""
    for world, chain in _chains(library):
        first = chain.calls[0]
        if _plans(library, first.top, world, first.goal):
            predictor.chain(world, TopChain((first,)))


def _world(robot: Robot, top: Top, pose: Pose | None = None) -> World:
    """Return a world in which all objects are at the center of the area and the robot away from them.

    If there is a `pose`, the robot is there and holds them.
    """
    area = robot.scene.area
    place = area.at(0.0, 0.0) if pose is None else robot.hold_point(pose)
    objects = dict.fromkeys((*robot.scene.objects, *objects_in(top)), ObjectState(place.x, place.y))
    return World(0.0, RobotState(pose or area.at(-1.0, 0.5, 1.0)), objects)


def _plans(library: TopLibrary, top: Top, world: World, goal: Goal) -> bool:
    """Return whether the action can start. Actions from outside may need other situations."""
    try:
        action = library.action(top)
        action.start(world, goal)
    except ActionError:
        return False
    action.end("warmed up")
    return True
