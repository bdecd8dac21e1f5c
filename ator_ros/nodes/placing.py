"""Putting robot and objects of the simulation somewhere, at rest, for programs that ask and wait."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.task import Future
from std_srvs.srv import SetBool

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import SERVICES
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.world.state import World


class Placing:
    """The simulation's services that place robot and objects and let time stand still.

    Parameters
    ----------
    own : SpunNode
        The node that calls them.
    objects : iterable of str
        The objects that the simulation can place.

    Attributes
    ----------
    paused : bool
        Whether the last request from here paused time.
    """

    def __init__(self, own: SpunNode, objects: Iterable[str]) -> None:
        self._own, node = own, own.node
        self.paused = False
        self._robot = node.create_client(PlaceRobot, "place_robot", qos_profile=SERVICES)
        self._pause = node.create_client(SetBool, "pause", qos_profile=SERVICES)
        self._objects = {
            name: node.create_client(PlaceObject, f"place_{name}", qos_profile=SERVICES) for name in objects
        }

    @property
    def _clients(self) -> tuple[Any, ...]:
        return (self._robot, self._pause, *self._objects.values())

    def ready(self) -> None:
        """Wait until the simulation offers all of them."""
        for client in self._clients:
            self._own.until(client.service_is_ready, f"the service {client.srv_name}")

    def offered(self, patience: float) -> bool:
        """Return whether a simulation offers them within `patience` real s each."""
        return all(client.wait_for_service(patience) for client in self._clients)

    def knows(self, name: str) -> bool:
        """Return whether the simulation can place an object."""
        return name in self._objects

    def robot(self, pose: Pose) -> Future:
        """Put the robot somewhere; not waited for."""
        return self._own.sent(self._robot, _at_pose(pose))

    def object(self, name: str, x: float, y: float) -> Future:
        """Put an object somewhere (m); not waited for."""
        return self._own.sent(self._objects[name], _at_point(x, y))

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
        self.paused = paused or self.paused  # where no answer comes it may be either
        self._own.call(self._pause, SetBool.Request(data=paused))
        self.paused = paused

    def go_on(self) -> Future:
        """Resume time without waiting; a simulation that has gone is no error."""
        answer: Future = self._pause.call_async(SetBool.Request(data=False))
        self.paused = False
        return answer

    def everything(self, world: World) -> None:
        """Let time stand still and put everything to its place; objects that `world` lacks are removed."""
        self.pause(paused=True)
        for client in self._objects.values():
            self._own.call(client, PlaceObject.Request(remove=True))
        self._own.call(self._robot, _at_pose(world.robot.pose))
        for name, there in world.objects.items():
            if self.knows(name):
                self._own.call(self._objects[name], _at_point(there.x, there.y))


def _at_pose(pose: Pose) -> PlaceRobot.Request:
    request = PlaceRobot.Request()
    request.pose.pose = pose_of(pose)
    return request


def _at_point(x: float, y: float) -> PlaceObject.Request:
    request = PlaceObject.Request()
    request.position.point.x, request.position.point.y = x, y
    return request
