"""The predicted performance of a whole chain, given its free variables (paper, section 4.3).

`StepRows` computes the situations in which the actions of a chain start and end: at the subgoals
(paper, section 4.1), or as far short of them as the action usually stops. `ChainModel` predicts the
actions in these situations and adds up their costs.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import STOP, direct_name, goal_values
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DIRECT_VARIABLES, XG, YG, DirectTable
from ator_ros.bases.routes import arrival_heading, routes_of
from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.held_up import NOT_HELD_UP, HeldUp, bound_of_chain
from ator_ros.performance.model import Arrival, Passing
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.search import Pairs, StepCosts
from ator_ros.tops.chain import Top, TopCall, TopChain, projected
from ator_ros.world.state import World

REPORTED = ("duration", "spread", "noise", "bound", "delay", "success", "accuracy")
"""Fields predicted for every action regardless of the objective."""


class PredictsPerformance(Protocol):
    """The interface of a performance model; `ator_ros.performance.model` has the learned one."""

    @property
    def arrival(self) -> Arrival | None:
        """How far short of its goals the action stops; None: not at all."""

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the prediction depends on."""

    def predict(
        self,
        direct: Mapping[str, Any],
        measures: tuple[str, ...],
        signs: FloatArray | None,
    ) -> Any:
        """Return a prediction whose fields named in `measures` are arrays of shape (n,).

        With `signs`, shape (..., n), it has `error_of_sum`: the expected errors in s of the sums of
        the durations with these signs, and their variances in s².
        """


# The situations of a chain


def columns_after(
    goal: Mapping[str, Any],
    point: Point,
    robot: Robot,
) -> dict[str, float | FloatArray]:
    """Return the start variables x, y, yaw, v, w, vy after a subgoal that is reached exactly.

    They are numbers, or arrays (n,) for n candidates, as the variables of the goal are.
    """
    x = goal["x"]
    y = goal["y"]
    yaw = goal["yaw"]
    if point is Point.HOLD:
        hold = robot.hold
        x = x - hold * np.cos(yaw)
        y = y - hold * np.sin(yaw)
    return {"x": x, "y": y, "yaw": yaw, "v": goal["speed"], "w": 0.0, "vy": 0.0}


class _Subgoal:
    """A subgoal, the names of its free variables, and how the next action starts there.

    `arrival` is how far short of the subgoal the robot stops, None: not at all; `takeover` is where
    the next action takes over if the robot passes it. `bearing` is the direction in rad in which it
    comes there; None: that of the goal's heading.
    """

    def __init__(
        self,
        goal: Goal,
        names: Sequence[str],
        robot: Robot,
        arrival: Arrival | None,
        bearing: float | None,
        takeover: Takeover,
    ) -> None:
        self._values = goal_values(goal)  # once, as `start` is called for each block of candidates
        self._point = goal.point
        self._names = names
        self._robot = robot
        self._arrival = arrival
        self._bearing = bearing
        self._takeover = takeover

    def start(self, candidates: FloatArray) -> dict[str, Any]:
        """Return the start variables of the next action for candidates (..., k) of this subgoal."""
        goal = with_candidates(self._values, self._names, candidates)
        start = columns_after(goal, self._point, self._robot)
        stop = goal.get(STOP, 1.0)
        if np.all(stop == 0.0):
            return self._on_its_way(start)
        passed = self._on_its_way(start) if np.any(stop == 0.0) else None
        if self._arrival is not None and self._bearing is not None:
            dist = self._arrival.dist
            angle = self._arrival.angle
            start["x"] = start["x"] - dist * math.cos(self._bearing)
            start["y"] = start["y"] - dist * math.sin(self._bearing)
            turned = wrap_angles(start["yaw"] - self._bearing)
            start["yaw"] = start["yaw"] - turned.clip(-angle, angle)
        if passed is not None:
            for name, value in passed.items():
                start[name] = np.where(stop == 0.0, value, start[name])
        return start

    def _on_its_way(self, start: Mapping[str, Any]) -> dict[str, Any]:
        """Return the start variables after the subgoal was passed."""
        bearing = start["yaw"] if self._bearing is None else self._bearing
        return {
            **start,
            "x": start["x"] - self._takeover.dist * np.cos(bearing),
            "y": start["y"] - self._takeover.dist * np.sin(bearing),
            "yaw": bearing + 0.0 * start["yaw"],
            "v": self._takeover.speed + 0.0 * start["yaw"],
        }


