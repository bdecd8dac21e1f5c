"""A remote action and its server, stepped in one process."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import rclpy
from action_servers import declared
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ator_ros.actions.base import Goal, Status, Step
from ator_ros.geometry import Pose
from ator_ros.nodes.remote_actions import RemoteAction, RemoteServer
from ator_ros.robot.description import load_robot
from ator_ros.world.state import RobotState, World

ROBOT = load_robot()
GOAL = Goal(Pose(1.0, 2.0, 0.5), 0.3)
PERIOD = 0.02
"""Duration of a tick in real s; by the stamps it is five times as long."""


class Bench:
    """The node of the client and that of the server, in one rclpy executor of this process."""

    def __init__(self, domain: int) -> None:
        self._context = rclpy.Context()
        self._context.init(domain_id=domain)
        self.client_node, self.server_node = (
            Node(name, context=self._context) for name in ("client_node", "server_node")
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.client_node)
        self._executor.add_node(self.server_node)
        self.declare()
        self.steps: list[Step] = []
        self._time = 0.0

    def declare(self, **timeouts: float) -> None:
        """Set the timeouts of the server's declaration."""
        call = declared()
        call = dataclasses.replace(call, timeouts=dataclasses.replace(call.timeouts, **timeouts))
        self.server = RemoteServer(self.client_node, call, "odom")
        self.action = RemoteAction(ROBOT, self.server)

    def freeze(self) -> None:
        """Stop spinning the server's node, as if it was killed: DDS still lists it."""
        self._executor.remove_node(self.server_node)

    def resume(self) -> None:
        self._executor.add_node(self.server_node)

    def spin(self) -> None:
        end = time.monotonic() + PERIOD
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=PERIOD / 4.0)

    def begin(self) -> None:
        """Wait for the server, and start the action."""
        self.until(self.server.present)
        self.action.start(self.world(), GOAL)

    def world(self, v: float = 0.0) -> World:
        return World(self._time, RobotState(Pose(0.0, 0.0, 0.0), v))

    def tick(self, v: float = 0.0) -> Step:
        self.spin()
        self._time += 5.0 * PERIOD
        self.steps.append(self.action.step(self.world(v)))
        return self.steps[-1]

    def until(self, happened: Callable[[], Any], patience: float = 5.0) -> None:
        end = time.monotonic() + patience
        while not happened():
            assert time.monotonic() < end
            self.spin()

    def drive(self, happened: Callable[[], Any]) -> None:
        """Step the action until a condition holds; the action must not end before."""
        end = time.monotonic() + 5.0
        while not happened():
            assert time.monotonic() < end
            assert self.tick().status is Status.RUNNING, self.steps[-1]

    def outcome(self, patience: float = 10.0) -> tuple[Step, float]:
        """Step the action until it ends; return its last step and the duration."""
        began = time.monotonic()
        while self.tick().status is Status.RUNNING:
            assert time.monotonic() - began < patience
        self.action.end("over")
        return self.steps[-1], time.monotonic() - began

    def close(self) -> None:
        self._executor.shutdown()
        for node in (self.client_node, self.server_node):
            for waitable in list(node.waitables):  # otherwise they outlive their node
                getattr(waitable, "destroy", bool)()
            node.destroy_node()
        self._context.try_shutdown()
