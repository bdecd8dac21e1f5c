"""Predictions of chains under execution, and the warm-up of actions, models and refinement."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping

from ator_ros.actions.base import ActionError
from ator_ros.actions.goal_variables import ORDER
from ator_ros.bases.description import Robot
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.refinement import RefinementError
from ator_ros.refinement.chain_prediction import ChainPrediction, PredictsPerformance, predict_chain
from ator_ros.refinement.order import MOST_EXACT
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import held_first, kept, object_fetched_by, objects_in
from ator_ros.world.state import ObjectState, RobotState, World


class Predictor:
    """Predicts chains and their actions; `models` are performance models by action."""

    def __init__(self, robot: Robot, models: Mapping[str, PredictsPerformance]) -> None:
        self._robot = robot
        self.models = models

    def chain(self, world: World, chain: TopChain) -> ChainPrediction:
        """Predict `chain` from the state `world`."""
        return predict_chain(world, chain, self.models, self._robot)

    def action(self, world: World, chain: TopChain, step: int) -> Mapping[str, float]:
        """Predict one step (from 0) of `chain` from the state `world`."""
        return self.chain(world, TopChain((chain.calls[step],))).actions[0]


class Forecast:
    """The predictions of a chain in execution: as a whole, and after the last change."""

    def __init__(self, predictor: Predictor, executor: ChainExecutor) -> None:
        self._predictor = predictor
        self._executor = executor
        self.begun = False
        """Whether the chain has started."""
        self.whole: ChainPrediction | None = None
        """The prediction of the chain with which it started; None before."""
        self._rest: ChainPrediction | None = None
        self._step = 0
        self._time = math.nan  # where and when (s) `_rest` begins

    def begin(self, world: World) -> None:
        """Predict the chain from its start `world`."""
        self.change(world)
        self.begun = True
        self.whole = self._rest

    def change(self, world: World) -> None:
        """Predict the rest of the chain, which has changed, from the state `world`."""
        self._step = self._executor.index
        self._time = world.time
        self._rest = self._predictor.chain(
            world, TopChain(self._executor.chain.calls[self._step :])
        )

    def remaining(self, now: float) -> float:
        """Return the predicted time in s from `now`, on odometry's clock, to the end.

        NaN if unknown.
        """
        step = self._executor.index - self._step
        if self._rest is None or step < 0:
            return math.nan
        began = max(self._time, self._executor.changed_at)
        current, *rest = (action["duration"] for action in self._rest.actions[step:])
        return max(0.0, current - (now - began)) + sum(rest)


_OPEN = frozenset({"yaw", "speed"})


def warm_up_refinement(library: TopLibrary, refiner: Refiner) -> None:
    """Refine chains of two steps with each TOP, and chains in open orders.

    This computes all tables and loads all compiled code.
    """
    for world, chain in (*_chains(library), *_rounds(library)):
        with contextlib.suppress(RefinementError):  # the first request reports it
            refiner.refine(world, chain)


def _rounds(library: TopLibrary) -> Iterator[tuple[World, TopChain]]:
    """Yield chains in an open order, few and many steps, of a TOP that may start anywhere."""
    for top in library.usable():
        if top.arrives and not (top.pre.terms or top.pre.relations):
            goal = library.goal(top, library.robot.scene.area.at(0.0, 0.0))
            stop = TopCall(top, goal, frozenset({"yaw", ORDER}))
            world = World(0.0, RobotState(library.robot.scene.area.at(-1.0, 0.5, 1.0)))
            for steps in (2, MOST_EXACT + 1):
                yield world, TopChain((stop,) * steps)
            return


def warm_up_actions(library: TopLibrary, predictor: Predictor) -> None:
    """Plan and predict each TOP of `library`."""
    for world, chain in _chains(library):
        first = chain.calls[0]
        # other actions may need other situations
        with contextlib.suppress(ActionError, RefinementError):
            action = library.action(first.top)
            action.start(world, first.goal)
            action.end("warmed up")
            predictor.chain(world, TopChain((first,)))


def _chains(library: TopLibrary) -> Iterator[tuple[World, TopChain]]:
    """Yield states, and chains of two steps whose first goal has a free heading and speed.

    The first chain fetches an object and carries it. All objects are at the center of the area, or
    held if the first step needs that.
    """
    usable = library.usable()
    robot = library.robot
    area = library.robot.scene.area
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
        objects = dict.fromkeys(
            (*robot.scene.objects, *objects_in(first)), ObjectState(place.x, place.y)
        )
        yield World(0.0, RobotState(start), objects), TopChain(calls)
