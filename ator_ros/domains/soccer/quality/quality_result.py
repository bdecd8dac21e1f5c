"""What `qualify` finds out about the actions of soccer."""

from __future__ import annotations

from dataclasses import dataclass

from ator_ros.formats import Format

FORMAT = Format("ator_ros actions", 1, "measurement of actions")


@dataclass(frozen=True)
class Regularity:
    """Percentiles of the change of duration in s when the start is turned by a degree either way."""

    p50_s: float
    p95_s: float
    p99_s: float
    p100_s: float


@dataclass(frozen=True)
class OverOptimal:
    """Durations beside those of time-optimal motion.

    Attributes
    ----------
    pairs : int
        Number of runs that are compared.
    time_optimal_mean_s : float
        Mean duration of the time-optimal motion, in s.
    over_time_optimal : float
        Mean duration of the runs over it.
    """

    pairs: int
    time_optimal_mean_s: float
    over_time_optimal: float


@dataclass(frozen=True, kw_only=True)
class KindResult:
    """The executions of one kind of motion.

    Attributes
    ----------
    kind : str
        Its name.
    situations : int
        Number of executions.
    success_percent, ball_moved_early_percent : float
        Shares that succeeded, and in which the ball was moved before the robot had arrived.
    mean_duration_s : float or None
        Of the successes; None without any.
    greatest_command_over_limit : float
        Greatest ratio of a command to its limit.
    over_plan_mean_s, over_plan_std_s : float or None
        Mean and standard deviation of actual minus planned durations; None without plans.
    failures : tuple of str
        Why executions failed.
    turned_by_1_degree : Regularity or None
        None if no start was turned.
    pairs, time_optimal_mean_s, over_time_optimal
        As in `OverOptimal`; None if not compared.
    """

    kind: str
    situations: int
    success_percent: float
    ball_moved_early_percent: float
    mean_duration_s: float | None
    greatest_command_over_limit: float
    over_plan_mean_s: float | None = None
    over_plan_std_s: float | None = None
    failures: tuple[str, ...]
    turned_by_1_degree: Regularity | None = None
    pairs: int | None = None
    time_optimal_mean_s: float | None = None
    over_time_optimal: float | None = None


@dataclass(frozen=True)
class QualityResult:
    """The content of the file that `qualify` writes.

    Attributes
    ----------
    command : str
        The command that wrote it.
    seed : int
        Of the situations.
    action_set, robot_digest : str
        The actions, and the robot that executed them.
    kinds : tuple of KindResult
        One for each kind of motion.
    """

    command: str
    seed: int
    action_set: str
    robot_digest: str
    kinds: tuple[KindResult, ...]
