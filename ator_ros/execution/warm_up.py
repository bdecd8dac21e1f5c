"""Warm-up: compute all tables and load all compiled code before the first goal."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from ator_ros.actions.base import ActionError
from ator_ros.execution.predictions import Predictor
from ator_ros.refinement import RefinementError
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import held_first, kept, object_fetched_by, objects_in
from ator_ros.world.state import ObjectState, RobotState, World

_OPEN = frozenset({"yaw", "speed"})


def warm_up_refinement(library: TopLibrary, refiner: Refiner) -> None:
    """Refine chains of two steps, with each TOP, whose first goal has a free heading and speed."""
    for world, chain in _chains(library):
        with contextlib.suppress(RefinementError):  # the first request reports it
            refiner.refine(world, chain)


def warm_up_actions(library: TopLibrary, predictor: Predictor) -> None:
    """Plan and predict each TOP of `library`."""
    for world, chain in _chains(library):
        first = chain.calls[0]
        with contextlib.suppress(ActionError, RefinementError):  # other actions may need other situations
            action = library.action(first.top)
            action.start(world, first.goal)
            action.end("warmed up")
            predictor.chain(world, TopChain((first,)))


def _chains(library: TopLibrary) -> Iterator[tuple[World, TopChain]]:
    """Yield chains of two steps and where they start: first, to fetch an object and to carry it.

    All objects are at the center of the area, or held where the first step needs that.
    """
    usable, robot, area = library.usable(), library.robot, library.robot.scene.area
    fetching = next((top for top in usable if object_fetched_by(top)), None)
    carrying = next((top for top in usable if kept(top)), None)
    fetches = [(fetching, carrying)] if fetching is not None and carrying is not None else []
    start = area.at(-1.0, 0.5, 1.0)
    for first, last in (*fetches, *zip(usable, usable, strict=True)):
        calls = (
            TopCall(first, library.goal(first, area.at(0.0, 0.0)), _OPEN),
            TopCall(last, library.goal(last, area.at(2.0, 1.0))),
        )
        place = robot.hold_point(start) if held_first(first) is not None else area.at(0.0, 0.0)
        objects = dict.fromkeys((*robot.scene.objects, *objects_in(first)), ObjectState(place.x, place.y))
        yield World(0.0, RobotState(start), objects), TopChain(calls)
