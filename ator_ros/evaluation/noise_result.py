"""What `noise` finds out: how often chains succeed under each condition of sensing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ator_ros.formats import Format
from ator_ros.simulation.sensors import SensorConfig

_SIGHT = ("velocity_noise", "noise", "delay", "dropouts")


def _with_objects(data: dict[str, Any]) -> dict[str, Any]:
    """Put the errors of sight of version 1, as in OBJECT_noise, under the object's name."""
    if not isinstance(data.get("sensors"), Mapping):
        return data  # which the reader then refuses
    sensors = dict(data["sensors"])
    objects = dict(sensors.pop("objects", {}))
    for key in tuple(sensors):
        error = next((each for each in _SIGHT if key.endswith(f"_{each}")), None)
        if error is not None:
            name = key.removesuffix(f"_{error}")
            objects[name] = {**objects.get(name, {}), error: sensors.pop(key)}
    return {**data, "sensors": {**sensors, "objects": objects}}


FORMAT = Format("ator_ros noise", 2, "measurement of the effect of sensors", {1: _with_objects})
"""Version 1 had no objects by name."""


@dataclass(frozen=True)
class ConditionResult:
    """The runs of many situations under one condition.

    Attributes
    ----------
    condition : str
        Its name.
    latency_s, foreseen_s : float
        Of the states, and by the executor, in s.
    success_percent : float
        Share of the runs that succeeded.
    points_below_truth : float
        Percentage points by which fewer succeeded than with true states.
    points_below_truth_ci95 : tuple of float
        Its 95 % bootstrap interval over situations.
    within_limit : bool
        Whether they are at most the result's `limit_points`.
    mean_duration_s : float or None
        Of the successes, in s; None without any.
    error_median_m, error_p95_m : float or None
        Distance from the last goal, by the truth, in m; None without successes.
    failures : mapping of str to int
        What failed and how often.
    """

    condition: str
    latency_s: float
    foreseen_s: float
    success_percent: float
    points_below_truth: float
    points_below_truth_ci95: tuple[float, ...]
    within_limit: bool
    mean_duration_s: float | None
    error_median_m: float | None
    error_p95_m: float | None
    failures: dict[str, int]


@dataclass(frozen=True)
class NoiseResult:
    """The content of the file that `noise` writes.

    Attributes
    ----------
    command : str
        The command that wrote it.
    seed, situations : int
        Seed and number of the situations of each chain.
    policy, action_set, robot_digest : str
        What chose the chains, which actions executed them, and on which robot.
    sensors : SensorConfig
        The errors of a real robot's sensors; a condition has all of them or some.
    limit_points : float
        Percentage points by which the success rate may be below that with true states.
    chains : mapping of str to tuple of ConditionResult
        By name of the chain; the first condition is the truth.
    """

    command: str
    seed: int
    situations: int
    policy: str
    action_set: str
    robot_digest: str
    sensors: SensorConfig
    limit_points: float
    chains: dict[str, tuple[ConditionResult, ...]]
