"""The predicted performance of a whole chain as a function of its free variables (paper, section 4.3).

`StepRows` computes the situations in which the actions of a chain start and end: at the subgoals
(paper, section 4.1), or as far short of them as the action usually stops. `ChainModel` predicts the
actions in these situations and adds up their costs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import direct_name, goal_values
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import (
    DIRECT_VARIABLES,
    SPEEDG,
    XG,
    YAW,
    YAWG,
    YG,
    DirectTable,
    V,
    X,
    Y,
)
from ator_ros.bases.routes import arrival_heading, routes_of
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.model import Arrival
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.search import Pairs, StepCosts
from ator_ros.tops.chain import TopChain, projected
from ator_ros.world.state import World

REPORTED = ("duration", "spread", "success", "accuracy")
"""Fields predicted for every action regardless of the objective."""

_START_ROWS = {"x": X, "y": Y, "yaw": YAW, "speed": V}
_GOAL_ROWS = {"x": XG, "y": YG, "yaw": YAWG, "speed": SPEEDG}
"""Rows of the goal variables in the table of the step after their goal, and of the step that leads to it."""


class PredictsPerformance(Protocol):
    """The interface of a performance model; `ator_ros.performance.model` has the learned one."""

    @property
    def arrival(self) -> Arrival | None:
        """How far short of its goals the action stops; None: not at all."""

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the prediction depends on."""

    def predict(
        self, direct: Mapping[str, Any], measures: tuple[str, ...], signs: FloatArray | None
    ) -> Any:
        """Return a prediction whose fields named in `measures` are arrays of shape (n,).

        With `signs`, shape (n,), it has `error_of_sum`: the expected error in s of the sum of the
        durations with these signs, and its variance in s².
        """


# The situations of a chain


def columns_after(
    goal: Mapping[str, Any], point: Point, robot: Robot
) -> dict[str, float | FloatArray]:
    """Return the start variables x, y, yaw, v, w, vy of the action after a subgoal that is reached exactly.

    They are numbers, or arrays (n,) for n candidates, as the variables of the goal are.
    """
    x, y, yaw = goal["x"], goal["y"], goal["yaw"]
    if point is Point.HOLD:
        x, y = x - robot.hold * np.cos(yaw), y - robot.hold * np.sin(yaw)
    return {"x": x, "y": y, "yaw": yaw, "v": goal["speed"], "w": 0.0, "vy": 0.0}


