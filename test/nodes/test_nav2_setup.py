"""What is found out of a running Nav2, from the parameters of its nodes."""

import copy
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from geometry_msgs.msg import Point32, PolygonStamped
from maps import hall_map
from process import PATIENCE
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from ros_client import Client
from tf2_msgs.msg import TFMessage

from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import stamp_of
from ator_ros.nodes.nav2_setup import (
    CONTROLLER,
    COSTMAP,
    FOOTPRINT,
    NAVIGATOR,
    SMOOTHER,
    Finder,
    Given,
    Nav2Error,
    digest_of_driving,
    facts_of,
    write_files,
)
from ator_ros.nodes.qos import RESULTS
from ator_ros.nodes.simulation import transform_of
from ator_ros_examples.nav2_stand_in import PARAMETERS

CLIENT = {"silent": True}
NAV2: dict[str, dict[str, Any]] = {
    (f"{namespace}/{name}" if namespace else name): dict(values)
    for (name, namespace), values in PARAMETERS.items()
}


def nav2(node: str = "", **changes: Any) -> dict[str, dict[str, Any]]:
    """Return parameters of Nav2's nodes with changes in one; None: it has no such parameter."""
    found = copy.deepcopy(NAV2)
    for name, value in changes.items():
        found[node][name] = value
        if value is None:
            del found[node][name]
    return found


def test_size_frames_tolerances_and_limits_are_found_out() -> None:
    facts = facts_of(nav2(), Given())
    assert (facts.frame, facts.robot_frame, facts.odometry) == ("map", "base_link", "odom")
    assert (facts.front, facts.rear, facts.half_width) == (0.17, 0.17, 0.17)
    assert facts.tolerances == (0.15, 0.15)
    assert facts.limits == (0.75, 1.6, 0.6, 2.5)


def test_the_footprint_is_that_of_the_costmap() -> None:
    outline = "[[0.4, 0.25], [0.4, -0.25], [-0.2, -0.25], [-0.2, 0.25]]"
    facts = facts_of(nav2(COSTMAP, footprint=outline), Given())
    assert (facts.front, facts.rear, facts.half_width) == (0.4, 0.2, 0.25)


OUTLINE = [(0.4, 0.25), (0.4, -0.25), (-0.2, -0.25), (-0.2, 0.25)]


def test_a_published_footprint_counts_before_parameters_and_after_an_argument() -> None:
    facts = facts_of(nav2(), Given(), OUTLINE)
    assert (facts.front, facts.rear, facts.half_width) == (0.4, 0.2, 0.25)
    assert facts_of(nav2(), Given(radius=0.3), OUTLINE).front == 0.3
    facts_of(nav2(COSTMAP, robot_radius=None), Given(), OUTLINE)


class Driven:
    """Publishes the footprint of a robot that drives a curve, and a little later its pose."""

    def __init__(self, client: Client) -> None:
        node = client.node
        self._tf = node.create_publisher(TFMessage, "robot_1/tf", RESULTS)
        self._footprint = node.create_publisher(PolygonStamped, f"robot_1/{FOOTPRINT}", RESULTS)
        self._time = 100.0
        node.create_timer(0.05, self._tick)

    def _tick(self) -> None:
        self._time += 0.05
        driven = self._time - 100.0
        pose = Pose(20.0 + 0.5 * driven, -30.0, 0.7 * driven)
        corners = [pose.compose(Pose(*corner, 0.0)) for corner in OUTLINE]
        message = PolygonStamped()
        message.header.frame_id, message.header.stamp = "odom", stamp_of(self._time)
        message.polygon.points = [Point32(x=each.x, y=each.y) for each in corners]
        self._footprint.publish(message)
        moved = transform_of(self._time, pose, frame="odom", child="base_link")
        self._tf.publish(TFMessage(transforms=[moved]))


@pytest.mark.node
def test_the_footprint_is_found_in_a_namespace_while_the_robot_drives(
    domain: int, client: Client
) -> None:
    Driven(client)
    rclpy.init(args=[], domain_id=domain)
    finder = Finder("robot_1", "map")
    try:
        found = finder.footprint("base_link", PATIENCE)
        missing = finder.footprint("elsewhere", 0.1)
    finally:
        finder.destroy_node()
        rclpy.shutdown()
    assert found == OUTLINE  # to the digit: a digest of it names a folder
    assert not missing


