"""The predicted performance of a whole chain as a function of its free variables (paper, section 4.3).

`StepRows` computes the situations in which the actions of a chain start and end, if every subgoal is reached
exactly (paper, section 4.1). `ChainModel` predicts the actions from these situations and adds up their costs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import direct_name, goal_values
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.performance.direct import SPEEDG, XG, YAW, YAWG, YG, DirectTable, V, X, Y, names_with
from ator_ros.refinement import RefinementError
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.search import StepCost, row_of
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain, projected
from ator_ros.world.state import World

Memory = dict[tuple[Any, ...], Any]

REPORTED = ("duration", "spread", "success", "accuracy", "dist", "ideal")
"""Fields predicted for every action regardless of the objective, for reports and calibration."""

_NAMES = names_with(())
_START_ROWS = {"x": X, "y": Y, "yaw": YAW, "speed": V}
_GOAL_ROWS = {"x": XG, "y": YG, "yaw": YAWG, "speed": SPEEDG}
"""Rows of the goal variables in the table of the step after their goal, and of the step that leads to it."""

_ROOM_STEP = 0.1  # m between tested points: less than the depth of a bay
_MOST_ROOM_POINTS = 400
_ASIDE = (-1.0, 0.0, 1.0)
_CLEARANCE = 0.1  # m: a wall is some centimeters thick, and arrivals are not exact


class PredictsPerformance(Protocol):
    """The interface of a performance model; `ator_ros.performance.model` has the learned one."""

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the prediction depends on."""

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ("duration",)) -> Any:
        """Return a prediction whose fields named in `measures` are arrays of shape (n,)."""


# The situations of a chain


def columns_after(goal: Mapping[str, Any], point: Point, robot: Robot) -> dict[str, float | FloatArray]:
    """Return the start variables x, y, yaw, v, w of the action that follows a subgoal reached exactly.

    They are numbers, or arrays of shape (n,) for n candidates, as those of the goal are.
    """
    x, y, yaw = goal["x"], goal["y"], goal["yaw"]
    if point is Point.HOLD:
        x, y = x - robot.hold * np.cos(yaw), y - robot.hold * np.sin(yaw)
    return {"x": x, "y": y, "yaw": yaw, "v": goal["speed"], "w": 0.0}


class StepRows:
    """The direct variables of one step of a chain, for candidates of the subgoals on both its sides.

    Parameters
    ----------
    start : sequence of float
        Start variables x, y, yaw, v, w of the chain itself.
    goal : Goal
        The subgoal that the step leads to.
    names : sequence of str
        Its free variables.
    previous : Goal, optional
        The subgoal at which the step starts; None for the first step.
    previous_names : sequence of str
        Its free variables.
    hold : float
        Distance in m from the axle to the hold.
    """

    def __init__(
        self,
        start: Sequence[Any],
        goal: Goal,
        names: Sequence[str],
        previous: Goal | None,
        previous_names: Sequence[str],
        hold: float,
    ) -> None:
        pose, declared = goal.pose, sorted(goal.values)
        self._names = names_with(map(direct_name, declared)) if declared else _NAMES
        self._alike = np.array(
            [
                *start,
                *(pose.x, pose.y, pose.yaw, goal.speed, 1.0 if goal.point is Point.HOLD else 0.0),
                *(goal.values[name] for name in declared),
            ],
            dtype=float,
        )
        self._of_goal = [
            (_GOAL_ROWS[name] if name in _GOAL_ROWS else self._names.index(direct_name(name)), column)
            for column, name in enumerate(names)
        ]
        self._of_start = [
            (_START_ROWS[name], column) for column, name in enumerate(previous_names) if name in _START_ROWS
        ]
        self._held = previous.pose if previous is not None and previous.point is Point.HOLD else None
        self._hold = hold

    def table(self, before: FloatArray, after: FloatArray) -> DirectTable:
        """Return the table for candidates, shapes (n or 1, k), of the subgoals before and after the step."""
        count = max(len(before) if self._of_start else 1, len(after) if self._of_goal else 1)
        table = self._alike[:, None].repeat(count, axis=1)
        for row, column in self._of_goal:
            table[row] = after[:, column]
        for row, column in self._of_start:
            table[row] = before[:, column]
        if self._held is not None and self._of_start:
            yaw, moved = table[YAW], {row for row, _ in self._of_start}
            for row, given, way in ((X, self._held.x, np.cos(yaw)), (Y, self._held.y, np.sin(yaw))):
                table[row] = (table[row] if row in moved else given) - self._hold * way
        return DirectTable(self._names, table)


