"""What other headings, passing and another order would have saved in rounds that were driven.

A client that drives to stations goal by goal drives a *round*: each drive begins where the last one
ended, soon after it. The models predict the round as it was driven, and as refinement would change
it, so nothing has to be driven for the comparison.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from ator_ros.actions.goal_variables import ORDER, STOP
from ator_ros.experience.watched_paths import WatchedPaths
from ator_ros.geometry import Pose
from ator_ros.learning.drive_monitor import EndedDrive
from ator_ros.refinement import RefinementError
from ator_ros.refinement.chain_prediction import PredictsPerformance
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.search import Deadline, no_deadline
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import RobotState, World

LONGEST_ROUND = 10
"""Drives of a round up to which the best order is found exactly."""
_LONGEST_PAUSE = 60.0  # s at a station; after a longer pause another round begins
_SAME_PLACE = 0.5  # m between the end of a drive and the start of the next
_FEWEST = 2  # drives of a round: the heading of the last one is what the client wants
_DEVIATIONS = 1.96  # of a 95 % interval


@dataclass(frozen=True)
class Saving:
    """Time in s that could be saved, with half of its 95 % interval; NaN where it is unknown."""

    seconds: float = math.nan
    half: float = math.nan

    def plus(self, other: Saving) -> Saving:
        """Return the sum of both; the errors of a model are alike, so the intervals add up."""
        if math.isnan(self.seconds):
            return other
        if math.isnan(other.seconds):
            return self
        return Saving(self.seconds + other.seconds, self.half + other.half)


@dataclass(frozen=True)
class RoundSavings:
    """What a round would have saved: by headings; beyond them by passing; and by the order."""

    headings: Saving = Saving()
    passing: Saving = Saving()
    order: Saving = Saving()

    def plus(self, other: RoundSavings) -> RoundSavings:
        """Return the sums of both."""
        return RoundSavings(
            self.headings.plus(other.headings),
            self.passing.plus(other.passing),
            self.order.plus(other.order),
        )


@dataclass(frozen=True)
class Round:
    """Consecutive drives: where the robot began, and the goals in the order that they were sent."""

    action: str
    start: RobotState
    goals: tuple[Pose, ...]

    def legs(self) -> Iterator[tuple[Pose, Pose]]:
        """Yield the ends of all drives that another order may have, the driven ones first."""
        places = (self.start.pose, *self.goals)
        yield from itertools.pairwise(places)
        for start, goal in itertools.product(places, self.goals):
            if start != goal:
                yield start, goal


@dataclass
class Rounds:
    """Joins drives to rounds; call `add` for each drive that has ended, and `close` when idle."""

    _drives: list[EndedDrive] = field(default_factory=list)

    def add(self, drive: EndedDrive) -> Round | None:
        """Add a drive; return the round before it, if it does not belong to that."""
        if not self._drives or self._continues(drive):
            ended = None
        else:
            ended = self.close()
        if drive.episode is not None and drive.episode.success:
            self._drives.append(drive)
        return ended

    def close(self) -> Round | None:
        """Return the round of the drives so far, and begin another; None for too few drives."""
        drives = self._drives
        self._drives = []
        episodes = [drive.episode for drive in drives if drive.episode is not None]
        if len(episodes) < _FEWEST:
            return None
        first = episodes[0].situation
        goals = tuple(episode.situation.goal.pose for episode in episodes)
        return Round(first.action, first.robot, goals)

    def is_over(self, now: float) -> bool:
        """Return whether a round has ended by a pause until `now`, in s by odometry."""
        return bool(self._drives) and now - self._drives[-1].goal.end > _LONGEST_PAUSE

    def _continues(self, drive: EndedDrive) -> bool:
        last = self._drives[-1]
        if drive.episode is None or last.episode is None or not drive.episode.success:
            return False
        pause = drive.goal.begin - last.goal.end
        start = drive.episode.situation.robot.pose
        return (
            0.0 <= pause <= _LONGEST_PAUSE
            and drive.goal.action == last.goal.action
            and len(self._drives) < LONGEST_ROUND
            and start.distance(last.episode.situation.goal.pose) <= _SAME_PLACE
        )


def missing_legs(found: Round, paths: WatchedPaths) -> list[tuple[Pose, Pose]]:
    """Return the legs of a round, in any order of its goals, whose path is unknown."""
    return [
        (start, goal)
        for start, goal in dict.fromkeys(found.legs())
        if paths(start[:2], goal[:2]) is None
    ]


def savings_of(
    found: Round,
    library: TopLibrary,
    models: Mapping[str, PredictsPerformance],
    *,
    may_pass: bool = False,
    knows_all: bool = True,
    deadline: Deadline = no_deadline,
) -> RoundSavings:
    """Return what a round would have saved, as predicted.

    The last goal keeps its place and its heading, since the client continues from there.

    Parameters
    ----------
    library : TopLibrary
        Its robot is on the map whose paths are known.
    may_pass : bool
        Whether the server can pass goals.
    knows_all : bool
        Whether the paths of all legs are known, as another order needs.
    """
    top = next((top for top in library.values() if top.action == found.action), None)
    if top is None or found.action not in models:
        return RoundSavings()
    refiner = Refiner(library.robot, models, ranges=library.ranges)
    world = World(0.0, found.start, {})

    def saved(opened: frozenset[str]) -> Saving:
        return _saving(refiner, world, _chain(found, library, top, opened), deadline)

    headings = saved(frozenset({"yaw"}))
    passing = order = Saving()
    if may_pass:
        passing = _beyond(saved(frozenset({"yaw", STOP})), headings)
    if knows_all and len(found.goals) > _FEWEST:
        order = _beyond(saved(frozenset({"yaw", ORDER})), headings)
    return RoundSavings(headings, passing, order)


def _chain(found: Round, library: TopLibrary, top: Top, opened: frozenset[str]) -> TopChain:
    """Return a round as it was driven, with what is open at all goals but the last."""
    calls = [TopCall(top, library.goal(top, goal), opened) for goal in found.goals[:-1]]
    last = TopCall(top, library.goal(top, found.goals[-1]))
    return TopChain((*calls, last))


def _saving(refiner: Refiner, world: World, chain: TopChain, deadline: Deadline) -> Saving:
    try:
        found = refiner.refine(world, chain, Objective(), deadline=deadline)
    except RefinementError:
        return Saving()
    if not math.isfinite(found.saved):
        return Saving()
    return Saving(max(0.0, found.saved), _DEVIATIONS * found.uncertainty)


def _beyond(all_of_it: Saving, part: Saving) -> Saving:
    """Return what is saved in addition to a part of it."""
    if math.isnan(part.seconds):
        return all_of_it
    return Saving(max(0.0, all_of_it.seconds - part.seconds), all_of_it.half)
