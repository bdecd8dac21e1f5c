"""The executor with robot and object from tf: a base that publishes map, odom, base_link."""

import math
import time
from pathlib import Path

import pytest
from chain_client import ChainClient, call
from conftest import Host
from domain_files import file_of, visiting
from moving_base import PERIOD, MovingBase
from ros_client import Client
from tf2_msgs.msg import TFMessage

from ator_interfaces.msg import Outcome, Situation, TopChain
from ator_interfaces.srv import PredictDurations, RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.nodes.simulation import transform_of
from ator_ros.nodes.subscriptions import TfListener
from ator_ros.world.state import RobotState


class TfBase(MovingBase):
    """A base that publishes tf: `origin` is the pose of odom in the map.

    `cart` is the pose of an object that a camera on the robot detects, None while it does not.
    """

    def __init__(self, client: Client) -> None:
        self.origin = Pose(0.5, -0.5, 1.0)
        self.cart: Pose | None = None
        self._tf = client.node.create_publisher(TFMessage, "/tf", RESULTS)
        self._static = client.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        fixed = transform_of(0.0, Pose(0.2, 0.0, 0.0), frame="base_link", child="camera")
        self._static.publish(TFMessage(transforms=[fixed]))
        super().__init__(client)

    @property
    def in_map(self) -> Pose:
        return self.origin.compose(self.pose)

    def publish(self, state: RobotState) -> None:
        edges = [("map", "odom", self.origin), ("odom", "base_link", state.pose)]
        if self.cart is not None:
            camera = self.in_map.compose(Pose(0.2, 0.0, 0.0))
            edges.append(("camera", "seen/cart-1", camera.relative(self.cart)))
        transforms = [
            transform_of(self.time, pose, frame=frame, child=child) for frame, child, pose in edges
        ]
        self._tf.publish(TFMessage(transforms=transforms))


CLIENT = {"silent": True}


@pytest.fixture
def base(client: Client) -> TfBase:
    return TfBase(client)


SETTINGS = {"frame": "map", "robot_from": "tf", "odom_timeout": 1.0, "start_timeout": 1.0}


