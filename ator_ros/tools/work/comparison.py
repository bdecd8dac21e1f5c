"""How the durations of the same chains over ROS and in the tools differ, and how those predicted do."""

from __future__ import annotations

import math
import platform
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ator_ros.evaluation.statistics import prediction_errors
from ator_ros.experience.table import library_versions
from ator_ros.formats import Format
from ator_ros.schema import structured

FORMAT = Format("ator_ros comparison", 1, "comparison of nodes and tools")
LIMIT_PERCENT = 2.0
"""Greatest allowed difference of the mean durations."""


class Compared(NamedTuple):
    """Durations in s of one chain over ROS and in the tools, failed at the time limit, and as predicted."""

    ros: float
    tools: float
    predicted: float = math.nan


@dataclass(frozen=True, kw_only=True)
class ExecutorPredictions:
    """How the executor's predictions differ from durations over ROS, of the chains that succeeded.

    Attributes
    ----------
    chains : int
        Their number.
    mean_error_s, mae_s, rmse_s : float or None
        Mean, mean absolute and root mean square error in s; None without chains.
    mean_error_ci95 : tuple of float or None
        95 % bootstrap interval of the mean error in s; None without chains.
    errors_s : tuple of float
        Predicted minus actual duration of each chain, in s.
    """

    chains: int
    mean_error_s: float | None = None
    mean_error_ci95: tuple[float, ...] | None = None
    mae_s: float | None = None
    rmse_s: float | None = None
    errors_s: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ComparisonResult:
    """The content of the file that `compare` writes.

    Attributes
    ----------
    command : str
        The command that wrote it.
    seed, situations : int
        Seed and number of the situations.
    real_time_factor : float
        Of the simulation under the nodes.
    chains, policies : tuple of str or None
        Executed in turn; None in files from before both could be chosen.
    mean_ros_s, mean_tools_s : float
        Mean durations in s.
    difference_percent, limit_percent : float
        By how much the mean is greater over ROS, and the limit of its amount.
    met : bool
        Whether the limit is kept.
    same_to_the_tick : int
        Number of chains with equal durations.
    differences_s : tuple of float
        Duration over ROS less that in the tools of each chain, in s.
    prediction : ExecutorPredictions or None
        Errors of predictions; None in files from before they were compared.
    versions : mapping of str to str
        Of Python and libraries.
    machine : str
        The system.
    """

    command: str
    seed: int
    real_time_factor: float
    chains: tuple[str, ...] | None = None
    policies: tuple[str, ...] | None = None
    situations: int
    mean_ros_s: float
    mean_tools_s: float
    difference_percent: float
    limit_percent: float
    met: bool
    same_to_the_tick: int
    differences_s: tuple[float, ...]
    prediction: ExecutorPredictions | None = None
    versions: dict[str, str]
    machine: str


def comparison(
    runs: Sequence[Compared],
    *,
    command: str,
    seed: int,
    real_time_factor: float,
    chains: Sequence[str],
    policies: Sequence[str],
) -> ComparisonResult:
    """Compare durations over ROS, those in the tools and those predicted; see `ComparisonResult`."""
    ros, tools = statistics.fmean(run.ros for run in runs), statistics.fmean(run.tools for run in runs)
    apart = [run.ros - run.tools for run in runs]
    percent = 100.0 * (ros / tools - 1.0)
    return ComparisonResult(
        command=command,
        seed=seed,
        real_time_factor=real_time_factor,
        chains=tuple(chains),
        policies=tuple(policies),
        situations=len(runs),
        mean_ros_s=round(ros, 3),
        mean_tools_s=round(tools, 3),
        difference_percent=round(percent, 3),
        limit_percent=LIMIT_PERCENT,
        met=abs(percent) <= LIMIT_PERCENT,
        same_to_the_tick=sum(abs(difference) < 1e-6 for difference in apart),
        differences_s=tuple(round(difference, 3) for difference in apart),
        prediction=_predictions(runs),
        versions=library_versions(),
        machine=platform.platform(),
    )


def _predictions(runs: Sequence[Compared]) -> ExecutorPredictions:
    known = [run for run in runs if math.isfinite(run.predicted)]
    rows = [
        {"policies": {"ros": {"duration": run.ros, "predicted": run.predicted, "success": True}}}
        for run in known
    ]
    errors = [round(run.predicted - run.ros, 3) for run in known]
    return structured({**prediction_errors(rows, "ros"), "errors_s": errors}, ExecutorPredictions)
