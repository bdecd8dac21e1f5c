"""A base that a test moves, and external action servers of a domain from a file."""

from __future__ import annotations

import threading
import time

import pytest
from action_servers import Server
from chain_client import ChainClient
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from ros_client import Client

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import odometry_of
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.world.state import RobotState

DOMAIN = """
name: errands
objects:
  - {name: cart, topic: tracked_cart, type: PoseStamped}
tops:
  - name: visit
    action: navigate
    post:
      - {variable: robot.x, target: goal.x, tolerance: 0.1}
      - {variable: robot.y, target: goal.y, tolerance: 0.1}
  - name: follow
    action: navigate
    post: [{variable: robot.x, target: cart.x, tolerance: 1.0}]
  - {name: deliver, action: deliver, post: [{variable: robot.x, target: goal.x, tolerance: 0.1}]}
  - {name: fly, action: fly, post: [{variable: robot.x, target: goal.x, tolerance: 0.1}]}
actions:
  - name: navigate
    remote:
      server: drive
      type: ator_interfaces/action/ExecuteChain
      goal: [{field: "chain.calls[0].goal", source: goal}]
      success: {fields: [{field: outcome.code, equals: 1}]}
      timeouts: {server: 3.0, acceptance: 3.0, result: 30.0, cancel: 1.0}
  - name: deliver
    remote:
      server: drive_to
      type: ator_interfaces/action/DriveTo
      goal: [{field: goal, source: goal}]
      timeouts: {server: 10.0, silence: 1.5, cancel: 0.5}
  - name: fly
    remote:
      server: fly
      type: flying_msgs/action/Fly
      goal: [{field: pose, source: goal}]
"""


class Base:
    """A base that publishes the pose last set at 40 Hz, and the position of a cart once it is set."""

    def __init__(self, client: Client) -> None:
        self.state = RobotState(Pose(0.0, 0.0, 0.0))
        self.cart: tuple[float, float] | None = None
        self._carts = client.node.create_publisher(PoseStamped, "tracked_cart", SENSOR_DATA)
        self._publisher = client.node.create_publisher(Odometry, "odom", SENSOR_DATA)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(0.025):
            odometry = odometry_of(time.monotonic(), self.state, frame="odom", child="base_link")
            if self.cart is not None:
                cart = PoseStamped(header=odometry.header)
                cart.pose.position.x, cart.pose.position.y = self.cart
                self._carts.publish(cart)
            self._publisher.publish(odometry)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


class Hall:
    """A base, a server that moves it, and a client of the executor."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.base = Base(client)
        self.chains = ChainClient(client)
        self._server: Server | None = None

    def serve(self, **options: bool) -> Server:
        """Start the server."""
        self._server = self.client.within(lambda: Server(self.client.node, **options))
        return self._server

    def close(self) -> None:
        """Stop base and server."""
        self.base.close()
        if self._server is not None:
            self.client.within(self._server.destroy)

    def reach(self, server: Server, number: int, pose: Pose) -> None:
        """Move the robot to `pose` for the goal of this number, and let the server succeed."""
        self.client.eventually(lambda: len(server.goals) >= number, f"goal {number}")
        self.base.state = RobotState(pose)
        self.client.eventually(lambda: self.client.robot().pose == pytest.approx(pose), "odometry of it")
        self.client.within(server.finish)
