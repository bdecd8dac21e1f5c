"""What the parts of `bench` measure in one case, beside the limits that it should keep.

Times end in the unit; `limit_NAME` is the limit of NAME, and `met` tells whether all of a row are kept.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SimulationSpeed:
    """Simulated seconds per second, and the cost over the bare loop of Bullet's steps."""

    times_real_time: float
    limit_times_real_time: float
    over_bare_loop: float
    limit_over_bare_loop: float
    met: bool | None = None


@dataclass(frozen=True)
class RefinementTime:
    """Times of one refinement in the quietest round, and the median of the slowest one."""

    median_ms: float
    p99_ms: float
    slowest_median_ms: float
    limit_ms: float | None = None
    met: bool | None = None


@dataclass(frozen=True)
class LongChainTime:
    """The least time of refining a long chain, and for each of its steps."""

    least_ms: float
    least_ms_per_step: float


@dataclass(frozen=True)
class PlanTime:
    """Times to build the chains for a goal, over `requests` situations, and the most chains found."""

    requests: int
    median_ms: float
    p99_ms: float
    limit_ms: float
    most_chains: int
    met: bool | None = None


@dataclass(frozen=True)
class ServiceTime:
    """Round trips of a service; `ratio` is the median over that of an empty service."""

    median_ms: float
    p99_ms: float
    ratio: float


@dataclass(frozen=True)
class RoundTrip:
    """As `ServiceTime` over `requests` refinements, with the growth of the node's memory."""

    requests: int
    median_ms: float
    p99_ms: float
    ratio: float
    limit_ratio: float
    limit_p99_ms: float
    memory_growth_mib: float
    met: bool | None = None


@dataclass(frozen=True)
class DelayedTrip:
    """As `ServiceTime` beside a client that asks for the worst; the delay is against none beside."""

    requests: int
    median_ms: float
    p99_ms: float
    ratio: float
    max_ms: float
    p99_delay_ms: float
    limit_p99_delay_ms: float
    met: bool | None = None


@dataclass(frozen=True)
class CollectionTime:
    """Time per episode with one process and with two workers, and what a whole collection takes."""

    episodes: int
    one_process_s: float
    two_workers_s: float
    times_one_process: float
    limit_times_one_process: float
    start_s: float
    collection_s: float
    limit_collection_s: float
    met: bool | None = None


@dataclass(frozen=True, kw_only=True)
class MeasuredLearner:
    """Time and errors of one learner; what it does not tell is None."""

    fit_s: float
    predict_ms: float | None = None
    rmse_s: float
    mae_s: float
    leaves: int | None = None
    version: str | None = None


@dataclass(frozen=True)
class NotRun:
    """Why a learner could not run."""

    not_run: str


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Our model tree beside the others, over `rows` to learn from and `fresh_rows` to measure on.

    Without another model tree, or with too few rows, a figure and its limit are None.
    """

    rmse_over_best_ceiling: float
    fit_s: float
    predict_ms: float
    rmse_over_best_model_tree: float | None = None
    times_faster_fit: float | None = None
    limit_rmse_over_best_ceiling: float
    limit_fit_s: float
    limit_predict_ms: float
    limit_rmse_over_best_model_tree: float | None = None
    limit_times_faster_fit: float | None = None
    fit_75000_rows_s: float | None = None
    limit_fit_75000_rows_s: float | None = None
    rows: int
    fresh_rows: int
    met: bool | None = None
