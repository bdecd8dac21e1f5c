"""Finds out what our nodes need to know of a running Nav2, and writes their files.

    python3 -m ator_ros.start commands.nav2_setup --folder FOLDER --namespace robot_1

It reads parameters of Nav2's nodes, the footprint of a costmap, and the map. It prints the folder
that it wrote, a part of FOLDER: each set of the parameters that change how Nav2 drives has one of
its own, since drives with other parameters take other times.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
import yaml
from geometry_msgs.msg import PolygonStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions

from ator_ros.bases.description import ConfigError, robot_of
from ator_ros.files import read_yaml, write_text
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import grid_from
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.nodes.subscriptions import TfListener
from ator_ros.printable import ReadableError, one_line, printable, quoted
from ator_ros.resources import resource_path
from ator_ros.world.grid_map import GridMap, save_map
from ator_ros.world.readers import plain_frame, seconds_from

FOLDER = "~/.ros/ator_ros/nav2"
NAVIGATOR = "bt_navigator"
CONTROLLER = "controller_server"
SMOOTHER = "velocity_smoother"
PLANNER = "planner_server"
COSTMAP = "local_costmap/local_costmap"
_GLOBAL_COSTMAP = "global_costmap/global_costmap"
ROBOT_FILE = "robot.yaml"
DOMAIN_FILE = "stations.yaml"
MAP_FILE = "map.yaml"
"""Files in a folder that `set_up` returns."""
FOOTPRINT = "local_costmap/published_footprint"
DRIVING_NODES = (NAVIGATOR, CONTROLLER, SMOOTHER, PLANNER, COSTMAP, _GLOBAL_COSTMAP)
"""Nodes whose parameters change how Nav2 drives, and so how long drives take."""
_OF_ROS = ("use_sim_time", "qos_overrides", "start_type_description_service")
_SPEEDS = ("desired_linear_vel", "max_vel_x", "vx_max")  # of controllers, in m/s
# Defaults of Nav2's velocity smoother, where it does not run: m/s, rad/s, m/s^2, rad/s^2.
_USUAL = (0.5, 2.5, 2.5, 3.2)
_BESIDE = 0.05  # m and rad by which poses reached may be off beyond Nav2's tolerances
_ANSWER = 5.0  # real s that an answer of a node may take
_DISCOVERY = 3.0  # real s in which DDS finds a node, once it has found others of Nav2
_ANNOUNCEMENT = 0.3  # real s in which DDS announces further services of a node that it has found
_SPIN = 0.1
_DIGITS = 4  # of published corners in m: those of two starts differ by single precision only


class Nav2Error(ReadableError):
    """Something of Nav2 that cannot be found out; the message names the launch argument."""


@dataclass(frozen=True)
class Given:
    """What the user has given instead; empty or 0: to be found out.

    Attributes
    ----------
    radius : float
        Of the robot in m.
    speed : float
        Greatest speed in m/s.
    tolerance : float
        Within which goals are reached, in m and rad.
    frame : str
        Of map and goals.
    """

    radius: float = 0.0
    speed: float = 0.0
    tolerance: float = 0.0
    frame: str = ""


Parameters = Mapping[str, Mapping[str, Any]]
"""Parameters of Nav2's nodes by name, by the names of the nodes; a node may be missing."""


@dataclass(frozen=True)
class Facts:
    """What is known of a robot that Nav2 drives.

    Attributes
    ----------
    frame, robot_frame : str
        Of map and goals, and of the robot.
    odometry : str
        The topic.
    front, rear, half_width : float
        Of the robot in m, from the origin of its frame.
    limits : tuple of float
        Greatest speed (m/s), turn rate (rad/s), and their accelerations (m/s², rad/s²).
    tolerances : tuple of float
        Within which Nav2 reaches a goal, in m and rad.
    """

    frame: str
    robot_frame: str
    odometry: str
    front: float
    rear: float
    half_width: float
    limits: tuple[float, float, float, float]
    tolerances: tuple[float, float]


