"""Select the topics of a recording by name and type, for each robot that it holds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from ator_ros.printable import printable
from ator_ros.world.messages import ObjectSource

ODOM, CMD_VEL, RECORDS, CHAINS = "odom", "cmd_vel", "performance/action", "performance/chain"
TF = ("tf", "tf_static")
"""Roles of topics."""
ABSOLUTE = ""
"""The namespace of topics that are wanted by absolute names."""


@dataclass(frozen=True, slots=True)
class TopicNames:
    """Names of the topics of one robot's odometry and commands.

    Attributes
    ----------
    odom, cmd_vel : str
        Absolute where they are not the usual ones, which any namespace may hold.
    """

    odom: str = "odom"
    cmd_vel: str = "cmd_vel"

    def of(self, role: str) -> str:
        """Return the name of the topic of odom or cmd_vel."""
        name: str = getattr(self, role)
        return name


USUAL = TopicNames()


@dataclass(frozen=True, slots=True)
class Wanted:
    """A topic that is read.

    Attributes
    ----------
    role : str
        What it is read as.
    name : str
        Absolute, or relative to the namespace of a robot.
    types : collection of str
        Types of its messages, as nav_msgs/msg/Odometry.
    """

    role: str
    name: str
    types: Collection[str]

    def namespace(self, topic: str) -> str | None:
        """Return the namespace in which a topic has this name, or `ABSOLUTE`; None: it has another name."""
        if self.name.startswith("/"):
            return ABSOLUTE if topic == self.name else None
        return topic.removesuffix(self.name) if topic.endswith(f"/{self.name}") else None


@dataclass
class Selection:
    """Which topics of a recording are read.

    Attributes
    ----------
    topics : sequence of (str, str)
        All topics of the recording with their types.
    routes : dict of (str, str) to list of (str, str)
        Robots, by their namespaces, and roles that each topic is read for.
    robots : list of str
        The robots.
    skipped : list of str
        A line for each topic that has a wanted name but another type.
    """

    topics: Sequence[tuple[str, str]]
    routes: dict[tuple[str, str], list[tuple[str, str]]] = field(default_factory=lambda: defaultdict(list))
    robots: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def of_types(self, types: Collection[str]) -> list[str]:
        """Return the topics of the recording that have one of these types."""
        return [topic for topic, kind in self.topics if kind in types]


def objects_wanted(sources: Iterable[ObjectSource]) -> list[Wanted]:
    """Return the topics that objects come from; a tf object's role is that of tf."""
    sources = list(sources)
    packages = {"Odometry": "nav_msgs"}
    wanted = [
        Wanted(item.name, item.listened, {f"{packages.get(item.type, 'geometry_msgs')}/msg/{item.type}"})
        for item in sources
        if item.type != "tf"
    ]
    if len(wanted) < len(sources):
        wanted += [Wanted(role, f"/{role}", {"tf2_msgs/msg/TFMessage"}) for role in TF]
    return wanted


def select(
    topics: Sequence[tuple[str, str]], wanted: Sequence[Wanted], names: TopicNames = USUAL
) -> Selection:
    """Select topics by name and type.

    A robot reads the topics in its namespace. Objects, action servers and records that are in another
    namespace belong to the only robot with odometry.

    Parameters
    ----------
    topics : sequence of (str, str)
        Names and types of the topics of a recording.
    wanted : sequence of Wanted
        What is read, odometry and commands by `names`.
    names : TopicNames, optional
        Unless they are the usual ones, all topics are one robot's, in whatever namespaces.
    """
    selection = Selection(topics)
    found: dict[str, dict[str, list[tuple[str, str]]]] = defaultdict(lambda: defaultdict(list))
    for topic, kind in topics:
        for item in wanted:
            space = item.namespace(topic if topic.startswith("/") else f"/{topic}")
            if space is None:
                continue
            if kind in item.types:
                found[item.role][space].append((topic, kind))
            else:
                expected = " or ".join(sorted(item.types))
                selection.skipped.append(
                    f"skipped {printable(topic)}: expected {expected}, got {printable(kind)}"
                )
    named = names != USUAL
    home = names.odom.rpartition("/")[0] + "/"
    spaces = sorted({*found[ODOM], *found[RECORDS], *found[CHAINS]})
    selection.robots = [home] if named else spaces

    def shares(robot: str, role: str) -> bool:
        """Return whether a robot without a topic of this role in its namespace reads one of another."""
        if named:
            return True
        drives = robot in found[ODOM] and len(found[ODOM]) == 1
        return drives and role not in (ODOM, CMD_VEL)

    for role, there in found.items():
        for robot in selection.robots:
            read = {ABSOLUTE, robot} & set(there)
            if not read and shares(robot, role):
                outer = [space for space in there if robot.startswith(space)]
                read = {max(outer, key=len)} if outer else set(there)
            if len(read - {ABSOLUTE}) > 1:
                listed = ", ".join(printable(link[0]) for space in sorted(there) for link in there[space])
                selection.skipped.append(f"skipped {listed}: expected one of them as {role}")
                continue
            for link in (link for space in read for link in there[space]):
                selection.routes[link].append((robot, role))
    return selection
