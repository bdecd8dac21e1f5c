"""The executor with robot and object from tf: a base that publishes map, odom, base_link."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from chain_client import ChainClient, call
from conftest import Host
from geometry_msgs.msg import TransformStamped, Twist
from ros_client import Client
from tf2_msgs.msg import TFMessage

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED, RESULTS, SENSOR_DATA
from ator_ros.nodes.simulation import transform_of
from ator_ros.robot.description import StopBraking, load_robot
from ator_ros.robot.response import ramped
from ator_ros.world.messages import command_from
from ator_ros.world.state import STOP

PERIOD = 0.025
LIMITS = load_robot().limits
DOMAIN = """
name: errands
objects:
  - {name: cart, type: tf, frame: seen/cart-1}
tops:
  - name: visit
    action: goToPose
    post:
      - {variable: robot.x, target: cart.x, tolerance: 0.1}
      - {variable: robot.y, target: cart.y, tolerance: 0.1}
actions:
  - name: goToPose
    local: {domain: soccer}
"""


class Base:
    """A base that follows cmd_vel within the Pioneer's limits and publishes tf at 40 Hz.

    Attributes
    ----------
    silent, blocked : bool
        Whether it publishes nothing, or does not move.
    origin : Pose
        Pose of odom in map.
    cart : Pose or None
        Pose of an object that a camera on the robot detects.
    """

    def __init__(self, client: Client) -> None:
        self.pose, self.velocity = Pose(0.0, 0.0, 0.5), STOP
        self.silent = self.blocked = False
        self.origin = Pose(0.5, -0.5, 1.0)
        self.cart: Pose | None = None
        self.commanded = STOP
        node = client.node
        self._tf = node.create_publisher(TFMessage, "/tf", RESULTS)
        self._static = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        fixed = transform_of(0.0, Pose(0.2, 0.0, 0.0), frame="base_link", child="camera")
        self._static.publish(TFMessage(transforms=[fixed]))
        node.create_subscription(Twist, "cmd_vel", self._on_command, SENSOR_DATA)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def in_map(self) -> Pose:
        """The pose in the map."""
        return self.origin.compose(self.pose)

    def _on_command(self, message: Twist) -> None:
        self.commanded = command_from(message, "cmd_vel")

    def _run(self) -> None:
        while not self._ended.wait(PERIOD):
            self._drive()
            if not self.silent:
                self.publish(time.monotonic())

    def publish(self, now: float) -> None:
        """Publish the state at `now` (s)."""
        self._tf.publish(TFMessage(transforms=self._transforms(now)))

    def _drive(self) -> None:
        self.velocity = (
            STOP if self.blocked else ramped(self.velocity, self.commanded, PERIOD, LIMITS, StopBraking())
        )
        turned = Pose(self.pose.x, self.pose.y, self.pose.yaw + self.velocity.w * PERIOD / 2.0)
        there = turned.ahead(self.velocity.v * PERIOD)
        self.pose = Pose(there.x, there.y, there.yaw + self.velocity.w * PERIOD / 2.0)

    def _transforms(self, now: float) -> list[TransformStamped]:
        edges = [("map", "odom", self.origin), ("odom", "base_link", self.pose)]
        if self.cart is not None:
            camera = self.in_map.compose(Pose(0.2, 0.0, 0.0))
            edges.append(("camera", "seen/cart-1", camera.relative(self.cart)))
        return [transform_of(now, pose, frame=frame, child=child) for frame, child, pose in edges]

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


@pytest.fixture
def base(client: Client) -> Iterator[Base]:
    made = Base(client)
    yield made
    made.close()


SETTINGS = {"frame": "map", "robot_from": "tf", "odom_timeout": 1.0, "start_timeout": 1.0}


def test_a_chain_is_driven_by_tf_in_the_map(host: Host, client: Client, base: Base) -> None:
    host("executor", **SETTINGS)
    goals = [Pose(1.0, 0.3, 1.5), Pose(1.0, 0.8, 2.0)]
    result = ChainClient(client).send([call("goToPose", goal) for goal in goals]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert base.in_map.distance(goals[1]) < 0.04
    assert math.cos(base.in_map.yaw - 2.0) > math.cos(0.08)
    assert result.record.header.frame_id == "map"
    assert all(record.actual.accuracy < 0.03 for record in result.record.actions)


def test_an_object_is_found_through_the_robots_camera(
    host: Host, client: Client, base: Base, tmp_path: Path
) -> None:
    file = tmp_path / "errands.yaml"
    file.write_text(DOMAIN, encoding="utf-8")
    host("executor", **SETTINGS, domain=file)
    chains, goal = ChainClient(client), base.in_map.ahead(0.5)
    outcome = chains.send([call("visit", goal)]).outcome()
    assert outcome.code == Outcome.INPUT_LOST
    assert outcome.reason.startswith("cart is missing: visit needs it")
    base.cart = goal.ahead(0.05)
    result = chains.send([call("visit", goal)]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    (cart,) = result.record.actions[0].end.objects
    assert (cart.position.x, cart.position.y) == pytest.approx(base.cart[:2], abs=0.02)
    assert math.hypot(cart.velocity.x, cart.velocity.y) < 0.1


def test_invalid_transforms_are_reported_and_not_used(host: Host, client: Client, base: Base) -> None:
    node = host("executor", **SETTINGS)
    publisher = client.node.create_publisher(TFMessage, "/tf", RESULTS)
    client.eventually(publisher.get_subscription_count, "a listener")
    directionless = transform_of(1e6, Pose(0.0, 0.0, 0.0), frame="map", child="odom")
    directionless.transform.rotation.w = directionless.transform.rotation.z = 0.0
    lost = transform_of(1e6, Pose(math.nan, 0.0, 0.0), frame="map", child="odom")
    nameless = transform_of(1e6, Pose(0.0, 0.0, 0.0), frame="map", child="")
    words = "ignored: tf: 'odom': expected a quaternion (x, y, z, w) with a direction"

    def named() -> bool:  # the listener may discover the publisher later than the publisher discovers it
        publisher.publish(TFMessage(transforms=[directionless, lost, nameless]))
        return words in node.output

    client.eventually(named, "a log")
    sent = ChainClient(client).send([call("goToPose", base.in_map.ahead(0.3))])
    assert sent.outcome().code == Outcome.SUCCEEDED, sent.outcome().reason