Outline = Sequence[tuple[float, float]]
"""The corners of a footprint in m, in the frame of the robot."""


def facts_of(parameters: Parameters, given: Given, footprint: Outline = ()) -> Facts:
    """Return what is known of the robot; raise Nav2Error for what is unknown.

    `footprint` is the one that a costmap publishes, if it does.
    """
    navigator = parameters.get(NAVIGATOR, {})
    front, rear, half_width = _size(parameters.get(COSTMAP, {}), given.radius, footprint)
    return Facts(
        _map_frame(parameters, given),
        _robot_frame(parameters),
        str(navigator.get("odom_topic", "odom")),
        front,
        rear,
        half_width,
        _limits(parameters, given.speed),
        _tolerances(parameters.get(CONTROLLER, {}), given.tolerance),
    )


def _map_frame(parameters: Parameters, given: Given) -> str:
    frame = given.frame or str(parameters.get(NAVIGATOR, {}).get("global_frame", ""))
    if not frame:
        raise Nav2Error(
            f"nav2: expected the parameter global_frame of {NAVIGATOR}, got none; start Nav2, or "
            "set frame:=map"
        )
    return plain_frame(frame)


def _robot_frame(parameters: Parameters) -> str:
    return plain_frame(str(parameters.get(NAVIGATOR, {}).get("robot_base_frame", "base_link")))


def _size(
    costmap: Mapping[str, Any], radius: float, footprint: Outline
) -> tuple[float, float, float]:
    """Return front, rear and half of the width in m.

    They are given by a radius, by the published footprint, or by the costmap's parameters.
    """
    outline = footprint or _described_outline(costmap)
    if radius > 0.0 or len(outline) < 3:
        around = radius if radius > 0.0 else float(costmap.get("robot_radius", 0.0))
        outline = [(around, around), (-around, -around)]
    front = max(x for x, _ in outline)
    rear = -min(x for x, _ in outline)
    half_width = max(abs(y) for _, y in outline)
    if min(front, rear, half_width) <= 0.0:
        raise Nav2Error(
            f"nav2: expected a footprint on {FOOTPRINT}, or the parameter footprint or "
            f"robot_radius of {COSTMAP}, got none; start Nav2, or set radius:=METERS"
        )
    return front, rear, half_width


def _described_outline(costmap: Mapping[str, Any]) -> Outline:
    """Return the parameter footprint of a costmap; empty without a usable one."""
    try:
        corners = yaml.safe_load(str(costmap.get("footprint", "")) or "[]")
        return [(float(x), float(y)) for x, y in corners or ()]
    except (TypeError, ValueError, yaml.YAMLError):
        return []


def _limits(parameters: Parameters, speed: float) -> tuple[float, float, float, float]:
    """Return the limits of the velocity smoother, or those of a usual robot.

    They bound what is plausible; how fast the robot really drives is learned.
    """
    smoother = parameters.get(SMOOTHER, {})
    v, w, a, aw = _USUAL
    if "max_velocity" in smoother and "max_accel" in smoother:
        v, w = (abs(float(smoother["max_velocity"][number])) for number in (0, 2))
        a, aw = (abs(float(smoother["max_accel"][number])) for number in (0, 2))
    else:
        controller = parameters.get(CONTROLLER, {})
        found = [
            float(value)
            for name, value in controller.items()
            if name.rpartition(".")[2] in _SPEEDS and isinstance(value, float) and value > 0.0
        ]
        v = max(found, default=v)
    return (speed or v), w, a, aw


def _tolerances(controller: Mapping[str, Any], given: float) -> tuple[float, float]:
    """Return the greatest tolerances in m and rad of the goal checkers."""
    if given > 0.0:
        return given, given
    checkers = controller.get("goal_checker_plugins", [])
    found = [
        max(
            (float(controller.get(f"{checker}.{name}", 0.0)) for checker in checkers),
            default=0.0,
        )
        for name in ("xy_goal_tolerance", "yaw_goal_tolerance")
    ]
    if min(found) <= 0.0:
        raise Nav2Error(
            f"nav2: expected xy_goal_tolerance and yaw_goal_tolerance of a goal checker in "
            f"{CONTROLLER}, got none; start Nav2, or set tolerance:=0.25"
        )
    return found[0], found[1]