def step_rows(world: World, chain: TopChain, robot: Robot, names: Sequence[Sequence[str]]) -> list[StepRows]:
    """Return the direct variables of each action of `chain`; `names` are the subgoals' free variables.

    A step whose TOP does not arrive leaves the robot where its post-condition puts it.
    """
    state, rows = world.robot, []
    start: Sequence[Any] = (*state.pose, state.v, state.w)
    previous: Goal | None = None
    before: Sequence[str] = ()
    stays = any(not call.top.arrives for call in chain.calls[:-1])
    for index, call in enumerate(chain.calls):
        rows.append(StepRows(start, call.goal, names[index], previous, before, robot.hold))
        if stays:
            world = projected(world, call, robot)
        if call.top.arrives:
            previous, before = call.goal, names[index]
            start = tuple(columns_after(goal_values(previous), previous.point, robot).values())
        else:
            previous, before = None, ()
            start = (*world.robot.pose, world.robot.v, world.robot.w)
    return rows


def chain_situations(world: World, chain: TopChain, robot: Robot) -> list[DirectTable]:
    """Return the direct variables of each action of `chain`, all of whose subgoals are reached exactly."""
    as_given = np.zeros((1, 0))
    rows = step_rows(world, chain, robot, [()] * len(chain.calls))
    return [step.table(as_given, as_given) for step in rows]


# The prediction


@dataclass(frozen=True, slots=True)
class ChainPrediction:
    """Predicted performance of one chain.

    Attributes
    ----------
    actions : tuple of mapping
        For each action the predicted fields of `REPORTED`, as in `Prediction`, and what else the objective
        needs; a field that the model does not predict is left out, and all are for an action without a model.
    cost : float
        The objective summed over the actions that have a model.
    """

    actions: tuple[Mapping[str, float], ...]
    cost: float

    @property
    def duration(self) -> float:
        """Sum of the durations in s; NaN where an action has no model."""
        return sum(action.get("duration", math.nan) for action in self.actions)

    @property
    def spread(self) -> float:
        """Standard deviation in s of the summed duration, the actions' errors taken as independent."""
        return math.hypot(*(action.get("spread", 0.0) for action in self.actions))


class _Alone(NamedTuple):
    """The prediction for all steps of one action with the chain's own values, each step's row, the costs."""

    rows: Mapping[int, int]
    prediction: Any
    cost: FloatArray


class _Searched(NamedTuple):
    """The candidates (n or 1, k) on both sides of a step, their prediction, and its cost (n,)."""

    before: FloatArray
    after: FloatArray
    prediction: Any
    cost: FloatArray