def test_a_chain_is_driven_by_tf_in_the_map(host: Host, client: Client, base: TfBase) -> None:
    host("executor", **SETTINGS)
    goals = [Pose(1.0, 0.3, 1.5), Pose(1.0, 0.8, 2.0)]
    result = ChainClient(client).send([call("goToPose", goal) for goal in goals]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert base.in_map.distance(goals[1]) < 0.04
    assert math.cos(base.in_map.yaw - 2.0) > math.cos(0.08)
    assert result.record.header.frame_id == "map"
    assert all(record.actual.accuracy < 0.03 for record in result.record.actions)


def test_a_goal_in_another_frame_is_transformed(host: Host, client: Client, base: TfBase) -> None:
    host("executor", **SETTINGS)
    goal = call("goToPose", Pose(0.6, 0.2, 0.5))
    goal.goal.header.frame_id = "/odom"
    chains = ChainClient(client)
    chains.send([call("goToPose", base.in_map)]).result()  # it waits for the first transforms
    result = chains.send([goal]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert base.pose.distance(Pose(0.6, 0.2, 0.5)) < 0.04
    assert result.record.chain.calls[0].goal.header.frame_id == "map"


def test_requests_in_another_frame_are_transformed(host: Host, client: Client) -> None:
    host("refinement")
    dock, start, goal = Pose(1.0, -0.5, 0.7), Pose(-1.0, 0.2, 0.3), Pose(0.8, 0.4, 1.5)
    static = client.node.create_publisher(TFMessage, "/tf_static", LATCHED)
    static.publish(TFMessage(transforms=[transform_of(0.0, dock, frame="odom", child="dock")]))

    def predicted(frame: str, base: Pose) -> list[float]:
        situation = Situation(robot=pose_of(base.compose(start)))
        step = call("goToPose", base.compose(goal))
        situation.header.frame_id = step.goal.header.frame_id = frame
        refined = client.call(
            RefineSubgoal,
            "refine_subgoal",
            RefineSubgoal.Request(situation=situation, chain=TopChain(calls=[step])),
        )
        durations = client.call(
            PredictDurations,
            "predict_durations",
            PredictDurations.Request(situations=[situation], calls=[step]),
        )
        return [refined.before.duration, *durations.durations] if refined.accepted else []

    client.eventually(lambda: predicted("dock", Pose(0.0, 0.0, 0.0)), "the frame dock")
    assert predicted("dock", Pose(0.0, 0.0, 0.0)) == pytest.approx(predicted("odom", dock))


@pytest.mark.long
def test_an_object_is_found_through_the_robots_camera(
    host: Host, client: Client, base: TfBase, tmp_path: Path
) -> None:
    file = file_of(tmp_path, visiting({"type": "tf", "frame": "seen/cart-1"}, "cart"))
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


def test_invalid_transforms_are_reported_and_not_used(
    host: Host, client: Client, base: TfBase
) -> None:
    node = host("executor", **SETTINGS)
    publisher = client.node.create_publisher(TFMessage, "/tf", RESULTS)
    client.eventually(publisher.get_subscription_count, "a listener")
    directionless = transform_of(1e6, Pose(0.0, 0.0, 0.0), frame="map", child="odom")
    directionless.transform.rotation.w = directionless.transform.rotation.z = 0.0
    lost = transform_of(1e6, Pose(math.nan, 0.0, 0.0), frame="map", child="odom")
    nameless = transform_of(1e6, Pose(0.0, 0.0, 0.0), frame="map", child="")
    words = "ignored: tf: 'odom': expected a quaternion (x, y, z, w) with a direction"

    # the listener may discover the publisher later than the publisher discovers it
    def named() -> bool:
        publisher.publish(TFMessage(transforms=[directionless, lost, nameless]))
        return words in node.output

    client.eventually(named, "a log")
    sent = ChainClient(client).send([call("goToPose", base.in_map.ahead(0.3))])
    assert sent.outcome().code == Outcome.SUCCEEDED, sent.outcome().reason


def test_transforms_that_wait_are_read_before_the_newest_pose_is_used(client: Client) -> None:
    taken: list[float] = []
    publisher = client.node.create_publisher(TFMessage, "/tf", RESULTS)
    listener = TfListener(client.node)
    listener.follow("odom", "base_link", lambda stamp, _: taken.append(stamp))
    client.eventually(publisher.get_subscription_count, "a listener")

    def publish() -> None:  # in the spinning thread, so that they wait
        for number in range(60):
            pose = Pose(0.01 * number, 0.0, 0.0)
            message = transform_of(1.0 + number, pose, frame="odom", child="base_link")
            publisher.publish(TFMessage(transforms=[message]))
        time.sleep(0.2)

    client.within(publish)
    client.eventually(lambda: taken[-1:] == [60.0], "the newest pose")
    assert len(taken) <= 3


@pytest.mark.long
def test_two_nodes_that_publish_the_robots_frame_are_named(
    host: Host, client: Client, base: TfBase
) -> None:
    node = host("executor", **SETTINGS)
    chains = ChainClient(client)
    chains.send([call("goToPose", base.in_map)]).result()  # it waits for the first transforms
    other = Client(client.domain, name="second_base", silent=True)
    publisher = other.node.create_publisher(TFMessage, "/tf", RESULTS)

    def publish() -> None:
        pose = base.pose._replace(y=base.pose.y + 0.4)
        message = transform_of(base.time + 0.02, pose, frame="odom", child="base_link")
        publisher.publish(TFMessage(transforms=[message]))

    other.node.create_timer(PERIOD, publish)
    try:
        outcome = chains.send([call("goToPose", base.in_map.ahead(2.0))]).outcome()
    finally:
        other.close()
    assert outcome.code == Outcome.INPUT_LOST, outcome.reason
    assert "'odom' to 'base_link': expected one sender" in outcome.reason
    assert "/second_base" in outcome.reason
    assert "expected one sender" in node.output
