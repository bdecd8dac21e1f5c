"""What predictions of actions in chains miss, and predictions without it.

The models are learned from random starts. A chain that was chosen for its prediction is no random one: the
search finds the situations in which the models predict too little, mostly those in which a leaf's linear
model undercuts the time that is possible at the robot's limits. By how much actions of executed chains took
longer than predicted is therefore learned separately (`ator_ros.evaluation.calibration_learning`), and added
to what is reported. Which chain is best is decided without it, and so is whether the gate lets it pass,
unless the gate judges corrected predictions (`Gate.corrected`).
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from ator_ros.files import load, save
from ator_ros.performance.model import PerformanceModel
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.refinement.free_variables import analyze
from ator_ros.refinement.objective import Objective
from ator_ros.robot.description import Robot
from ator_ros.schema import Name, OneOf, Within
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

BEYOND = 1.0
"""Difference in s between prediction and ideal time beyond which it means nothing more."""


class PredictedStep(NamedTuple):
    """One action of a chain, as its prediction is judged.

    Attributes
    ----------
    v, speedg : float
        Speed in m/s at the start and at the goal.
    predicted, spread : float
        Its predicted duration and the standard deviation of actual ones about it, in s.
    ideal : float
        Time in s of the ideal motion; `predicted` where the model's features have none.
    dist : float
        Distance in m from the start to the destination.
    heading_open : bool
        The heading at the goal is free: it was chosen, and for this prediction.
    """

    v: float
    speedg: float
    predicted: float
    spread: float
    ideal: float
    dist: float
    heading_open: bool = False


def terms_of(step: PredictedStep) -> dict[str, float]:
    """Return what the shortfall is linear in, by name: in s, m/s and m, without unit where 0 or 1."""
    v, speedg, predicted, spread, ideal, dist, heading_open = step
    below = min(max(ideal - predicted, 0.0), BEYOND)
    return {
        "below_ideal": below,
        "below_ideal_v": below * v,
        "below_ideal_speedg": below * speedg,
        "above_ideal": min(max(predicted - ideal, 0.0), BEYOND),
        "v": v,
        "speedg": speedg,
        "predicted": predicted,
        "dist": dist,
        "heading_open": float(heading_open),
        "below_ideal_heading_open": below * heading_open,
        "spread": spread,
    }


TERMS = tuple(terms_of(PredictedStep(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
"""The names of all terms."""


_Seconds = Annotated[float, Within(-1e6, 1e6)]
"""Eleven days, longer than any action; sums of such numbers keep a resolution of 1 ns."""


@dataclass(frozen=True, slots=True)
class Shortfall:
    """By how much an action in a chain takes longer than predicted, on average: linear in `TERMS`.

    Attributes
    ----------
    constant : float
        In s.
    slopes : mapping
        Term to its coefficient, in s per unit of the term; terms that are not named count nothing.
    low, high : float
        Bounds in s of what is added.
    model : str
        Digest of the performance model whose predictions it belongs to, see `model_digest`.

    Raises
    ------
    ValueError
        `low` is above `high`.
    """

    constant: _Seconds
    slopes: Mapping[Annotated[str, OneOf(TERMS)], _Seconds]
    low: _Seconds
    high: _Seconds
    model: str

    def __post_init__(self) -> None:
        """Check the bounds."""
        if self.low > self.high:
            raise ValueError(f"expected low at most high, got {self.low:g} and {self.high:g}")

    def of(self, step: PredictedStep) -> float:
        """Return the expected shortfall of the prediction of `step` in s."""
        terms = terms_of(step)
        value = self.constant + sum(slope * terms[name] for name, slope in self.slopes.items())
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class Calibration:
    """The shortfalls of the predictions of a set of performance models.

    Attributes
    ----------
    shortfalls : mapping
        Action name to shortfall; predictions of other actions stay as they are, and so do those of other
        models than the shortfall was learned for.
    """

    shortfalls: dict[Annotated[str, Name()], Shortfall] = field(default_factory=dict)

    def matching(self, models: Mapping[str, Any]) -> Calibration:
        """Return the part that belongs to `models` (action name to performance model)."""
        items = self.shortfalls.items()
        return Calibration({name: it for name, it in items if model_digest(models.get(name)) == it.model})

    def corrected(
        self,
        prediction: ChainPrediction,
        chain: TopChain,
        world: World,
        models: Mapping[str, Any],
        robot: Robot,
        objective: Objective | None = None,
        *,
        chosen: Sequence[bool] | None = None,
    ) -> ChainPrediction:
        """Return the prediction of a chain with what it is expected to miss added.

        Parameters
        ----------
        prediction, chain, world, models, robot
            What was predicted, the chain, the state from which, the models with which, and the robot for
            which it was predicted.
        objective : Objective, optional
            What the cost is of; by default the duration.
        chosen : sequence of bool, optional
            Whether each step's heading is free, see `chosen_headings`; by default as in the chain alone.
            Parts of a chain do not show what the rest of it binds.
        """
        if not self.shortfalls:
            return prediction
        weight = (objective if objective is not None else Objective()).weights.get("duration", 0.0)
        steps = chain_steps(prediction, chain, world, models, robot, chosen)
        actions, added = [dict(action) for action in prediction.actions], 0.0
        for call, step, action in zip(chain.calls, steps, actions, strict=True):
            shortfall = self.shortfalls.get(call.top.action)
            if shortfall is not None and step is not None:
                missing = max(shortfall.of(step), -step.predicted)
                action["duration"] = step.predicted + missing
                added += missing
        return ChainPrediction(tuple(actions), prediction.cost + weight * added)


def chain_steps(
    prediction: ChainPrediction,
    chain: TopChain,
    world: World,
    models: Mapping[str, Any],
    robot: Robot,
    chosen: Sequence[bool] | None = None,
) -> list[PredictedStep | None]:
    """Return the steps of a predicted chain; the arguments are as for `Calibration.corrected`.

    A step is None where it has no model of ours or no finite prediction.
    """
    chosen = chosen_headings(chain, models, robot) if chosen is None else chosen
    speeds = [world.robot.v, *(call.goal.speed for call in chain.calls)]
    steps: list[PredictedStep | None] = []
    for v, call, action, is_chosen in zip(speeds, chain.calls, prediction.actions, chosen, strict=False):
        predicted, dist = action.get("duration", math.nan), action.get("dist", math.nan)
        ideal = action.get("ideal", predicted)
        # Squares of places that are far away overflow.
        is_finite = all(map(math.isfinite, (predicted, dist, ideal)))
        if is_finite and isinstance(models.get(call.top.action), PerformanceModel):
            spread = action.get("spread", 0.0)
            steps.append(PredictedStep(v, call.goal.speed, predicted, spread, ideal, dist, is_chosen))
        else:
            steps.append(None)
    return steps


def chosen_headings(chain: TopChain, models: Mapping[str, Any], robot: Robot) -> list[bool]:
    """Return for each step of a whole chain whether its heading is free."""
    free = {variable.subgoal for variable in analyze(chain, models, robot).free if variable.name == "yaw"}
    return [index in free for index in range(len(chain.calls))]


def model_digest(model: Any) -> str:
    """Return a short digest of what a performance model predicts durations with; empty for other models."""
    if not isinstance(model, PerformanceModel):
        return ""
    tree = model.trees["duration"]
    sha = hashlib.sha256(",".join(tree.names).encode())
    parts = (tree.feature, tree.threshold, tree.children, tree.intercept, tree.coefficients)
    for part in (*parts, tree.lower, tree.upper, tree.spread):
        sha.update(np.ascontiguousarray(part, dtype=float).tobytes())
    return sha.hexdigest()[:16]


KIND = "calibration"
CALIBRATION = "calibration.json"


def save_calibration(path: Path, calibration: Calibration, training: Mapping[str, Any]) -> None:
    """Write a calibration, with how it was learned, to `path`; atomic."""
    save(path, KIND, {**asdict(calibration), "training": dict(training)})


def load_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises
    ------
    FileError
        The file cannot be read or is no calibration; the message names file and field.
    """
    return load(path, KIND, Calibration)


def load_calibration_if_any(folder: Path) -> Calibration:
    """Read the calibration in `folder`; without one, predictions stay as they are.

    Raises
    ------
    FileError
        As in `load_calibration`.
    """
    path = folder / CALIBRATION
    return load_calibration(path) if os.path.lexists(path) else Calibration()