class ChainModel:
    """The cost of the steps of one chain, from one state of the world, for candidates of its free variables.

    Parameters
    ----------
    world, chain, robot
        The request.
    models : mapping
        Action name to performance model; a step without one costs nothing.
    names : sequence of tuple of str, one per subgoal
        The free variables; candidates have a column for each.
    objective : Objective
        What a step costs.
    memory : dict, optional
        Cache of predictions by situation, shared by the chain models of one request, which predict the same
        grids.
    """

    def __init__(
        self,
        world: World,
        chain: TopChain,
        robot: Robot,
        *,
        models: Mapping[str, PredictsPerformance],
        names: Sequence[tuple[str, ...]],
        objective: Objective,
        memory: Memory | None = None,
    ) -> None:
        self.names = names
        self._rows = step_rows(world, chain, robot, self.names)
        self._calls = chain.calls
        self._models = [models.get(call.top.action) for call in chain.calls]
        self._objective = objective
        self._fields = tuple(dict.fromkeys(REPORTED + objective.needs))
        #: The chain's own values, shapes (k,).
        self.given = [
            np.array([goal_values(call.goal)[name] for name in names], dtype=float)
            for call, names in zip(chain.calls, self.names, strict=True)
        ]
        self._given = [values.tolist() for values in self.given]
        self._as_given: dict[str, _Alone] = {}
        self._searched: list[list[_Searched]] = [[] for _ in chain.calls]
        self._memory = memory

    def step_cost(self, index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the cost of one action, shape (n,), see `ator_ros.refinement.search.StepCost`."""
        model = self._models[index]
        if model is None:
            return np.zeros(1)
        if len(before) == len(after) == 1 and self._is_given(index, before[0], after[0]):
            alone = self._step_as_given(index, model)
            row = alone.rows[index] if len(alone.cost) > 1 else 0
            return alone.cost[row : row + 1]
        with np.errstate(all="ignore"):
            prediction = self._predict(index, model, before, after)
            cost = self._cost(prediction)
        self._searched[index].append(_Searched(before, after, prediction, cost))
        return cost

    def predict(self, chain: Sequence[FloatArray]) -> ChainPrediction:
        """Return the prediction for a chain whose subgoals have these free values, each of shape (k,).

        Its cost is infinite where that of a step is no number.
        """
        previous, cost = np.zeros(0), 0.0
        actions: list[dict[str, float]] = []
        for index, (values, model) in enumerate(zip(chain, self._models, strict=True)):
            actions.append({})
            if model is not None:
                prediction, costs, row = self._known(index, model, previous, values)
                columns = {name: getattr(prediction, name, None) for name in self._fields}
                actions[-1] = {name: _row(each, row) for name, each in columns.items() if each is not None}
                cost += _row(costs, row)
            previous = values
        return ChainPrediction(tuple(actions), cost)

    def _known(
        self, index: int, model: PredictsPerformance, before: FloatArray, after: FloatArray
    ) -> tuple[Any, FloatArray, int]:
        """Return the prediction that contains a candidate, its costs, and the row of the candidate."""
        for searched in reversed(self._searched[index]):
            row = row_of((searched.before, before), (searched.after, after))
            if row is not None:
                return searched.prediction, searched.cost, row
        if self._is_given(index, before, after):
            alone = self._step_as_given(index, model)
            return alone.prediction, alone.cost, alone.rows[index]
        self.step_cost(index, before[None, :], after[None, :])
        last = self._searched[index][-1]
        return last.prediction, last.cost, 0

    def _is_given(self, index: int, before: FloatArray, after: FloatArray) -> bool:
        """Return whether both sides of a step, shapes (k,), have the chain's own values."""
        return after.tolist() == self._given[index] and (
            index == 0 or before.tolist() == self._given[index - 1]
        )

    def _step_as_given(self, index: int, model: PredictsPerformance) -> _Alone:
        """Predict all steps of one action with the chain's own values, which costs hardly more than one step.

        Most steps of long chains keep these values when the deadline passes.
        """
        action = self._calls[index].top.action
        if action not in self._as_given:
            steps = [step for step, call in enumerate(self._calls) if call.top.action == action]
            starts = [np.zeros(0), *self.given]
            tables = [self._rows[step].table(starts[step][None], self.given[step][None]) for step in steps]
            direct = DirectTable(tables[0].names, np.hstack([each.table for each in tables]))
            with np.errstate(all="ignore"):
                prediction = self._checked(index, model.predict(direct, self._fields))
                cost = self._cost(prediction)
            rows = {step: row for row, step in enumerate(steps)}
            self._as_given[action] = _Alone(rows, prediction, cost)
        return self._as_given[action]

    def _cost(self, prediction: Any) -> FloatArray:
        cost: FloatArray = np.fmin(self._objective.cost(prediction), np.inf)  # NaN becomes infinite
        return cost

    def _predict(self, index: int, model: PredictsPerformance, before: FloatArray, after: FloatArray) -> Any:
        direct = self._rows[index].table(before, after)
        if self._memory is None or len(before) > 1:  # no other search has the same pairs
            return self._checked(index, model.predict(direct, self._fields))
        key = (self._calls[index].top.action, self._fields, direct.table.tobytes())
        if key not in self._memory:
            self._memory[key] = self._checked(index, model.predict(direct, self._fields))
        return self._memory[key]

    def _checked(self, index: int, prediction: Any) -> Any:
        if prediction.duration is not None and np.ndim(prediction.duration) != 1:
            raise RefinementError(
                f"model of {self._calls[index].top.action}: expected predictions of shape (n,), "
                f"got {np.shape(prediction.duration)}"
            )
        return prediction


def predict_chain(
    world: World,
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
    objective: Objective | None = None,
) -> ChainPrediction:
    """Return the prediction for `chain` with its own values, from the state `world`.

    Parameters
    ----------
    models : mapping
        Action name to performance model, one for each action of the chain.
    objective : Objective, optional
        Defines the cost; by default the duration.
    """
    objective = objective if objective is not None else Objective()
    names: list[tuple[str, ...]] = [()] * len(chain.calls)
    model = ChainModel(world, chain, robot, models=models, names=names, objective=objective)
    return model.predict(model.given)


def _row(value: Any, row: int) -> float:
    """Return one row of a prediction that is the same for all chains when it has but one."""
    return float(value[row if len(value) > 1 else 0])


# Room to stop


def with_room(
    step_cost: StepCost, chain: TopChain, names: Sequence[tuple[str, ...]], robot: Robot, room: float
) -> StepCost:
    """Return `step_cost`, infinite for arrivals at a free speed that leave no room to stop.

    Models do not include walls. A robot that arrives at a bay at a speed from which it can neither
    turn nor stop gets stuck. The chain's own values keep their cost.

    Parameters
    ----------
    step_cost : callable
        Costs of the steps of `chain`.
    chain, names, robot
        The chain, and the free variables of each subgoal.
    room : float
        Multiple of the stopping distance that must be free, as the gate's file sets it; 0: none.
    """
    if room <= 0.0:
        return step_cost

    def cost(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        costs = step_cost(index, before, after)
        if "speed" not in names[index]:
            return costs
        goal = chain.calls[index].goal
        given = (after == [goal_values(goal)[name] for name in names[index]]).all(axis=1)
        return np.where(given | leaves_room(goal, names[index], after, robot, room), costs, np.inf)

    return cost


def leaves_room(
    goal: Goal, names: tuple[str, ...], candidates: FloatArray, robot: Robot, room: float
) -> BoolArray:
    """Return which arrivals leave room to stop, `room` times the stopping distance, and to turn: shape (n,).

    `names` are the variables of the columns of `candidates`, (n, k); `goal` has the values of the others.
    """
    value = {**goal_values(goal), **dict(zip(names, candidates.T, strict=True))}
    held = robot.holder if goal.point is Point.HOLD else None
    brake = robot.limits.brake if held is None else min(held.limits.brake, robot.limits.brake)
    speed = np.broadcast_to(np.asarray(value["speed"], dtype=float), len(candidates))
    way = room * speed * speed / (2.0 * brake)
    ahead = way + (held.radius if held is not None else robot.front)
    points = min(int(np.max(ahead, initial=0.0) / _ROOM_STEP) + 2, _MOST_ROOM_POINTS)
    along = np.linspace(0.0, 1.0, points)[:, None, None] * ahead
    aside = np.array(_ASIDE)[:, None] * (robot.reach + _CLEARANCE)  # room to turn, too
    cos, sin = np.cos(value["yaw"]), np.sin(value["yaw"])
    x, y = value["x"] + along * cos - aside * sin, value["y"] + along * sin + aside * cos
    free = np.ones(len(candidates), dtype=bool)
    for bay in robot.scene.bays:
        c, s = np.cos(bay.yaw), np.sin(bay.yaw)
        deep, beside = c * (x - bay.x) + s * (y - bay.y), c * (y - bay.y) - s * (x - bay.x)
        inside = (deep > 0.0) & (deep < bay.depth) & (np.abs(beside) < bay.width / 2.0)
        free &= ~inside.any(axis=(0, 1))
    result: BoolArray = free | (speed <= 0.0)
    return result
