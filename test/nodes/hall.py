"""A base that a test moves, and external action servers of a domain from a file."""

import pytest
from action_servers import Server
from chain_client import ChainClient
from geometry_msgs.msg import PoseStamped
from moving_base import MovingBase
from ros_client import Client

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import stamp_of
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


class CartBase(MovingBase):
    """A base that also publishes the position of a cart once it is set."""

    def __init__(self, client: Client) -> None:
        self.cart: tuple[float, float] | None = None
        self._carts = client.node.create_publisher(PoseStamped, "tracked_cart", SENSOR_DATA)
        super().__init__(client)

    def publish(self, state: RobotState) -> None:
        if self.cart is not None:
            cart = PoseStamped()
            cart.header.stamp, cart.header.frame_id = stamp_of(self.time), self.frame
            cart.pose.position.x, cart.pose.position.y = self.cart
            self._carts.publish(cart)
        super().publish(state)


class Hall:
    """A base, a server that moves it, and a client of the executor."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.base = CartBase(client)
        self.chains = ChainClient(client)
        self._server: Server | None = None

    def serve(self, **options: bool) -> Server:
        self._server = self.client.within(lambda: Server(self.client.node, **options))
        return self._server

    def close(self) -> None:
        if self._server is not None:
            self.client.within(self._server.destroy)

    def reach(self, server: Server, number: int, pose: Pose) -> None:
        """Move the robot to `pose` for the goal of this number, and let the server succeed."""
        self.client.eventually(lambda: len(server.goals) >= number, f"goal {number}")
        self.base.pose = pose
        self.client.eventually(
            lambda: self.client.robot().pose == pytest.approx(pose), "odometry of it"
        )
        self.client.within(server.finish)
