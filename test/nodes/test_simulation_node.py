"""The `simulation` node over its ROS interfaces."""

import functools
import itertools
import math

import pytest
from nav_msgs.msg import Odometry
from process import Process, Processes
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_client import Client, values_of
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.geometry import Pose, yaw_from_quaternion
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED, NEWEST, SENSOR_DATA
from ator_ros.world.readers import OdometryReader

START = Pose(-2.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def simulation(shared: tuple[Processes, Client]) -> Process:
    """Return a simulation with default parameters for several tests."""
    return shared[0].start("simulation", real_time_factor=5.0, publish_clock=True)


@pytest.fixture
def world(shared: tuple[Processes, Client], simulation: Process) -> Client:
    """Reset the simulation and return its client."""
    client = shared[1]
    assert client.call(Trigger, "reset").success
    # Earlier messages may still be in transit.
    client.eventually(lambda: client.robot().pose.distance(START) < 1e-3, "the start pose")
    client.eventually(
        lambda: math.hypot(client.ball().x, client.ball().y) < 1e-3, "the ball's place"
    )
    client.robots.clear()
    client.balls.clear()
    return client


@pytest.mark.long
def test_state_is_published_at_20_hz_of_simulated_time(world: Client) -> None:
    client = world
    # A busy subscriber with a short queue would lose messages.
    patient = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    messages = client.listen(Odometry, "odom", patient)
    client.eventually(lambda: len(messages) > 30, "odometry of 30 ticks")
    times = [OdometryReader("odom").read(message)[0] for message in list(messages)]
    steps = [later - earlier for earlier, later in itertools.pairwise(times)]
    # Sensor data is best effort: a tick may be lost, but none is repeated or reordered.
    assert all(abs(step / 0.05 - round(step / 0.05)) < 1e-6 and step > 0 for step in steps)
    assert sum(abs(step - 0.05) < 1e-6 for step in steps) > 0.8 * len(steps)
    assert client.ball().speed == pytest.approx(0.0, abs=1e-3)


def seconds_to_stand(client: Client) -> float:
    """Command more than the limit, then nothing.

    Return the simulated time until the robot stands.
    """
    for _ in range(100):
        client.drive_a_tick(50.0)
        if client.robot().vx > 1.1:
            break
    ceased = client.time()
    assert client.robot().vx > 1.1
    client.eventually(lambda: abs(client.robot().vx) < 0.01, "the robot stands")
    return (
        next(time for time, robot in client.robots if time > ceased and abs(robot.vx) < 0.01)
        - ceased
    )


def test_commands_drive_the_robot_within_its_limits_and_it_stops_without_them(
    world: Client,
) -> None:
    before = world.robot()
    # The last command may apply to a later tick, on a busy machine a much later one, never to an
    # earlier one.
    times = (seconds_to_stand(world) for _ in range(3))
    assert any(time < 0.5 + 0.1 + 1e-6 for time in times)
    assert max(robot.vx for _, robot in world.robots) < 1.2 * 1.02
    assert world.robot().pose.x > before.pose.x + 0.2


def test_robot_and_ball_are_placed_and_the_world_is_reset(world: Client) -> None:
    client = world
    assert client.call(SetBool, "pause", SetBool.Request(data=True)).success
    client.place(robot=Pose(1.0, -1.0, 2.0), ball=(2.0, 1.0))
    client.eventually(
        lambda: client.robot().pose.distance(Pose(1.0, -1.0, 0.0)) < 1e-6, "the robot is placed"
    )
    assert client.robot().pose.yaw == pytest.approx(2.0)
    client.eventually(
        lambda: (client.ball().x, client.ball().y) == (2.0, 1.0), "the ball is placed"
    )
    paused = client.time()
    count = len(client.robots)
    client.eventually(lambda: len(client.robots) > count + 5, "a paused world is still published")
    assert client.time() == paused
    client.call(SetBool, "pause", SetBool.Request(data=False))
    # Long enough to receive a smaller time after the reset.
    client.eventually(lambda: client.time() > paused + 3.0, "time goes on")
    later, count = client.time(), len(client.robots)
    assert client.call(Trigger, "reset").success
    client.eventually(
        lambda: any(time < later for time, _ in client.robots[count:]), "time starts again"
    )
    client.eventually(lambda: client.robot().pose.distance(START) < 1e-3, "the start pose")


def test_a_ball_rolls_and_is_removed(world: Client) -> None:
    client = world
    request = PlaceObject.Request()
    request.velocity.x = 1.0
    assert client.call(PlaceObject, "place_ball", request).success
    client.eventually(lambda: client.ball().x > 0.2, "the ball rolls")
    assert client.call(PlaceObject, "place_ball", PlaceObject.Request(remove=True)).success
    time = client.time()
    client.eventually(lambda: client.time() > time + 1.0, "a second passes")
    assert client.balls[-1][0] < time + 0.5


INVALID = [
    (
        "place_robot",
        "pose.pose.position.x",
        math.nan,
        "pose.pose.position.x: expected a finite number",
    ),
    ("place_robot", "pose.header.frame_id", "attic", "expected the frame 'odom', got 'attic'"),
    ("place_robot", "vx", math.inf, "vx: expected a finite number"),
    ("place_robot", "vy", 0.1, "vy: expected a finite number from 0 to 0 m/s, got 0.1"),
    ("place_robot", "w", 99.0, "w: expected a finite number"),
    ("place_ball", "position.point.y", -500.0, "position.point.y: expected a finite number"),
    ("place_ball", "velocity.y", 99.0, "velocity.y: expected a finite number"),
]
KINDS = {"place_robot": PlaceRobot, "place_ball": PlaceObject}


@pytest.mark.parametrize(("service", "where", "value", "expected"), INVALID)
def test_invalid_requests_are_rejected_and_move_nothing(
    world: Client, service: str, where: str, value: object, expected: str
) -> None:
    request = KINDS[service].Request()
    if service == "place_robot":
        request.pose.pose = pose_of(Pose(1.0, 0.1, 0.0))
    *path, field = where.split(".")
    setattr(functools.reduce(getattr, path, request), field, value)
    response = world.call(KINDS[service], service, request)
    assert not response.success
    assert expected in response.message
    assert world.robot().pose.distance(START) < 0.02
    assert math.hypot(world.ball().x, world.ball().y) < 0.02


def test_invalid_commands_are_reported_and_move_nothing(simulation: Process, world: Client) -> None:
    node, other = simulation, Client(world.domain, "other")
    try:
        words = other.node.create_publisher(String, "/cmd_vel", NEWEST)
        world.eventually(
            lambda: (
                words.publish(String(data="go"))
                or world.command(v=math.nan)
                or "cmd_vel.linear.x" in node.output
            ),
            "a warning",
        )
        world.eventually(
            lambda: world.command(w=math.inf) or "cmd_vel.angular.z" in node.output, "a warning"
        )
    finally:
        other.close()
    assert "Traceback" not in node.output
    assert node.running
    assert world.robot().pose.distance(START) < 0.02


def test_clock_description_and_health_are_published(world: Client) -> None:
    client = world
    clocks = client.listen(Clock, "/clock", SENSOR_DATA)
    client.eventually(lambda: len(clocks) > 5, "the clock")
    description = client.listen(String, "robot_description", LATCHED)
    client.eventually(
        lambda: description and "<robot" in description[0].data,
        "the description, to a late listener",
    )
    assert float(values_of(client.status_of("simulation"))["simulated time (s)"]) > 0.0


def test_topics_for_rviz_and_robot_state_publisher(world: Client) -> None:
    client = world
    client.place(robot=Pose(1.0, -0.5, 2.0), ball=(2.0, 1.0))
    by_default = QoSProfile(depth=10)  # reliable: the default of a subscription
    (commands,) = client.node.get_subscriptions_info_by_topic("/cmd_vel")
    assert commands.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    odometry, balls = (client.listen(Odometry, name, by_default) for name in ("odom", "ball"))
    transforms = client.listen(TFMessage, "tf", by_default)
    joints = client.listen(JointState, "joint_states", by_default)
    client.eventually(lambda: odometry and balls and transforms and joints, "all topics")
    (transform,) = transforms[-1].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y) == pytest.approx((1.0, -0.5), abs=0.01)
    assert yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w) == pytest.approx(2.0, abs=0.01)
    assert list(joints[-1].name) == ["left_wheel_joint", "right_wheel_joint"]
    before = joints[-1].position[0]
    client.eventually(
        lambda: client.command(v=0.3) or joints[-1].position[0] != before, "the wheels turn"
    )