def digest_of_driving(parameters: Parameters, facts: Facts) -> str:
    """Return a short digest of what changes how Nav2 drives, and of the robot's size."""
    driving = {
        node: {
            name: value
            for name, value in sorted(parameters.get(node, {}).items())
            if not name.startswith(_OF_ROS)
        }
        for node in DRIVING_NODES
    }
    size = [facts.front, facts.rear, facts.half_width, *facts.limits]
    text = json.dumps([driving, size], default=str, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def write_files(facts: Facts, grid: GridMap, folder: Path, topic: str) -> None:
    """Write the files `ROBOT_FILE` and so on, and nav2.yaml into a folder; raises OSError.

    `topic` is that of the map. Raises Nav2Error if the robot's sizes or limits are impossible.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "models").mkdir(exist_ok=True)  # those of the start: none
    save_map(grid, folder)  # for tools
    extent = _extent(grid)
    robot = _robot(facts, extent)
    try:
        robot_of(robot)
    except ConfigError as error:
        raise Nav2Error(f"nav2: {error}; set radius:=METERS or speed:=METERS_PER_SECOND") from error
    write_text(folder / ROBOT_FILE, yaml.safe_dump(robot, sort_keys=False))
    domain = read_yaml(resource_path("config", "nav2", "stations.yaml"), largest=100_000)
    for term in domain["tops"][0]["post"]:
        turns = term["variable"] == "robot.yaw"
        term["tolerance"] = round(facts.tolerances[turns] + _BESIDE, 3)
    write_text(folder / DOMAIN_FILE, yaml.safe_dump(domain, sort_keys=False))
    write_text(
        folder / "nav2.yaml",
        yaml.safe_dump(_node_parameters(facts, extent, folder, topic), sort_keys=False),
    )


def _robot(facts: Facts, extent: Sequence[float]) -> dict[str, Any]:
    v, w, a, aw = facts.limits
    least_x, least_y, most_x, most_y = extent
    return {
        "robot": {
            "name": "robot",
            "front": round(facts.front, 4),
            "rear": round(facts.rear, 4),
            "half_width": round(facts.half_width, 4),
            "limits": {"v": v, "w": w, "a": a, "brake": a, "aw": aw},
        },
        "scene": {
            "area": {
                "length": most_x - least_x,
                "width": most_y - least_y,
                "margin": 0.001,
                "x": 0.5 * (least_x + most_x),
                "y": 0.5 * (least_y + most_y),
            },
            "objects": {},
        },
    }


def _extent(grid: GridMap) -> tuple[float, float, float, float]:
    """Return least x and y, greatest x and y of a map in m."""
    rows, columns = grid.free.shape
    corners = [
        grid.origin.compose(Pose(x * grid.resolution, y * grid.resolution, 0.0))
        for x in (0, columns)
        for y in (0, rows)
    ]
    xs = [corner.x for corner in corners]
    ys = [corner.y for corner in corners]
    return min(xs), min(ys), max(xs), max(ys)


def _node_parameters(
    facts: Facts, extent: Sequence[float], folder: Path, topic: str
) -> dict[str, Any]:
    from_tf = {
        "robot_from": "tf",
        "robot_frame": facts.robot_frame,
        "fence": _fence(extent),
    }
    sections: dict[str, dict[str, Any]] = {
        "/**": {
            "domain": str(folder / DOMAIN_FILE),
            "robot": str(folder / ROBOT_FILE),
            "map": topic,
            "frame": facts.frame,
            "models": str(folder / "models"),
            "learned": str(folder / "learned"),
        },
        "/**/watch": {
            "watched": str(folder),
            "odometry": facts.odometry,
            "planner": "compute_path_to_pose",
        },
        "/**/learning": {"watched": str(folder), "records": ["watch/action"], "batch": 10},
        "/**/executor": {**from_tf, "action_timeout": 200.0},
        "/**/waypoints": {**from_tf, "fence": _fence(extent)},
        "/**/refinement": {
            "fence": _fence(extent),
            "planner": "compute_path_to_pose",
            "deadline": 0.3,
        },
    }
    return {name: {"ros__parameters": values} for name, values in sections.items()}


def _fence(extent: Sequence[float]) -> list[float]:
    """Return a new list: in YAML one that occurs twice is an alias, which ROS does not read."""
    return [float(round(edge, 3)) for edge in extent]


class Finder(Node):
    """Reads the parameters of Nav2's nodes, the footprint and the map."""

    def __init__(self, namespace: str, topic: str) -> None:
        super().__init__(
            "nav2_setup",
            namespace=namespace,
            cli_args=["--ros-args", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"],
            start_parameter_services=False,
        )
        self._map: OccupancyGrid | None = None
        self._footprint: PolygonStamped | None = None
        self._tf = TfListener(self)
        self._topic = topic
        self.create_subscription(OccupancyGrid, topic, self._take_map, LATCHED)
        self.create_subscription(PolygonStamped, FOOTPRINT, self._take_footprint, RESULTS)

    def _take_map(self, message: OccupancyGrid) -> None:
        self._map = message

    def _take_footprint(self, message: PolygonStamped) -> None:
        self._footprint = message

    def footprint(self, robot_frame: str, wait: float) -> Outline:
        """Return the published footprint; empty if it is not known within `wait` real s.

        It is published where the robot is, so it needs the robot's pose in tf.
        """
        end = time.monotonic() + wait
        while time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=_SPIN)
            message = self._footprint
            if message is None:
                continue
            frame = plain_frame(message.header.frame_id)
            pose = self._tf.pose_at(frame, robot_frame, seconds_from(message.header.stamp))
            if pose is not None:
                corners = [Pose(each.x, each.y, 0.0) for each in message.polygon.points]
                local = [pose.relative(corner) for corner in corners]
                return [(round(x, _DIGITS), round(y, _DIGITS)) for x, y, _ in local]
        return ()

    def map(self, wait: float) -> GridMap:
        """Return the map; raise Nav2Error if none comes within `wait` real s."""
        end = time.monotonic() + wait
        while self._map is None and time.monotonic() < end:
            rclpy.spin_once(self, timeout_sec=_SPIN)
        if self._map is None:
            raise Nav2Error(
                f"nav2: expected a map on {quoted(self._topic)} within {wait:g} s, got none; "
                "start map_server, or set map:=TOPIC"
            )
        return grid_from(self._map, self._topic, frame=self._map.header.frame_id)

    def parameters(self, wait: float) -> dict[str, dict[str, Any]]:
        """Return the parameters of Nav2's nodes; those that are missing after `wait` s are not."""
        clients = {name: AsyncParameterClient(self, name) for name in DRIVING_NODES}
        end = time.monotonic() + wait
        needed = (NAVIGATOR, CONTROLLER, COSTMAP)
        self._wait_for([clients[name] for name in needed], end)
        self._wait_until_active(needed, end)
        # Without one of the others, its parameters would seem to have changed.
        self._wait_for(list(clients.values()), min(end, time.monotonic() + _DISCOVERY))
        ready = {name: client for name, client in clients.items() if client.services_are_ready()}
        self._wait_until_active(ready, end)
        return {name: self._read(client) for name, client in ready.items()}

    def _wait_for(self, clients: Sequence[AsyncParameterClient], end: float) -> None:
        """Wait until all nodes are there, at most until a real time in s."""
        while time.monotonic() < end and not all(each.services_are_ready() for each in clients):
            rclpy.spin_once(self, timeout_sec=_SPIN)

    def _wait_until_active(self, names: Iterable[str], end: float) -> None:
        """Wait until the nodes with a life cycle are active, at most until a real time in s.

        Before, they lack the parameters of their plugins. Raises Nav2Error for one that is not.
        """
        clients = {name: self.create_client(GetState, f"{name}/get_state") for name in names}
        announced = min(end, time.monotonic() + _ANNOUNCEMENT)
        while time.monotonic() < announced:
            rclpy.spin_once(self, timeout_sec=_SPIN)
        for name, client in clients.items():
            while client.service_is_ready():
                answer = self._answer(client.call_async(GetState.Request()))
                state = answer.current_state if answer is not None else State(label="unknown")
                if state.id == State.PRIMARY_STATE_ACTIVE:
                    break
                if time.monotonic() > end:
                    raise Nav2Error(
                        f"nav2: expected {name} to be active, got {printable(state.label)}; "
                        "activate Nav2, or set a longer wait:=SECONDS"
                    )
                rclpy.spin_once(self, timeout_sec=_SPIN)
            self.destroy_client(client)

    def _read(self, client: AsyncParameterClient) -> dict[str, Any]:
        listed = self._answer(client.list_parameters())
        names = [] if listed is None else list(listed.result.names)
        answer = self._answer(client.get_parameters(names)) if names else None
        if answer is None:
            return {}
        values = map(parameter_value_to_python, answer.values)
        return {
            name: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
            for name, value in zip(names, values, strict=True)
        }

    def _answer(self, future: Any) -> Any:
        rclpy.spin_until_future_complete(self, future, timeout_sec=_ANSWER)
        return future.result() if future.done() else None


def set_up(
    namespace: str = "",
    folder: str = FOLDER,
    given: Given = Given(),
    *,
    topic: str = "map",
    wait: float = 60.0,
) -> Path:
    """Find out about the Nav2 of a namespace, and return the folder with the files.

    That is a part of `folder`, which has one for each robot and way to drive. `topic` is that of
    the map, `wait` are the real s in which Nav2 must answer. Raises Nav2Error, OSError, and
    ValueError for a name that ROS does not allow.
    """
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C raises
    try:
        finder = Finder(namespace, topic)
        try:
            parameters = finder.parameters(wait)
            _map_frame(parameters, given)  # fails at once where Nav2 does not run
            # The map comes first, as the costmap publishes its footprint later.
            grid = finder.map(wait)
            footprint: Outline = ()
            if not given.radius:
                footprint = finder.footprint(_robot_frame(parameters), _DISCOVERY)
            facts = facts_of(parameters, given, footprint)
        finally:
            finder.destroy_node()
    finally:
        rclpy.try_shutdown()
    whole = Path(folder).expanduser() / (namespace.strip("/") or "robot")
    part = whole / digest_of_driving(parameters, facts)
    write_files(facts, grid, part, topic)
    return part


def main(argv: Sequence[str] | None = None) -> None:
    """Print the folder with the files, without a newline; end with one line if that fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", default=FOLDER)
    parser.add_argument("--namespace", default="")
    parser.add_argument("--map", default="map", help="topic of the map")
    parser.add_argument("--frame", default="")
    for name in ("radius", "speed", "tolerance"):
        parser.add_argument(f"--{name}", type=float, default=0.0)
    parser.add_argument("--wait", type=float, default=60.0, help="real s to wait for Nav2")
    options = parser.parse_args(argv)
    numbers = (options.radius, options.speed, options.tolerance)
    if not all(map(math.isfinite, numbers)):
        sys.exit("nav2: expected finite numbers as radius, speed and tolerance")
    given = Given(options.radius, options.speed, options.tolerance, options.frame)
    wait = max(0.0, options.wait)
    try:
        made = set_up(options.namespace, options.folder, given, topic=options.map, wait=wait)
    except (Nav2Error, OSError, ValueError) as error:
        sys.exit(one_line(error))
    sys.stdout.write(str(made))