class Takeover(NamedTuple):
    """Where an action takes over from one that passes its goal: distance to it (m), speed (m/s)."""

    dist: float
    speed: float


def takeover_of(top: Top, model: PredictsPerformance | None, robot: Robot) -> Takeover:
    """Return where the next action takes over from one that passes its goal.

    It is the farthest place from which the robot passes within the tolerance of the position, as
    far as drives have shown how much nearer it still comes. Without such drives the speed is half
    the robot's greatest one.
    """
    observed: Passing | None = getattr(model, "passing", None)
    if observed is None:
        return Takeover(top.place_tolerance, 0.5 * robot.greatest_speed())
    return Takeover(top.place_tolerance + observed.nearer, observed.speed)


def with_candidates(
    values: Mapping[str, float],
    names: Sequence[str],
    candidates: FloatArray,
) -> dict[str, float | FloatArray]:
    """Return `values` of a goal; of those with these names, columns of candidates (..., k)."""
    columns = {name: candidates[..., column] for column, name in enumerate(names)}
    return {**values, **columns}


class StepRows:
    """The direct variables of one step of a chain, for candidates of the subgoals on both sides.

    Parameters
    ----------
    start : mapping of str
        The start variables x, y, yaw, v, w, vy, if no candidate changes them.
    goal, free : Goal, sequence of str
        The subgoal that the step leads to, and the names of its free variables.
    changed : callable, optional
        Returns the start variables for candidates of the subgoal before.
    """

    def __init__(
        self,
        start: Mapping[str, float],
        goal: Goal,
        free: Sequence[str],
        changed: Callable[[FloatArray], Mapping[str, Any]] | None = None,
    ) -> None:
        self.names = (*DIRECT_VARIABLES, *map(direct_name, sorted(goal.values)))
        own = {direct_name(name): value for name, value in goal_values(goal).items()}
        fixed = {**start, **own, "hold": float(goal.point is Point.HOLD)}
        self._fixed = np.array([fixed[name] for name in self.names], dtype=float)
        self._row = {name: row for row, name in enumerate(self.names)}
        self._free = [direct_name(name) for name in free]
        self._changed = changed

    def starting(
        self,
        start: Mapping[str, float],
        changed: Callable[[FloatArray], Mapping[str, Any]] | None,
    ) -> StepRows:
        """Return the variables of a step to the same subgoal that starts elsewhere."""
        other = copy.copy(self)
        other._fixed = self._fixed.copy()
        for name, value in start.items():
            other._fixed[self._row[name]] = value
        other._changed = changed
        return other

    def values(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the direct variables, shape (names, ...), for candidates (..., k), broadcast.

        They are of the subgoals before and after the step; those that change no variable count as
        one.
        """
        columns = {name: after[..., column] for column, name in enumerate(self._free)}
        if self._changed is not None:
            columns.update(self._changed(before))
        shape = np.broadcast(*columns.values()).shape
        table = np.empty((len(self.names), *shape))
        table.T[:] = self._fixed
        for name, values in columns.items():
            table[self._row[name]] = values
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
    rows = []
    start = _present(world)
    changed = None
    place = world.robot.pose[:2]
    stays = any(not call.top.arrives for call in chain.calls[:-1])
    for call, free in zip(chain.calls, names, strict=True):
        rows.append(StepRows(start, call.goal, free, changed))
        if stays:
            world = projected(world, call, robot)
        if call.top.arrives:
            goal = call.goal
            model = models[call.top.action]
            arrival = model.arrival if goal.point is Point.AXLE else None
            bearing = arrival_heading(place, goal.pose, robot)
            takeover = takeover_of(call.top, model, robot)
            start = _Subgoal(goal, (), robot, arrival, bearing, takeover).start(np.zeros(0))
            subgoal = _Subgoal(goal, free, robot, arrival, bearing, takeover)
            changed = subgoal.start if free else None
            there = start if call.passing else columns_after(goal_values(goal), goal.point, robot)
            place = (float(there["x"]), float(there["y"]))
        else:  # the robot is where the post-condition puts it
            start = _present(world)
            changed = None
            place = world.robot.pose[:2]
    return rows


def leg_rows(
    world: World,
    chain: TopChain,
    robot: Robot,
    names: Sequence[Sequence[str]],
    legs: Sequence[tuple[int, int]],
    models: Mapping[str, PredictsPerformance],
) -> Sequence[StepRows]:
    """Return the direct variables of legs from one call of `chain` (-1: the start) to another.

    A leg may lead to a call that does not follow in the chain. It starts exactly at the goal, as
    the direction in which the robot came there is unknown. Where it passes the goal, that is the
    goal's heading. After a call that does not arrive at its
    goal, the robot is where it is in the order of the chain.
    """
    calls = chain.calls
    starts: list[Mapping[str, Any]] = [_present(world)]
    changes: list[Callable[[FloatArray], Mapping[str, Any]] | None] = [None]
    for call, free in zip(calls, names, strict=True):
        world = projected(world, call, robot)
        takeover = takeover_of(call.top, models[call.top.action], robot)
        exact = _Subgoal(call.goal, free, robot, None, None, takeover)
        starts.append(
            _Subgoal(call.goal, (), robot, None, None, takeover).start(np.zeros(0))
            if call.top.arrives
            else _present(world)
        )
        changes.append(exact.start if call.top.arrives and free else None)
    to_call = [
        StepRows(starts[0], call.goal, free) for call, free in zip(calls, names, strict=True)
    ]
    return _LegRows(to_call, starts, changes, legs)


@dataclass(frozen=True, slots=True, eq=False)
class _LegRows(Sequence[StepRows]):
    """The rows of many legs, each made when it is needed: a search may end before."""

    to_call: Sequence[StepRows]
    starts: Sequence[Mapping[str, float]]
    changes: Sequence[Callable[[FloatArray], Mapping[str, Any]] | None]
    legs: Sequence[tuple[int, int]]

    def __len__(self) -> int:
        return len(self.legs)

    def __getitem__(self, number: Any) -> Any:
        origin, end = self.legs[number]
        return self.to_call[end].starting(self.starts[origin + 1], self.changes[origin + 1])


def _present(world: World) -> dict[str, float]:
    """Return the start variables of the robot's state."""
    state = world.robot
    return {**state.pose._asdict(), "v": state.vx, "w": state.w, "vy": state.vy}


def chain_situations(
    world: World,
    chain: TopChain,
    robot: Robot,
    models: Mapping[str, PredictsPerformance],
) -> list[DirectTable]:
    """Return the direct variables of each action of `chain` with its own values."""
    rows = step_rows(world, chain, robot, [()] * len(chain.calls), models)
    no_candidate = np.zeros(0)
    tables = [step.values(no_candidate, no_candidate) for step in rows]
    return [
        DirectTable(step.names, table[:, None]) for step, table in zip(rows, tables, strict=True)
    ]


# The prediction


@dataclass(frozen=True, slots=True)
class ChainPrediction:
    """Predicted performance of one chain.

    Attributes
    ----------
    actions : tuple of mapping
        For each action the predicted fields of `REPORTED`, as in `Prediction`, and those of the
        objective. Fields that the model does not predict are left out.
    cost : float
        The objective summed over the actions.
    error : float
        What the models may be wrong by in the summed duration, in s: the root mean square.
    held_up : tuple of HeldUp
        How often the drives of the actions are held up, and how long.
    """

    actions: tuple[Mapping[str, float], ...]
    cost: float
    error: float = 0.0
    held_up: tuple[HeldUp, ...] = ()

    @property
    def duration(self) -> float:
        """Sum of the durations in s."""
        return sum(action["duration"] for action in self.actions)

    @property
    def delay(self) -> float:
        """Expected delay in s by being held up, where that depends on the situation."""
        return sum(action.get("delay", 0.0) for action in self.actions)

    @property
    def spread(self) -> float:
        """Standard deviation in s of the summed duration: of single runs, and of the models.

        Models whose errors are unknown count as exact.
        """
        error = self.error if math.isfinite(self.error) else 0.0
        return math.hypot(error, *(action.get("noise", 0.0) for action in self.actions))

    @property
    def bound(self) -> float:
        """What nine of ten runs take at most, in s; NaN as the duration."""
        if math.isnan(self.duration):
            return math.nan
        return bound_of_chain(self.duration, self.spread, self.held_up)


class GainError(NamedTuple):
    """The error of a predicted gain in duration.

    Attributes
    ----------
    expected : float
        By how many s the gain is expected to be greater, as similar drives show.
    deviation : float
        Standard deviation in s of what the models may be wrong by beyond that.
    """

    expected: float = 0.0
    deviation: float = 0.0


class StepModel:
    """The cost of steps, for candidates of the subgoals before and after each.

    Parameters
    ----------
    rows : sequence of StepRows
        The steps.
    calls : sequence of TopCall
        The call that each step executes.
    names : sequence of tuple of str
        The free variables of each call; candidates have a column for each.
    robot : Robot
    models : mapping
        Action name to performance model.
    objective : Objective
        What a step costs.
    """

    def __init__(
        self,
        rows: Sequence[StepRows],
        calls: Sequence[TopCall],
        names: Sequence[tuple[str, ...]],
        robot: Robot,
        *,
        models: Mapping[str, PredictsPerformance],
        objective: Objective,
    ) -> None:
        self.rows = rows
        self.calls = calls
        self.names = names
        self._robot = robot
        self._routes = routes_of(robot)
        self._actions = [call.top.action for call in calls]
        self._models = {action: models[action] for action in self._actions}
        self.objective = objective

    def step_costs(self, steps: Sequence[Pairs]) -> list[FloatArray]:
        """Return the costs of actions, see `ator_ros.refinement.search.StepCosts`."""
        tables = [(index, self.rows[index].values(before, after)) for index, before, after in steps]
        predicted, *_ = self._predicted(tables, ())
        costs = [step["cost"] for step in predicted]
        for place, (index, table) in enumerate(tables):
            if self._routes is not None and {"x", "y"} & set(self.names[index]):
                has_room = self._routes.clearance(table[XG], table[YG]) >= self._robot.reach
                costs[place] = np.where(has_room, costs[place], np.inf)
        return costs

    def _predicted(
        self,
        tables: Sequence[tuple[int, FloatArray]],
        reported: tuple[str, ...],
        signs: FloatArray | None = None,
    ) -> tuple[list[dict[str, FloatArray]], FloatArray, FloatArray]:
        """Return the cost and the reported fields for each table, in its shape.

        With the signs (..., n) of the tables in sums of their durations, also the expected errors
        (...) of the sums in s, and their variances in s².
        """
        predicted = [{"cost": np.zeros(table.shape[1:])} for _, table in tables]
        fields = tuple(dict.fromkeys(reported + self.objective.needs))
        error = variance = np.zeros(signs.shape[:-1] if signs is not None else ())
        actions = [self._actions[index] for index, _ in tables]
        for action in dict.fromkeys(actions):
            model = self._models[action]
            # One prediction for all steps of a model takes hardly longer than for one step.
            places = [place for place, other in enumerate(actions) if other == action]
            names = self.rows[tables[places[0]][0]].names
            parts = [tables[place][1].reshape(len(names), -1) for place in places]
            direct = DirectTable(names, np.concatenate(parts, axis=1))
            with np.errstate(all="ignore"):
                prediction = model.predict(
                    direct, fields, None if signs is None else signs[..., places]
                )
            if signs is not None:
                error = error + prediction.error_of_sum[0]
                variance = variance + prediction.error_of_sum[1]
            columns = {name: getattr(prediction, name, None) for name in reported}
            columns["cost"] = np.fmin(self.objective.cost(prediction), np.inf)  # NaN: infinite
            known = {name: values for name, values in columns.items() if values is not None}
            last = 0
            for place, part in zip(places, parts, strict=True):
                first = last
                last = last + part.shape[1]
                shape = tables[place][1].shape[1:]
                predicted[place] = {
                    name: values[first:last].reshape(shape) for name, values in known.items()
                }
        return predicted, error, variance


class ChainModel(StepModel):
    """The cost of the steps of one chain, from one state, for candidates of its free variables.

    `given` are the chain's own values of the free variables of each subgoal, shapes (k,).

    Parameters
    ----------
    world, chain, robot
        The request.
    models, objective
        As for `StepModel`.
    names : sequence of tuple of str, one per subgoal
        The free variables; candidates have a column for each.
    reference : ChainModel, optional
        The model of the calls in another order, with whose predictions `compare` compares.
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
        reference: ChainModel | None = None,
    ) -> None:
        rows = step_rows(world, chain, robot, names, models)
        calls = chain.calls
        self._reference = 0  # index of its first step
        if reference is not None:
            self._reference = len(rows)
            rows = [*rows, *reference.rows]
            calls = (*calls, *reference.calls)
        super().__init__(rows, calls, names, robot, models=models, objective=objective)
        self.given = values_of(chain, names)

    def costs_of_step(self, index: int) -> StepCosts:
        """Return a function for the costs of one action alone, whatever the number of the step."""
        return lambda steps: self.step_costs([(index, before, after) for _, before, after in steps])

    def predict(self) -> ChainPrediction:
        """Return the prediction for the chain's own values.

        Its cost is infinite if that of a step is NaN.
        """
        tables = self._tables(self.given)
        steps, error, variance = self._predicted(tables, REPORTED, np.ones(len(tables)))
        return _summed(steps, _root(error, variance), self._held_up[: len(steps)])

    def compare(
        self, before: Sequence[FloatArray], after: Sequence[FloatArray]
    ) -> tuple[ChainPrediction, ChainPrediction, GainError]:
        """Return the predictions of two chains, and the error of the second's predicted gain.

        `before` are values in the order of the reference, `after` in that of the chain. The error
        is less uncertain than that of either chain, as both are alike in similar situations.
        """
        count = len(before)
        tables = self._tables(before, self._reference) + self._tables(after)
        first = np.repeat((1.0, 0.0), count)
        second = 1.0 - first
        signs = np.stack([first, second, first - second])
        steps, errors, variances = self._predicted(tables, REPORTED, signs)
        held_up = self._held_up
        of_first = _root(errors[0], variances[0])
        of_second = _root(errors[1], variances[1])
        return (
            _summed(steps[:count], of_first, held_up[-count:]),
            _summed(steps[count:], of_second, held_up[:count]),
            GainError(float(errors[2]), math.sqrt(variances[2])),
        )

    @property
    def _held_up(self) -> tuple[HeldUp, ...]:
        """How often the drives of each step are held up."""
        models = (self._models[action] for action in self._actions)
        return tuple(getattr(model, "held_up", NOT_HELD_UP) for model in models)

    def _tables(self, values: Sequence[FloatArray], first: int = 0) -> list[tuple[int, FloatArray]]:
        """Return each step's index and direct variables, for values (k,) of each subgoal."""
        pairs = itertools.pairwise((np.zeros(0), *values))
        return [(index, self.rows[index].values(*pair)) for index, pair in enumerate(pairs, first)]


def values_of(chain: TopChain, names: Sequence[Sequence[str]]) -> list[FloatArray]:
    """Return the chain's own values of the goal variables with these names, shapes (k,)."""
    found = []
    for call, own in zip(chain.calls, names, strict=True):
        values = goal_values(call.goal)
        found.append(np.array([values[name] for name in own], dtype=float))
    return found


def _root(error: FloatArray, variance: FloatArray) -> float:
    """Return the root mean square in s of an error with this expected value and variance."""
    return math.sqrt(error**2 + variance)


def _summed(
    steps: Sequence[Mapping[str, FloatArray]], error: float, held_up: tuple[HeldUp, ...]
) -> ChainPrediction:
    """Return the prediction of a chain from those of its steps, and the error of the models."""
    actions = tuple(
        {name: float(value) for name, value in step.items() if name != "cost"} for step in steps
    )
    cost = float(np.sum([step["cost"] for step in steps]))
    pairs = zip(held_up, actions, strict=True)
    of_steps = tuple(each.where_expected(action.get("delay")) for each, action in pairs)
    return ChainPrediction(actions, cost, error, of_steps)


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