class Starting(LifecycleNode):
    """A node that has its parameters once it is configured, as Nav2's with plugins."""

    def __init__(self, client: Client, name: str, namespace: str, values: dict[str, Any]) -> None:
        self._values = values
        super().__init__(
            name, namespace=f"robot_1/{namespace}".rstrip("/"), context=client.node.context
        )
        client.add(self)

    def on_configure(self, _: Any) -> TransitionCallbackReturn:
        for parameter, value in self._values.items():
            self.declare_parameter(parameter, value)
        return TransitionCallbackReturn.SUCCESS


@pytest.mark.node
def test_nodes_that_are_not_active_have_no_parameters_yet(domain: int, client: Client) -> None:
    described = {**PARAMETERS, ("planner_server", ""): {}, ("global_costmap", "global_costmap"): {}}
    nodes = [Starting(client, *place, values) for place, values in described.items()]
    rclpy.init(args=[], domain_id=domain)
    finder = Finder("robot_1", "map")
    try:
        with pytest.raises(Nav2Error, match="expected bt_navigator to be active, got unconfigured"):
            finder.parameters(0.5)
        timer = client.node.create_timer(0.5, lambda: start(nodes, timer))
        found = finder.parameters(PATIENCE)
    finally:
        finder.destroy_node()
        rclpy.shutdown()
    assert facts_of(found, Given()) == facts_of(nav2(), Given())


def start(nodes: list[Starting], timer: Any) -> None:
    """Configure and activate nodes, once."""
    timer.cancel()
    for node in nodes:
        node.trigger_configure()
        node.trigger_activate()


def test_without_a_velocity_smoother_the_speed_is_that_of_the_controller() -> None:
    found = nav2()
    del found[SMOOTHER]
    assert facts_of(found, Given()).limits[0] == 0.6


@pytest.mark.parametrize(
    ("node", "changes", "argument"),
    [
        (COSTMAP, {"robot_radius": None}, "radius:="),
        (CONTROLLER, {"goal_checker_plugins": []}, "tolerance:="),
        (NAVIGATOR, {"global_frame": None}, "frame:="),
    ],
)
def test_what_cannot_be_found_out_is_one_argument(
    node: str, changes: dict[str, Any], argument: str
) -> None:
    with pytest.raises(Nav2Error, match=f"got none; start Nav2, or set {argument}"):
        facts_of(nav2(node, **changes), Given())
    given = Given(radius=0.3, tolerance=0.2, frame="map")
    facts = facts_of(nav2(node, **changes), given)
    assert (facts.half_width, facts.tolerances, facts.frame) == (0.3, (0.2, 0.2), "map")


def test_other_ways_to_drive_have_another_folder() -> None:
    facts = facts_of(nav2(), Given())
    same = nav2(CONTROLLER, use_sim_time=True)
    assert digest_of_driving(same, facts) == digest_of_driving(nav2(), facts)
    for changed in (
        nav2(CONTROLLER, **{"FollowPath.desired_linear_vel": 0.5}),
        nav2(COSTMAP, **{"inflation_layer.inflation_radius": 0.4}),  # paths keep off walls
        nav2(NAVIGATOR, default_nav_to_pose_bt_xml="without_replanning.xml"),
    ):
        assert digest_of_driving(changed, facts) != digest_of_driving(nav2(), facts)


def test_the_files_describe_robot_domain_and_nodes(tmp_path: Path) -> None:
    write_files(facts_of(nav2(), Given()), hall_map("map"), tmp_path, "map")
    robot = load_robot(tmp_path / "robot.yaml")
    assert (robot.front, robot.half_width, robot.greatest_speed()) == (0.17, 0.17, 0.75)
    (top,) = find_domain(str(tmp_path / "stations.yaml")).tops
    assert [term.tolerance for term in top.post.terms] == [0.2, 0.2, 0.2]
    text = (tmp_path / "nav2.yaml").read_text(encoding="utf-8")
    assert "&" not in text  # ROS reads no aliases
    nodes = yaml.safe_load(text)
    assert nodes["/**"]["ros__parameters"]["frame"] == "map"
    assert set(nodes) == {"/**", *(f"/**/{name}" for name in (
        "watch", "learning", "executor", "waypoints", "refinement"
    ))}  # fmt: skip
