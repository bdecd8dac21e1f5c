"""Reads what a view plays of a recording: odometry, objects, and the executor's records."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import Domain
from ator_ros.experience.bag_reading import Recording, RecordingError
from ator_ros.experience.streams import Streams, Stretches, Track
from ator_ros.experience.topics import CHAINS, ODOM, RECORDS, Wanted, objects_wanted, select
from ator_ros.viewing.recorded import RecordedChain, chain_of_actions, chain_of_record, time_of
from ator_ros.viewing.recording import RecordedRobot
from ator_ros.world.messages import object_from, pose_from, velocity

_MOST_ROBOTS = 32  # the page lists each by name
_MISREAD = (AttributeError, TypeError, ValueError, OverflowError)
"""Errors of records that cannot be read."""


@dataclass
class _Heard:
    """What was recorded of one robot, as it comes; records come with the stretch in which they were heard."""

    stretches: Stretches
    chains: list[tuple[int, Any]] = field(default_factory=list)
    actions: dict[str, list[tuple[int, Any]]] = field(default_factory=lambda: defaultdict(list))

    def take(self, kind: str, message: Any) -> None:
        """Take a message of a topic."""
        number = len(self.stretches.all) - 1
        if kind == CHAINS:
            self.chains.append((number, message))
        elif kind == RECORDS:
            self.actions[message.chain_id].append((number, message))
        else:
            self.stretches.take(kind, message)

    def robot(self) -> tuple[RecordedRobot | None, int]:
        """Return the robot, None where nothing tells where it was; and how many records were left out."""
        chains: list[tuple[int, RecordedChain]] = []
        left_out, odom = 0, bool(self.stretches.newest.odom)
        seen = [{name for name, rows in each.objects.items() if rows} for each in self.stretches.all]
        for number, actions, read in self._chains():
            try:
                chain = read()
                place = self._placed(number, actions, seen[number] if odom else None)
            except _MISREAD:
                left_out += 1
            else:
                chains.append((place, chain))
        tracks = [Track(streams) for streams in self.stretches.all if streams.odom]
        return (RecordedRobot(tracks, chains) if tracks else None), left_out

    def _chains(self) -> list[tuple[int, list[Any], Callable[[], RecordedChain]]]:
        """Return stretch, actions and reader of each chain, those with records of actions only included."""
        told = {record.chain_id for _, record in self.chains}
        found: list[tuple[int, list[Any], Callable[[], RecordedChain]]] = [
            (number, list(record.actions), partial(chain_of_record, record)) for number, record in self.chains
        ]
        for name, heard in self.actions.items():
            if name not in told:
                actions = [record for _, record in heard]
                found.append((heard[-1][0], actions, partial(chain_of_actions, actions)))
        return found

    def _placed(self, number: int, actions: list[Any], seen: set[str] | None) -> int:
        """Return the stretch of a chain; what was not recorded itself is taken from the chain's records.

        Parameters
        ----------
        number : int
            The stretch in which it was heard.
        actions : list of ActionPerformance
            Its actions.
        seen : set of str or None
            The objects that were recorded in that stretch; None where not even odometry was.
        """
        places = [situation for record in actions for situation in (record.start, record.end)]
        stretches = self.stretches.all
        if seen is None:
            if places and stretches[-1].odom and not stretches[-1].goes_on_at(time_of(places[0])):
                stretches.append(Streams())
            number = len(stretches) - 1
        for situation in places:
            time, speeds = time_of(situation), (velocity(situation.v, "v"), velocity(situation.w, "w"))
            if seen is None:
                stretches[number].odom.append((time, *pose_from(situation.robot, "robot"), *speeds))
            for there in situation.objects:
                where = object_from(there.position, there.velocity, there.name)
                if there.name not in (seen or ()):
                    stretches[number].objects[there.name].append((time, where.x, where.y))
        if not stretches[number].odom:
            raise ValueError("expected where the robot was")
        return number


def read_robots(
    file: Path, domain: Domain, going_on: Callable[[], None] = lambda: None
) -> tuple[Mapping[str, RecordedRobot], int]:
    """Read each robot's part of a recording.

    Parameters
    ----------
    file : Path
        An .mcap file, or the folder that ``ros2 bag record`` made.
    domain : Domain
        Its objects have topics of their names.
    going_on : callable
        Called with every message, of which there may be millions; raises to end the reading.

    Returns
    -------
    robots : mapping of str to RecordedRobot
        By namespace, at least one.
    left_out : int
        Number of chains whose records make no sense.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged, or has none of our topics.
    """
    sources = [domain.source(name) for name in domain.objects]
    wanted = [
        Wanted(ODOM, ODOM, {"nav_msgs/msg/Odometry"}),
        Wanted(RECORDS, RECORDS, {"ator_interfaces/msg/ActionPerformance"}),
        Wanted(CHAINS, CHAINS, {"ator_interfaces/msg/ChainPerformance"}),
        *objects_wanted(sources),
    ]
    heard: dict[str, _Heard] = defaultdict(lambda: _Heard(Stretches(sources)))
    with Recording(file) as recording:
        selection = select(recording.topics, wanted)
        for topic, kind, message in recording.messages(selection.routes.keys()):
            going_on()
            for space, role in selection.routes[topic, kind]:
                heard[space.strip("/")].take(role, message)
    found = [(name, *each.robot()) for name, each in itertools.islice(sorted(heard.items()), _MOST_ROBOTS)]
    robots = {name: robot for name, robot, _ in found if robot is not None}
    if not robots:
        expected = f"expected one of the topics {ODOM}, {CHAINS} or {RECORDS} with data"
        raise RecordingError("; ".join([f"{file}: {expected}", *selection.skipped[:1]]))
    return robots, sum(left_out for *_, left_out in found)
