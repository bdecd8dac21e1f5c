"""Several robots and a ball in one simulation."""

from collections.abc import Iterator

import pytest
from conftest import Host
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_client import Client
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from ator_ros.geometry import Pose
from ator_ros.nodes.parameters import SetupError
from ator_ros.nodes.qos import RESULTS
from ator_ros.nodes.simulation import parameters_for, world_of

NAMES = ("ann", "bob")
EACH_LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of a topic with several latched publishers."""


@pytest.fixture
def pair(domain: int) -> Iterator[dict[str, Client]]:
    clients = {name: Client(domain, name, frame=f"{name}/odom") for name in NAMES}
    yield clients
    for client in clients.values():
        client.close()


def test_each_robot_is_commanded_and_observed_in_its_namespace(
    host: Host, pair: dict[str, Client]
) -> None:
    ann, bob = pair.values()
    transforms = ann.listen(TFMessage, "/tf", RESULTS)
    fixed = ann.listen(TFMessage, "/tf_static", EACH_LATCHED)
    joints = bob.listen(JointState, "joint_states", RESULTS)
    host(
        "simulation",
        robots="[ann, bob]",
        robot_start="[-1.0, 0.0, 0.0, 1.0, 1.0, 3.0]",
        lockstep=True,
    )
    assert ann.robot().pose == pytest.approx(Pose(-1.0, 0.0, 0.0), abs=1e-3)
    assert bob.robot().pose == pytest.approx(Pose(1.0, 1.0, 3.0), abs=1e-3)
    ann.eventually(lambda: ann.robot().vx > 0.1 or ann.command(v=0.3), "ann drives")
    assert abs(bob.robot().vx) < 0.02
    ann.place(ball=(0.5, -1.0))
    for client in pair.values():
        client.eventually(lambda c=client: abs(c.ball().x - 0.5) < 0.01, "one ball for both")
    frames = lambda messages: {  # noqa: E731
        (there.header.frame_id, there.child_frame_id)
        for each in list(messages)
        for there in each.transforms
    }
    wanted = {(f"{name}/odom", f"{name}/base_link") for name in NAMES}
    ann.eventually(lambda: frames(transforms) == wanted, "transforms of both")
    ann.eventually(
        lambda: frames(fixed) == {("world", f"{name}/odom") for name in NAMES}, "one tree"
    )
    assert joints
    assert bob.call(Trigger, "reset").success
    ann.eventually(
        lambda: ann.robot().pose.distance(Pose(-1.0, 0.0, 0.0)) < 0.01, "a new world for all"
    )


def settings(**changes: object) -> dict[str, object]:
    return {item.name: item.default for item in parameters_for(["ball"])} | changes


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"robots": ["ann", "ann"]}, "parameter robots: expected different names"),
        ({"robots": ["ann", ""]}, "parameter robots: expected"),
        ({"robots": ["/ann"]}, "parameter robots: expected"),
        (
            {"robots": ["a", "b"], "robot_start": [0.0, 0.0, 0.0, 1.0]},
            "robot_start: expected finite x",
        ),
        (
            {"robots": ["ann", "bob"], "robot_start": [-2.0, 0.0, 0.0] * 2},
            "robot_start ann: .* robot",
        ),
    ],
)
def test_invalid_settings_are_rejected_at_the_start(
    changes: dict[str, object], expected: str
) -> None:
    with pytest.raises(SetupError, match=expected):
        world_of(settings(**changes))


def test_robots_start_beside_each_other() -> None:
    robots = world_of(settings(robots=["ann", "bob", "eve"])).robots
    starts = {name: Pose(-2.0, y, 0.0) for name, y in (("ann", 0.0), ("bob", 1.0), ("eve", 2.0))}
    assert {robot.name: robot.start for robot in robots} == starts
