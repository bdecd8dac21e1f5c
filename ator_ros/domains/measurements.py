"""What only a domain itself can measure of its actions, for the tools that do so."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ator_ros.robot.description import Robot


@dataclass(frozen=True)
class LongestTick:
    """Processor time in ms of an action's longest tick: median over situations, the longest, its limit."""

    median_of_longest_ms: float
    longest_ms: float
    limit_longest_ms: float
    met: bool | None = None


@dataclass(frozen=True)
class PlannedPoints:
    """Points of planning, the same on every machine.

    Attributes
    ----------
    longest_points, limit_longest_points : int
        Most points in one tick, and their limit.
    largest_portion_points : int
        Most points that are planned without looking at the time.
    most_ticks : int
        Most ticks that planning takes.
    share_in_one_tick : float
        Share of situations in which one tick is enough.
    met : bool or None
        Whether the limit is kept; None before it is judged.
    """

    longest_points: int
    largest_portion_points: int
    most_ticks: int
    share_in_one_tick: float
    limit_longest_points: int
    met: bool | None = None


Ticks = Mapping[str, LongestTick | PlannedPoints]
"""By name of the case."""


@dataclass(frozen=True)
class QualityRun:
    """What `qualify` is asked for.

    Attributes
    ----------
    action_set : str
        The actions that are measured.
    situations, turned, pairs : int
        Situations of each kind of motion; how many of them are also measured turned by a degree, and compared
        with the time-optimal motion.
    seed, jobs : int
        Of the situations; worker processes.
    robot : str
        File of the robot's description; empty: the default one.
    optimal : Path or None
        Folder of the time-optimal motions.
    slices : Path or None
        Where to draw duration against start heading.
    out : Path
        Where the result goes.
    command : str
        The command that asked, for the result.
    """

    action_set: str
    situations: int
    turned: int
    pairs: int
    seed: int
    jobs: int
    robot: str
    optimal: Path | None
    slices: Path | None
    out: Path
    command: str


@dataclass(frozen=True)
class PaperRun:
    """What `paper_models` is asked for.

    Attributes
    ----------
    action_set : str
        The actions whose models are learned.
    episodes, fresh : int
        Episodes of each action to learn from, and to measure on.
    seed, fresh_seed, jobs : int
        Of both; worker processes.
    command : str
        The command that asked, for the result.
    """

    action_set: str
    episodes: int
    fresh: int
    seed: int
    fresh_seed: int
    jobs: int
    command: str


@dataclass(frozen=True)
class Measurements:
    """Measurements that know a domain's actions; a domain leaves out those that it lacks.

    Attributes
    ----------
    longest_ticks : callable or None
        Measures a robot's longest ticks of the actions where a way is hard to find: a part of `bench`.
    qualify : callable or None
        Measures success, regularity and speed of the actions, and writes and prints the result.
    paper_models : callable or None
        Returns, in Markdown, what models from the paper's features and experience are worth.
    """

    longest_ticks: Callable[[Robot], Ticks] | None = None
    qualify: Callable[[QualityRun], None] | None = None
    paper_models: Callable[[PaperRun], str] | None = None
