"""The predicted performance of a whole chain as a function of its free variables (paper, section 4.3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.geometry import FloatArray
from ator_ros.performance.direct import DirectTable
from ator_ros.refinement.candidates import place_of
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.free_variables import FreeVariable, PredictsPerformance, names_of
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.projection import step_rows
from ator_ros.refinement.slices import Slices, completed
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

Memory = dict[tuple[Any, ...], Any]

#: Predicted for every action regardless of the objective: for reports and calibration.
REPORTED = ("duration", "spread", "success", "accuracy", "dist", "ideal")


@dataclass(frozen=True, slots=True)
class ChainPrediction:
    """Predicted performance of one chain.

    Attributes
    ----------
    actions : tuple of mapping
        For each action the predicted fields: duration (s), spread (s), success (probability), accuracy (m),
        dist (m) and ideal (s) as in `Prediction`, and what else the objective needs; a field that the model
        does not predict is left out, and all are for an action without a model.
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
    """What was predicted of all steps of one action, as the chain has them: each step's row, the costs."""

    rows: Mapping[int, int]
    prediction: Any
    cost: FloatArray


class _Searched(NamedTuple):
    """The candidates (n or 1, k) on both sides of a step, what was predicted for them, and its cost (n,)."""

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
    free : sequence of FreeVariable
        The variables that candidates give, in the order of each subgoal.
    objective : Objective
        What a step costs.
    memory : dict, optional
        Predictions by situation, shared by the models of one request: what one has predicted for a grid of
        candidates, another that asks for the same grid need not.
    """

    def __init__(
        self,
        world: World,
        chain: TopChain,
        robot: Robot,
        *,
        models: Mapping[str, PredictsPerformance],
        free: Sequence[FreeVariable],
        objective: Objective,
        memory: Memory | None = None,
    ) -> None:
        self.names = names_of(chain, free)
        self._rows = step_rows(world, chain, robot, self.names)
        self._calls = chain.calls
        self._models = [models.get(call.top.action) for call in chain.calls]
        self._objective = objective
        self._fields = tuple(dict.fromkeys(REPORTED + objective.needs))
        #: What the chain itself holds, shapes (k,).
        self.given = [_values(call.goal, names) for call, names in zip(chain.calls, self.names, strict=True)]
        self._given = [values.tolist() for values in self.given]
        self._as_given: dict[str, _Alone] = {}
        self._searched: list[list[_Searched]] = [[] for _ in chain.calls]
        self._memory = memory

    def step_cost(self, index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the cost of one action, shape (n,), as `ator_ros.refinement.paths.StepCost` says."""
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
        return completed(self.predicting(chain))

    def predicting(self, chain: Sequence[FloatArray]) -> Slices[ChainPrediction]:
        """Predict as `predict` does, in slices; it takes no longer when time is not up."""
        previous, actions, cost = np.zeros(0), [], 0.0
        for index, values in enumerate(chain):
            yield
            action, step_cost = self._predict_one(index, previous, values)
            actions.append(action)
            cost += step_cost
            previous = values
        return ChainPrediction(tuple(actions), cost)

    def _predict_one(
        self, index: int, before: FloatArray, after: FloatArray
    ) -> tuple[Mapping[str, float], float]:
        """Return the predicted fields of one action and its cost, for one candidate on both sides."""
        model = self._models[index]
        if model is None:
            return {}, 0.0
        prediction, costs, row = self._known(index, model, before, after)
        named = {name: getattr(prediction, name, None) for name in self._fields}
        fields = {name: _row(column, row) for name, column in named.items() if column is not None}
        return fields, _row(costs, row)

    def _known(
        self, index: int, model: PredictsPerformance, before: FloatArray, after: FloatArray
    ) -> tuple[Any, FloatArray, int]:
        """Return what holds one candidate, and its row there: what was searched is not predicted again."""
        for searched in reversed(self._searched[index]):
            row = place_of((searched.before, before), (searched.after, after))
            if row is not None:
                return searched.prediction, searched.cost, row
        if self._is_given(index, before, after):
            alone = self._step_as_given(index, model)
            return alone.prediction, alone.cost, alone.rows[index]
        self.step_cost(index, before[None, :], after[None, :])
        last = self._searched[index][-1]
        return last.prediction, last.cost, 0

    def _is_given(self, index: int, before: FloatArray, after: FloatArray) -> bool:
        """Return whether both sides of a step, shapes (k,), are as in the chain itself."""
        return after.tolist() == self._given[index] and (
            index == 0 or before.tolist() == self._given[index - 1]
        )

    def _step_as_given(self, index: int, model: PredictsPerformance) -> _Alone:
        """Predict a step of the chain as it is, and with it all others of the same action.

        That costs hardly more than one step, and of long chains whose time is up most steps stay as they are.
        """
        action = self._calls[index].top.action
        if action not in self._as_given:
            steps = [step for step, call in enumerate(self._calls) if call.top.action == action]
            tables = [self._direct_as_given(step) for step in steps]
            direct = DirectTable(tables[0].names, np.hstack([each.table for each in tables]))
            with np.errstate(all="ignore"):
                prediction = self._checked(index, model.predict(direct, self._fields))
                cost = self._cost(prediction)
            rows = {step: row for row, step in enumerate(steps)}
            self._as_given[action] = _Alone(rows, prediction, cost)
        return self._as_given[action]

    def _direct_as_given(self, index: int) -> DirectTable:
        before = self.given[index - 1] if index else np.zeros(0)
        return self._rows[index].table(before[None, :], self.given[index][None, :])

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
    """Return what the models predict of `chain` as it is, from the state `world`.

    Parameters
    ----------
    models : mapping
        Action name to performance model, one for each action of the chain.
    objective : Objective, optional
        What the cost is of; by default the duration.
    """
    objective = objective if objective is not None else Objective()
    model = ChainModel(world, chain, robot, models=models, free=(), objective=objective)
    return model.predict([np.zeros(0)] * len(chain.calls))


def _values(goal: Goal, names: Sequence[str]) -> FloatArray:
    """Return the goal variables `names` of a subgoal, shape (k,)."""
    values = goal_values(goal)
    return np.array([values[name] for name in names], dtype=float)


def _row(value: Any, row: int) -> float:
    """Return one row of a prediction that is the same for all chains when it has but one."""
    return float(value[row if len(value) > 1 else 0])
