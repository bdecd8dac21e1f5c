"""The performance model of an action: maps situations to measures (paper, section 2.1)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.direct import Direct
from ator_ros.bases.interface import Driving
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import ANGLE_BETWEEN, DIST, RESTS, Geometry
from ator_ros.performance.error_process import ErrorProcess, errors_of_sums
from ator_ros.performance.features import (
    PASSING_FEATURES,
    Feature,
    declared_by,
    derived_from,
    names_of,
)
from ator_ros.performance.held_up import NOT_HELD_UP, HeldUp
from ator_ros.performance.tree.nodes import ModelTree, RuleWriter
from ator_ros.schema import Within
from ator_ros.world.state import CONTROL_PERIOD

MEASURES: dict[str, str] = {
    "duration": "s",
    "success": "",
    "accuracy": "m",
    "heading": "rad",
    "held_up": "",
}
"""What is predicted, with units.

The time, the probability of success, the errors at the end, and the probability to be held up.
"""


@dataclass(frozen=True)
class Prediction:
    """Predicted performance of n situations: arrays of shape (n,), None if not requested.

    Attributes
    ----------
    duration, spread : ndarray or None
        Expected time in s, and the standard deviation in s of actual times about it.
    noise : ndarray or None
        The part of the spread in s by which single runs of the same situation differ; the rest is
        what the model may be wrong by. It is predicted with the spread.
    success : ndarray or None
        Probability.
    accuracy, heading : ndarray or None
        Expected errors at the end in m and rad.
    error_of_sum : tuple of ndarray or None
        Expected errors in s of signed sums of the durations, and their variances in s².
    bound : ndarray or None
        What nine of ten drives take at most in s, those included that are held up. It is predicted
        with the spread.
    delay : ndarray or None
        Expected delay in s by being held up, if it depends on the situation. It is predicted with
        the duration, which does not contain it.
    """

    duration: FloatArray | None = None
    spread: FloatArray | None = None
    noise: FloatArray | None = None
    success: FloatArray | None = None
    accuracy: FloatArray | None = None
    heading: FloatArray | None = None
    error_of_sum: tuple[FloatArray, FloatArray] | None = None
    bound: FloatArray | None = None
    delay: FloatArray | None = None


@dataclass(frozen=True)
class AtGoal:
    """How long an action takes for a robot at rest that is at its goal already.

    Attributes
    ----------
    dist, angle : float
        Up to which distance (m) and angle (rad) to the goal it is that fast.
    duration, spread : float
        Mean and standard deviation in s.
    """

    # Beyond 1 m or 1 rad a robot drives or turns to the goal. No server takes a day to respond.
    dist: Annotated[float, Within(0.0, 1.0)] = 0.01
    angle: Annotated[float, Within(0.0, 1.0)] = 0.02
    duration: Annotated[float, Within(0.0, 86_400.0)] = CONTROL_PERIOD
    spread: Annotated[float, Within(0.0, 86_400.0)] = CONTROL_PERIOD


UNOBSERVED = AtGoal()
"""Assumption for an action of which no run at its goal was observed: it ends within a tick."""


@dataclass(frozen=True)
class Arrival:
    """How far short of its goals an action usually stops.

    Attributes
    ----------
    dist, angle : float
        Distance in m that is left on the line from the start to the goal, and angle in rad that is
        left of the turn to the goal's heading.
    """

    dist: Annotated[float, Within(0.0)]
    angle: Annotated[float, Within(0.0)]


@dataclass(frozen=True)
class Passing:
    """How an action passes its goals, when the next one takes over before.

    Attributes
    ----------
    nearer : float
        By how much in m the robot nearly always comes nearer to the goal after that; 0 if unknown.
    speed : float
        Its usual speed in m/s at that time.
    """

    nearer: Annotated[float, Within(0.0)]
    speed: Annotated[float, Within(0.0)]


@dataclass(frozen=True, eq=False)
class PerformanceModel:
    """Model trees that predict how an action will perform.

    Attributes
    ----------
    robot : Robot
        The robot whose limits the features use.
    trees : mapping of str to ModelTree
        A tree for each measure that was learned. "duration" is always among them, "held_up" if
        some situations were held up more often than others.
    features : mapping of str to Feature
        By name: those of the trees, and perhaps others.
    metadata : mapping
        Where the model comes from and how accurate it is; see `model_file`.
    driving : Driving or None
        How the action was observed to drive; None where no feature needs it.
    at_goal : AtGoal or None
        How long it takes at its goal; None where the tree predicts that too.
    errors : ErrorProcess or None
        Its errors on episodes that it was not learned from; None: any error is possible.
    arrival : Arrival or None
        Where it ends, if the robot stands at its start and end; None: at the goal.
    passing : Passing or None
        How it passes its goals; None: not at all, or unknown.
    held_up : HeldUp
        How often, and how long, its drives were held up; trees predict the others.
    """

    action: str
    robot: Robot
    trees: Mapping[str, ModelTree]
    features: Mapping[str, Feature]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    driving: Driving | None = None
    at_goal: AtGoal | None = UNOBSERVED
    errors: ErrorProcess | None = None
    arrival: Arrival | None = None
    held_up: HeldUp = NOT_HELD_UP
    passing: Passing | None = None

    @cached_property
    def used_features(self) -> tuple[str, ...]:
        """The features that predict the duration."""
        return self.trees["duration"].used_features()

    @cached_property
    def used_variables(self) -> frozenset[str]:
        """The direct variables that any prediction derives from (paper, section 4.2)."""
        trees = self.trees.values()
        return derived_from(self.features[name] for tree in trees for name in tree.used_features())

    @cached_property
    def declared_variables(self) -> tuple[str, ...]:
        """The goal variables declared by the action that predictions need, sorted."""
        names = {name for tree in self.trees.values() for name in tree.names}
        names |= self.features.keys() & names_of(PASSING_FEATURES)  # they decide on the heading
        return declared_by(self.features[name] for name in names)

    @cached_property
    def experience(self) -> Mapping[str, tuple[float, float]]:
        """Range of each of the `ator_ros.performance.training.start_ranges`, if known."""
        ranges = self.metadata.get("training", {}).get("starts", {})
        return {name: (float(low), float(high)) for name, (low, high) in ranges.items()}

    @property
    def is_learned(self) -> bool:
        """Whether it was learned from drives; others predict path times."""
        training = self.metadata.get("training", {})
        return bool(training.get("episodes") != 0)

    @property
    def not_varied(self) -> tuple[str, ...]:
        """The features that the drives hardly varied, so that they show no slope along them."""
        return self.errors.not_varied if self.errors is not None else ()

    def predict(
        self,
        direct: Direct,
        measures: tuple[str, ...] = ("duration",),
        signs: FloatArray | None = None,
    ) -> Prediction:
        """Predict the performance of n situations at once.

        Parameters
        ----------
        direct : mapping
            Direct variables, numbers or arrays of shape (n,), see `direct_table`.
        measures : tuple of str
            Which fields of the prediction to compute; those that were not learned stay None.
        signs : ndarray, shape (..., n), optional
            Signs of the durations in sums, whose errors are then predicted as well.
        """
        geometry = self._geometry(direct)
        error, deviations = self._errors(geometry, signs, with_spread="spread" in measures)
        fields: dict[str, FloatArray] = {}
        for name, tree in self.trees.items():
            if name == "duration":
                if "duration" in measures or "spread" in measures:
                    fields |= self._durations(geometry, deviations)
            elif name == "held_up":
                shares = self._values(geometry, tree, 1.0)
                fields["delay"] = self.held_up.delay * shares
            elif name in measures:
                highest = 1.0 if name == "success" else math.inf
                fields[name] = self._values(geometry, tree, highest)
        bound = None
        if "spread" in measures:
            bound = self.held_up.bound(fields["duration"], fields["spread"], fields.get("delay"))
        return Prediction(**fields, error_of_sum=error, bound=bound)

    def _errors(
        self, geometry: Geometry, signs: FloatArray | None, *, with_spread: bool
    ) -> tuple[tuple[FloatArray, FloatArray] | None, FloatArray | None]:
        """Return the errors of sums with these signs, and of single durations, if wanted."""
        if signs is None and not with_spread:
            return None, None
        if self.errors is None:
            if signs is None:
                return None, None
            nothing = np.zeros(signs.shape[:-1])
            return (nothing, nothing + math.inf), None
        rows = self._rows(geometry, self.errors.features).T
        if signs is None:
            return None, self.errors.deviations(rows)
        expected, covariances = self.errors.joint(rows)
        squares = np.maximum(covariances.diagonal(), 0.0) + np.square(expected)
        return errors_of_sums(expected, covariances, signs), np.sqrt(squares)

    def _durations(
        self, geometry: Geometry, deviations: FloatArray | None
    ) -> dict[str, FloatArray]:
        """Return durations, within the bounds of their leaves, noise, and spread with deviations.

        `deviations` (n,) are what the model may be wrong by, in s; None: nothing.
        """
        tree = self.trees["duration"]
        duration, leaf = tree.evaluate(self._rows(geometry, tree.names))
        if self.errors is not None and self.errors.corrects:
            rows = self._rows(geometry, self.errors.features).T
            duration = np.maximum(duration + self.errors.correction(rows), 0.0)
        noise = tree.spread.take(leaf)
        spread = noise.copy() if deviations is None else np.hypot(noise, deviations)
        if self.at_goal is not None:
            place = (self.at_goal.dist, self.at_goal.angle)
            result = np.array((self.at_goal.duration, self.at_goal.spread, self.at_goal.spread))
            _write_at_goal(geometry.rows, place, result, (duration, noise, spread))
        return {"duration": duration, "noise": noise, "spread": spread}

    def _values(self, geometry: Geometry, tree: ModelTree, highest: float) -> FloatArray:
        """Return the predictions of a tree, from 0 to `highest`."""
        if tree.constant is not None:
            return np.full(len(geometry.dist), min(max(tree.constant, 0.0), highest))
        return tree.evaluate(self._rows(geometry, tree.names))[0].clip(0.0, highest)

    def rules(self, measure: str = "duration") -> str:
        """Return the rules of a measure in the paper's form, one a line, after what they share."""
        rules = self._writer(measure).rules()
        if measure == "duration" and self.errors is not None and self.errors.corrects:
            rules = f"{rules}\n{self.errors.correction_rule()}"
        if self.driving is None:
            return rules
        names = {*self.driving.quantities}
        if names.isdisjoint(self.trees[measure].names):
            return rules
        return f"{self.driving.rule()}\n{rules}"

    def explain(self, direct: Direct) -> str:
        """Return the rule that predicts the duration of a situation, and what its terms add."""
        rows = self._rows(self._geometry(direct), self.trees["duration"].names)
        return self._writer("duration").explanation(rows[:, 0])

    def _geometry(self, direct: Direct) -> Geometry:
        return Geometry(direct, self.robot, self.driving, self.declared_variables)

    def _rows(self, geometry: Geometry, names: Iterable[str]) -> FloatArray:
        features = [self.features[name] for name in names]
        numbers = [feature.row for feature in features if feature.row is not None]
        if len(numbers) == len(features):
            return geometry.selected(numbers)  # faster than one by one
        columns = [geometry.once(feature.compute) for feature in features]
        return np.concatenate(columns).reshape(len(columns), -1)  # much faster than np.stack

    def _writer(self, measure: str) -> RuleWriter:
        tree = self.trees[measure]
        units = {name: self.features[name].unit for name in tree.names}
        target = "time" if measure == "duration" else measure
        return RuleWriter(tree, units, target=target, target_unit=MEASURES[measure])


@compiled
def _write_at_goal(
    rows: FloatArray,
    place: tuple[float, float],
    result: FloatArray,
    written: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Write duration, noise, spread of robots at rest within a distance (m), angle of the goal."""
    for at in range(rows.shape[1]):
        if (
            rows[RESTS, at] > 0.5
            and rows[DIST, at] <= place[0]
            and rows[ANGLE_BETWEEN, at] <= place[1]
        ):
            for number in range(3):
                written[number][at] = result[number]
