"""Where robot and objects are, as a view hears it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from rclpy.node import Node

from ator_ros.domains.domain import Domain
from ator_ros.nodes.inputs import ObjectSources, RobotSource, TfListener
from ator_ros.robot.description import Robot
from ator_ros.world.messages import MessageError
from ator_ros.world.state import ObjectState, RobotState, World

_ANEW = 3
"""Messages that must come before one of them was surely sent later: the first may have been on its way."""
_FORGOTTEN = 1.0
"""Seconds by the stamps after which an object that nobody sees is taken for gone."""
_ROBOT = ""


class SeenWorld:
    """The newest states of a robot and of a domain's objects.

    Parameters
    ----------
    node : Node
        Who listens.
    domain, robot : Domain, Robot
        The objects, and what may be believed of the robot.
    frame : str
        The frame of all poses.
    """

    def __init__(self, node: Node, domain: Domain, robot: Robot, *, frame: str) -> None:
        self._node, self._robot, self._frame = node, robot, frame
        self._tf = TfListener(node)
        self._newest: tuple[float, RobotState] | None = None
        self._objects: dict[str, tuple[float, ObjectState]] = {}
        self._heard_at = time.monotonic()
        self._heard = Counter[str]()
        self._source: RobotSource | None = None
        sources = map(domain.source, domain.objects)
        self._sources = ObjectSources(node, sources, self._take_object, self._ignore, self._tf, frame=frame)

    def follow(self, settings: Mapping[str, Any]) -> None:
        """Listen to the robot from now on, as the parameters of its executor say; once.

        Raises
        ------
        SetupError
            The robot's state comes from tf, and tf2_msgs is not installed.
        """
        if self._source is None:
            known = {**settings, "frame": self._frame}
            self._source = RobotSource(
                self._node, known, self._robot, self._take_robot, self._ignore, self._warn, self._tf
            )

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        self._newest, self._heard_at = (stamp, robot), time.monotonic()
        self._heard[_ROBOT] += 1

    def _take_object(self, name: str, stamp: float, there: ObjectState) -> None:
        self._objects[name] = stamp, there
        self._heard[name] += 1

    def _ignore(self, _: str, error: MessageError) -> None:
        self._warn(f"ignored: {error}")

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text, throttle_duration_sec=2.0)

    @property
    def silence(self) -> float:
        """Real s since the robot was last heard of."""
        return time.monotonic() - self._heard_at

    def world(self) -> World | None:
        """Return the newest state; objects that nobody sees any more are not in it."""
        if self._newest is None:
            return None
        now, robot = self._newest
        seen = list(self._objects.items())
        objects = {name: there for name, (when, there) in seen if abs(now - when) < _FORGOTTEN}
        return World(now, robot, objects)

    def anew(self) -> None:
        """Count from now on what is heard, for `heard_anew`."""
        self._heard.clear()

    def heard_anew(self, names: Iterable[str]) -> bool:
        """Return whether the robot and the objects of these names were surely heard of since `anew`.

        Where they are does not matter: noise may keep them off their places.
        """
        return all(self._heard[name] >= _ANEW for name in (_ROBOT, *names))
