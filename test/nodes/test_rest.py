"""Nodes that cost little while they have nothing to do: inputs gather, and few things are waited for."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest
import rclpy
from conftest import Host
from rclpy.executors import SingleThreadedExecutor
from ros_client import Client
from std_msgs.msg import Int32
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from ator_ros.geometry import Pose
from ator_ros.nodes.executor_settings import rest_of
from ator_ros.nodes.frugal_node import FrugalNode
from ator_ros.nodes.gathering import Gathering, Resting
from ator_ros.nodes.qos import RESULTS, SENSOR_DATA, STATES
from ator_ros.world.state import RobotState, World

pytestmark = pytest.mark.node

_LONG = 20.0
"""Real s that no test would wait for."""


class Sleeper(FrugalNode):
    """Listens to `first`, then to `second`; has a service `wake`."""

    def __init__(self, context: rclpy.Context) -> None:
        super().__init__("sleeper", context=context)
        self.gathering, self.heard, self.woken = Gathering(), [], 0
        for topic in ("first", "second"):
            self.create_subscription(
                Int32, topic, self._hear(topic), SENSOR_DATA, callback_group=self.gathering
            )
        self.create_service(Trigger, "wake", self._wake)

    def _hear(self, topic: str) -> Callable[[Int32], None]:
        return lambda message: self.heard.append((topic, message.data))

    def _wake(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        self.woken += 1
        return answer

    def rest(self) -> float:
        """Return how long it would rest, in real s."""
        return _LONG


@pytest.fixture
def sleeper(domain: int) -> Iterator[tuple[Sleeper, SingleThreadedExecutor]]:
    """Yield a node that this thread spins, and what spins it."""
    context = rclpy.Context()
    context.init(domain_id=domain)
    node, executor = Sleeper(context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def test_inputs_gather_and_the_newest_are_taken_in_the_order_of_subscription(sleeper, client: Client) -> None:
    node, executor = sleeper
    second, first = (client.node.create_publisher(Int32, name, STATES) for name in ("second", "first"))
    for topic in (first, second):
        client.eventually(topic.get_subscription_count, topic.topic_name)
    for number in range(3):
        second.publish(Int32(data=number))
        first.publish(Int32(data=number))
    began = time.monotonic()
    while not node.heard:
        node.gathering.rest(executor, 0.3)
    assert time.monotonic() - began >= 0.3
    assert node.heard == [("first", 2), ("second", 2)]


def test_whatever_else_happens_ends_a_rest_at_once(sleeper, client: Client) -> None:
    node, executor = sleeper
    asking = threading.Thread(target=lambda: client.call(Trigger, "wake", Trigger.Request()))
    asking.start()
    began = time.monotonic()
    while not node.woken:
        node.gathering.rest(executor, _LONG)
    assert time.monotonic() - began < _LONG
    asking.join()
    assert isinstance(node, Resting)


def test_a_rest_ends_before_odometry_would_count_as_missing() -> None:
    assert rest_of({"odom_timeout": 0.05}, (), 1.0, watched=False) == 0.025
    assert rest_of({"odom_timeout": 0.5}, (), 1.0, watched=True) <= 0.1  # drawn ten times a second
    assert rest_of({"odom_timeout": 0.5}, (), 1.0, watched=False) <= 0.15


@pytest.mark.parametrize("pace", [1.0, 1.5, 1.95])
def test_a_rest_ends_before_objects_would_be_too_far_ahead_or_their_velocity_unknown(pace: float) -> None:
    for timeout in (0.05, 0.1, 0.3):
        settings = {"odom_timeout": 0.5, "cup_timeout": timeout}
        stamped = pace * rest_of(settings, ["cup"], pace, watched=False)
        assert stamped <= timeout / 2.0 + 1e-9
        assert stamped <= 0.2 + 1e-9  # with an awakening and a tick less than 0.3 s


def test_inputs_are_heard_again_after_a_callback_that_raises(sleeper) -> None:
    node, _ = sleeper

    def raising(*, timeout_sec: float) -> None:
        raise RuntimeError("of a callback")

    with pytest.raises(RuntimeError, match="of a callback"):
        node.gathering.rest(SimpleNamespace(spin_once=raising), 0.1)
    assert node.gathering.can_execute(next(iter(node.subscriptions)))


def test_objects_are_drawn_ten_times_a_second(host: Host, client: Client) -> None:
    drawing = host("executor").node._drawing
    drawn = client.listen(MarkerArray, "object_markers", RESULTS)
    client.eventually(lambda: drawing.watched, "somebody who watches")
    robot = RobotState(Pose(0.0, 0.0, 0.0))
    for tick in range(60):  # 3 s; half of all differences of 2 ticks are rounded to less than 0.1 s
        drawing.objects(World(tick * 0.05, robot, {}))
        time.sleep(0.005)
    client.eventually(lambda: len(drawn) == 30, "30 drawings")


def test_an_executor_waits_for_no_event_but_that_a_drawing_is_looked_at(host: Host) -> None:
    node = host("executor").node
    kinds = [type(waitable).__name__ for waitable in node.waitables]
    assert sorted(kinds) == ["DeferredActionServer", *["EventHandler"] * 4]
