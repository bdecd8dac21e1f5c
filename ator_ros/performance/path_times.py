"""The model of an action without drives: the time of the fastest path, and a wide spread."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.direct import Direct
from ator_ros.performance.error_process import ErrorProcess, UnknownSlope
from ator_ros.performance.features import (
    GENERAL,
    PAPER_3,
    PATHS,
    ROUTE_FEATURES,
    ROUTE_TIME,
    Feature,
    feature_table,
    suited,
)
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.prior import prior_slopes
from ator_ros.performance.tree.nodes import Hinge, ModelTree
from ator_ros.printable import listed

LEAST_DRIVES = 20
"""Least number of drives that succeeded from which a tree is learned."""
_VELOCITIES = (GENERAL["v"], GENERAL["speedg"])
_ON_ROUTE = tuple(
    feature for feature in ROUTE_FEATURES if feature.unit in ("m", "rad")
    and feature.name != "route_clearance"
)  # fmt: skip
# How durations of an action differ from those of the fastest paths, besides the slopes: by so many
# s, alike in situations whose features (m, rad, m/s) are less far apart than the length.
_SIGNAL = 2.0
_LENGTH = 1.5
_DIGITS = 4  # decimals kept of features and errors, in their units
_NOISE = 0.3  # s by which drives of equal situations differ
# The slopes deviate by so many times more than those of an action that was driven, as nothing shows
# how far below its limits a server drives. So 84 % of the drives of `tour`, the slowest server
# here, are within their 90 % intervals, 98 % of `pursuit`, and 95 and 100 % of their chains.
_WIDER = 1.75


def path_time_model(action: str, action_set: str, robot: Robot) -> PerformanceModel:
    """Return the performance model of an action of which nothing is known but its robot.

    It predicts the time of the fastest path at all limits of the base, on a map that of the route.
    The true durations may depend otherwise on lengths, turns and velocities, as `prior_slopes`
    describes, so the model has a wide spread. Its success is unknown.
    """
    time: Feature
    if robot.grid is None:
        time = PATHS[0]
        of_errors = suited((*PAPER_3, *_VELOCITIES), robot)
    else:
        time = ROUTE_TIME
        of_errors = suited((*_ON_ROUTE, *_VELOCITIES), robot)
    driving = robot.unobserved_driving()
    slopes = []
    for name, slope in prior_slopes(of_errors, robot, driving).items():
        ends = (0.0, 2.0 * math.pi) if slope.bend else None  # no turn of a path is longer
        slopes.append(UnknownSlope(name, _WIDER * slope.deviation, ends, slope.bend))
    count = len(of_errors)
    errors = ErrorProcess(
        features=tuple(feature.name for feature in of_errors),
        center=(0.0,) * count,
        scale=(1.0,) * count,
        points=(),
        errors=(),
        signal=_SIGNAL,
        noise=_NOISE,
        length=_LENGTH,
        slopes=tuple(slopes),
        corrects=True,
    )
    return PerformanceModel(
        action,
        robot,
        {"duration": _only(time)},
        {feature.name: feature for feature in (time, *of_errors)},
        {"action_set": action_set, "training": {"episodes": 0}},
        driving=driving,
        errors=errors,
    )


def corrected(
    model: PerformanceModel, direct: Direct, durations: Sequence[float]
) -> PerformanceModel:
    """Return a model of path times that n drives correct, few enough for no tree.

    Similar situations are predicted to take as much longer than their paths as the drives did. The
    spread becomes smaller where there are drives.

    Parameters
    ----------
    model : PerformanceModel
        Of `path_time_model`.
    direct : mapping
        Direct variables of the drives, arrays of shape (n,), see `direct_table`.
    durations : sequence of float
        Their durations in s.
    """
    errors = model.errors
    assert errors is not None
    features = [model.features[name] for name in errors.features]
    table = feature_table(direct, model.robot, features, model.driving)
    late = np.asarray(durations) - model.predict(direct).duration
    process = dataclasses.replace(
        errors,
        points=tuple(map(tuple, table.round(_DIGITS).tolist())),
        errors=tuple(late.round(_DIGITS).tolist()),
    )
    return dataclasses.replace(model, errors=process)


def few_drives_remark(model: PerformanceModel) -> list[str]:
    """Return a remark on the number of drives that correct path times, if it is such a model."""
    if model.errors is None or not model.errors.corrects:
        return []
    count = len(model.errors.points)
    drives = "1 drive corrects" if count == 1 else f"{count} drives correct"
    return [f"{model.action}: {drives} path times; {LEAST_DRIVES} are enough for a tree"]


def path_times_remark(actions: Iterable[str]) -> str:
    """Return a remark on the actions whose models predict path times; empty without any."""
    names = listed(tuple(actions))
    return f"path times of {names}, as no drives are known yet" if names else ""


def _only(time: Feature) -> ModelTree:
    """Return the tree of one leaf that predicts a feature, in s."""
    zero = np.zeros(1)
    return ModelTree(
        names=(time.name,),
        feature=np.zeros(1, dtype=np.intp),
        threshold=zero,
        children=np.zeros((1, 2), dtype=np.intp),
        intercept=zero,
        coefficients=np.zeros((1, 1)),
        lower=zero,
        upper=zero,
        spread=np.full(1, _NOISE),
        samples=zero,
        base=(Hinge(time.name, 0.0, 1.0),),
    )