class StepRows:
    """The direct variables of one step of a chain, for candidates of the subgoals on both sides.

    Parameters
    ----------
    start : sequence of float
        Start variables x, y, yaw, v, w, vy of the step, if candidates of `previous` do not change them.
    goal, names : Goal, sequence of str
        The subgoal that the step leads to, and its free variables.
    previous, previous_names : Goal or None, sequence of str
        The subgoal at which the step starts, and its free variables; None for the first step.
    hold : float
        Distance in m from the axle to the hold.
    arrival : Arrival or None
        How far short of `previous` its action stops.
    bearing : float
        Direction in rad in which the robot comes to `previous`.
    """

    def __init__(
        self,
        start: Sequence[Any],
        goal: Goal,
        names: Sequence[str],
        previous: Goal | None,
        previous_names: Sequence[str],
        hold: float,
        arrival: Arrival | None = None,
        bearing: float = 0.0,
    ) -> None:
        declared = sorted(goal.values)
        self.names = (*DIRECT_VARIABLES, *map(direct_name, declared))
        values = goal.speed, goal.point is Point.HOLD, *(goal.values[name] for name in declared)
        self._fixed = np.array([*start, *goal.pose, *values], dtype=float)
        self._of_goal = [
            (
                _GOAL_ROWS[name] if name in _GOAL_ROWS else self.names.index(direct_name(name)),
                column,
            )
            for column, name in enumerate(names)
        ]
        self._of_start = [
            (_START_ROWS[name], column)
            for column, name in enumerate(previous_names)
            if name in _START_ROWS
        ]
        self._held = (
            previous.pose if previous is not None and previous.point is Point.HOLD else None
        )
        self._hold = hold
        self._arrival, self._bearing = arrival, bearing

    def values(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the direct variables, shape (names, ...), for candidates (..., k), broadcast together.

        They are of the subgoals before and after the step; those that change no variable count as
        one.
        """
        columns: dict[int, Any] = {row: before[..., column] for row, column in self._of_start}
        if self._held is not None and columns:
            yaw = columns.get(YAW, self._fixed[YAW])
            columns[X] = columns.get(X, self._held.x) - self._hold * np.cos(yaw)
            columns[Y] = columns.get(Y, self._held.y) - self._hold * np.sin(yaw)
        if self._arrival is not None:
            x, y, yaw = (columns.get(row, self._fixed[row]) for row in (X, Y, YAW))
            dist, angle = self._arrival.dist, self._arrival.angle
            columns[X], columns[Y] = (
                x - dist * math.cos(self._bearing),
                y - dist * math.sin(self._bearing),
            )
            columns[YAW] = yaw - wrap_angles(yaw - self._bearing).clip(-angle, angle)
        columns |= {row: after[..., column] for row, column in self._of_goal}
        table = np.empty((len(self._fixed), *np.broadcast(*columns.values()).shape))
        table.T[:] = self._fixed
        for row, values in columns.items():
            table[row] = values
        return table


def step_rows(
    world: World,
    chain: TopChain,
    robot: Robot,
    names: Sequence[Sequence[str]],
    models: Mapping[str, PredictsPerformance],
) -> list[StepRows]:
    """Return the direct variables of each action of `chain`.

    `names` are the subgoals' free variables.
    """
    state, rows = world.robot, []
    start: Sequence[Any] = (*state.pose, state.vx, state.w, state.vy)
    previous: Goal | None = None
    before: Sequence[str] = ()
    arrival, bearing = None, 0.0
    stays = any(not call.top.arrives for call in chain.calls[:-1])
    for index, call in enumerate(chain.calls):
        rows.append(
            StepRows(start, call.goal, names[index], previous, before, robot.hold, arrival, bearing)
        )
        if stays:
            world = projected(world, call, robot)
        if call.top.arrives:
            previous, before = call.goal, names[index]
            model = models.get(call.top.action)
            arrival = model.arrival if model is not None and previous.point is Point.AXLE else None
            bearing = arrival_heading(start[:2], previous.pose, robot)
            start = tuple(columns_after(goal_values(previous), previous.point, robot).values())
        else:  # the robot is where the post-condition puts it
            previous, before, arrival = None, (), None
            start = (*world.robot.pose, world.robot.vx, world.robot.w, world.robot.vy)
    return rows


def chain_situations(
    world: World, chain: TopChain, robot: Robot, models: Mapping[str, PredictsPerformance]
) -> list[DirectTable]:
    """Return the direct variables of each action of `chain` with its own values."""
    rows = step_rows(world, chain, robot, [()] * len(chain.calls), models)
    return [
        DirectTable(step.names, step.values(np.zeros(0), np.zeros(0))[:, None]) for step in rows
    ]


# The prediction


@dataclass(frozen=True, slots=True)
class ChainPrediction:
    """Predicted performance of one chain.

    Attributes
    ----------
    actions : tuple of mapping
        For each action the predicted fields of `REPORTED`, as in `Prediction`, and those of the
        objective. Fields that the model does not predict are left out; an action without a model
        has none.
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


class ChainModel:
    """The cost of the steps of one chain, from one state of the world, for candidates of its free variables.

    `given` are the chain's own values of the free variables of each subgoal, shapes (k,).

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
    ) -> None:
        self.names = names
        self._robot, self._routes = robot, routes_of(robot)
        self.rows = step_rows(world, chain, robot, self.names, models)
        self._actions = [call.top.action for call in chain.calls]
        self._models = {action: models.get(action) for action in self._actions}
        self.objective = objective
        self.given = [
            np.array([goal_values(call.goal)[name] for name in names], dtype=float)
            for call, names in zip(chain.calls, self.names, strict=True)
        ]

    def step_costs(self, steps: Sequence[Pairs]) -> list[FloatArray]:
        """Return the costs of actions, see `ator_ros.refinement.search.StepCosts`."""
        tables = [(index, self.rows[index].values(before, after)) for index, before, after in steps]
        # an action without a model costs nothing
        costs = [np.zeros(table.shape[1:]) for _, table in tables]
        for places, prediction in self._predictions(tables, self.objective.needs, None):
            cost = self._cost(prediction)
            for place in places:
                (index, table), size = tables[place], costs[place].size
                costs[place], cost = cost[:size].reshape(table.shape[1:]), cost[size:]
                if self._routes is not None and {"x", "y"} & set(self.names[index]):
                    has_room = self._routes.clearance(table[XG], table[YG]) >= self._robot.reach
                    costs[place] = np.where(has_room, costs[place], np.inf)
        return costs

    def costs_of_step(self, index: int) -> StepCosts:
        """Return a function for the costs of one action alone, whatever the number of the step."""
        return lambda steps: self.step_costs([(index, before, after) for _, before, after in steps])

    def predict(self) -> ChainPrediction:
        """Return the prediction for the chain's own values.

        Its cost is infinite if that of a step is NaN.
        """
        return self._predicted((self.given,), None)[0][0]

    def compare(
        self, before: Sequence[FloatArray], after: Sequence[FloatArray]
    ) -> tuple[ChainPrediction, ChainPrediction, float]:
        """Return the predictions of two chains, and the uncertainty of the second's gain in duration (s).

        It is the error of the models, from their errors on episodes that they were not learned
        from; the difference between single runs is `ChainPrediction.spread`.
        """
        (first, second), uncertainty = self._predicted(
            (before, after), np.repeat((1.0, -1.0), len(before))
        )
        return first, second, uncertainty

    def _predicted(
        self, chains: Sequence[Sequence[FloatArray]], signs: FloatArray | None
    ) -> tuple[list[ChainPrediction], float]:
        """Return the predictions, and the uncertainty in s of the sum of all durations with these signs."""
        error = variance = 0.0
        count = len(self._actions)
        pairs = [pair for chain in chains for pair in itertools.pairwise((np.zeros(0), *chain))]
        tables = [
            (at % count, self.rows[at % count].values(*pair)) for at, pair in enumerate(pairs)
        ]
        actions: list[dict[str, float]] = [{} for _ in tables]
        costs = np.zeros(len(tables))
        fields = tuple(dict.fromkeys(REPORTED + self.objective.needs))
        for places, prediction in self._predictions(tables, fields, signs):
            if signs is not None:
                error, variance = (
                    error + prediction.error_of_sum[0],
                    variance + prediction.error_of_sum[1],
                )
            columns = {name: getattr(prediction, name, None) for name in fields}
            known = {name: each.tolist() for name, each in columns.items() if each is not None}
            costs[places] = self._cost(prediction)
            for row, place in enumerate(places):
                actions[place] = {name: each[row] for name, each in known.items()}
        sums = costs.reshape(-1, count).sum(axis=1).tolist()
        parts = [tuple(actions[first : first + count]) for first in range(0, len(tables), count)]
        predictions = [ChainPrediction(*each) for each in zip(parts, sums, strict=True)]
        return predictions, math.sqrt(error**2 + variance)

    def _predictions(
        self,
        tables: Sequence[tuple[int, FloatArray]],
        fields: tuple[str, ...],
        signs: FloatArray | None,
    ) -> Iterator[tuple[list[int], Any]]:
        """Yield for each action which of the tables are its own, and the prediction for all of them.

        `tables` are indices of steps and their direct variables.
        """
        actions = [self._actions[step] for step, _ in tables]
        for action in dict.fromkeys(actions):
            model = self._models[action]
            if model is None:
                continue
            # One prediction for all steps of a model takes hardly longer than for one step.
            places = [place for place, other in enumerate(actions) if other == action]
            names = self.rows[tables[places[0]][0]].names
            parts = [tables[place][1].reshape(len(names), -1) for place in places]
            direct = DirectTable(names, np.concatenate(parts, axis=1))
            with np.errstate(all="ignore"):
                prediction = model.predict(direct, fields, None if signs is None else signs[places])
            yield places, prediction

    def _cost(self, prediction: Any) -> FloatArray:
        return np.asarray(np.fmin(self.objective.cost(prediction), np.inf))  # NaN becomes infinite


def predict_chain(
    world: World,
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
    objective: Objective | None = None,
) -> ChainPrediction:
    """Return the prediction for `chain` with its own values, from the state `world`.

    `models` has a model for each action of the chain; `objective` defines the cost, by default the
    duration.
    """
    names: list[tuple[str, ...]] = [()] * len(chain.calls)
    objective = objective or Objective()
    return ChainModel(
        world, chain, robot, models=models, names=names, objective=objective
    ).predict()
