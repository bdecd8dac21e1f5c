"""The node `simulation`: simulated robots and the objects of a domain on ROS."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped, Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import domain_for
from ator_ros.files import is_name
from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health, Ticks, Warnings
from ator_ros.nodes.main_loop import run_node
from ator_ros.nodes.messages import object_odometry_of, occupancy_grid_of, odometry_of, stamp_of
from ator_ros.nodes.parameters import (
    FRAMES,
    OBJECT,
    WORLD,
    Parameter,
    SetupError,
    declare_with_domain,
    domain_and_robot,
    live,
    map_topic,
)
from ator_ros.nodes.qos import LATCHED, NEWEST, RESULTS, SENSOR_DATA, SERVICES
from ator_ros.nodes.simulated_world import SimulatedRobot, SimulatedWorld
from ator_ros.printable import quoted
from ator_ros.simulation.scene_simulation import TICK
from ator_ros.simulation.sensors import ObjectErrors, SensorConfig, Sensors
from ator_ros.simulation.urdf import robot_urdf, wheel_names
from ator_ros.world import readers as checks
from ator_ros.world.readers import MessageError
from ator_ros.world.scene import Area
from ator_ros.world.state import STOP, Command

_COMMON = (
    *FRAMES,
    *WORLD,
    Parameter(
        "robots", [""], "names of the robots, namespaces of their topics and frames; '': none"
    ),
    live("real_time_factor", 1.0, "simulated per real seconds; 0: as fast as possible", 0.0, 100.0),
    live(
        "command_wait",
        0.2,
        "real s that a tick waits for a command; less than the executor's odom_timeout",
        0.0,
        10.0,
    ),
    Parameter("lockstep", False, "whether ticks wait for commands at any real_time_factor"),
    Parameter("publish_clock", False, "whether to publish the simulated time on /clock"),
    Parameter(
        "robot_start",
        [-2.0, 0.0, 0.0],
        "x, y (m, from the area's center), yaw of each robot after a reset; else beside the last",
    ),
    Parameter("seed", 0, "of the sensors' noise", 0, 2**31 - 1),
    Parameter("drift", 0.0, "odometry's position error in m after 1 m of driving", 0.0, 1.0),
    Parameter(
        "heading_drift", 0.0, "odometry's heading error in rad after 1 m of driving", 0.0, 1.0
    ),
    Parameter(
        "latency", 0.0, "simulated s after which odom and objects come, with their stamps", 0.0, 0.3
    ),
)
_ERRORS = tuple(field.name for field in dataclasses.fields(ObjectErrors))
_ASIDE = 1.0  # m between the default starts of objects, and of robots
_FASTEST_PERIOD = 0.0005  # real s between ticks as fast as possible: less than a tick takes
_LONGEST_PERIOD = 60.0  # real s between ticks, so that a smaller factor can still be changed
_PAUSED_PERIOD = 0.05  # real s between two messages of a paused world
_REAL_TIME_TICKS = round(5.0 / TICK)  # ticks at real-time speed after the last command has expired
_WORLD_FRAME = "world"  # in which the robots of one simulation start


class SimulationNode(Node):
    """Simulates one robot, or several, in one world; 20 ticks a second of simulated time.

    If `robots` names robots, each has the following topics and services in the namespace of its
    name, and its frames start with the name. `reset`, `pause` and the objects are those of the
    whole world.

    Subscribes to
        cmd_vel (geometry_msgs/Twist): clipped to the robot's limits; it stands 0.5 s after the last
        command.
    Publishes, every tick, as the robot's sensors observe it, stamped with the simulated time of
    observation
        odom (nav_msgs/Odometry): the robot's point, twist in the robot's frame. NAME of each
        object of the scene (nav_msgs/Odometry): position and velocity, both in the header's frame;
        nothing while the object is not there. joint_states (sensor_msgs/JointState), and tf
        (tf2_msgs/TFMessage) from the frame of odometry to the robot's own, if there are
        subscribers; robot_description (std_msgs/String, transient local): URDF. tf_static
        (tf2_msgs/TFMessage, transient local), of robots with names: from `world` to odometry. map
        (nav_msgs/OccupancyGrid, transient local), if it has one: the walls that are simulated.
        /clock (rosgraph_msgs/Clock), with `publish_clock`: every tick. /diagnostics
        (diagnostic_msgs/DiagnosticArray): once a second.
    Services
        place_robot, and place_NAME of each object (ator_interfaces): teleport, with a velocity.
        reset (std_srvs/Trigger): a new world; simulated time starts at 0 again.
        pause (std_srvs/SetBool): stop and resume simulated time; a paused world is still published.

    Faster than real time, and with `lockstep`, a tick waits up to `command_wait` for the next
    command while one is in effect, which keeps the controller in step on a busy machine. With
    several robots it waits only for those that are commanded to move, and for a shorter time the
    more there are. For five seconds after the last command has expired, time passes no faster than
    in reality.
    """

    def __init__(self) -> None:
        super().__init__("simulation", automatically_declare_parameters_from_overrides=True)
        self._settings = settings = declare_with_domain(self, parameters_for)
        self._world = world_of(settings)
        self._paused = False
        self._warn = Warnings(self)
        self._deadline = 0.0  # real time in s of the next tick
        # next ticks that take as long as in reality, unless a command comes
        self._real_time_ticks = 0
        self._ticks = Ticks()
        self._awaited: set[int] = set()
        is_clock = settings["publish_clock"]
        self._clock_publisher = (
            self.create_publisher(Clock, "/clock", SENSOR_DATA) if is_clock else None
        )
        self._topics = [self._topics_of(number) for number in range(len(self._world.robots))]
        factor = settings["real_time_factor"]
        self._timer = self.create_timer(_period_at(factor), self._tick, clock=STEADY)
        commands = {topics.resolved("cmd_vel"): Twist for topics in self._topics}
        Diagnostics(self, self._health, commands)
        speed = f"at {factor:g} times real time" if factor else "as fast as possible"
        robot = self._world.robot
        names = ", ".join(each.name for each in self._world.robots)
        domain = domain_for(settings["domain"], settings["robot"]).name
        self.get_logger().info(
            f"simulating {robot.name}{f' as {names}' if names else ''} {speed} (domain {domain}, "
            f"ROS domain {self.context.get_domain_id()}): cmd_vel to "
            f"{', '.join(('odom', *robot.scene.objects))}"
        )

    def _topics_of(self, number: int) -> RobotTopics:
        topics = RobotTopics(self, self._world.robot, self._world.robots[number], self._settings)
        command = partial(self._command, number)
        self.create_subscription(Twist, topics.resolved("cmd_vel"), command, SENSOR_DATA)
        services: dict[str, tuple[type[Any], Callable[[Any], str]]] = {
            "place_robot": (PlaceRobot, partial(self._place_robot, number)),
            "reset": (Trigger, self._reset),
            "pause": (SetBool, self._pause),
        }
        for name in self._world.robot.scene.objects:
            services[f"place_{name}"] = PlaceObject, partial(self._place_object, number, name)
        for name, (kind, handle) in services.items():
            callback = partial(self._serve, handle)
            self.create_service(kind, topics.resolved(name), callback, qos_profile=SERVICES)
        return topics

    def _tick(self) -> None:
        now = time.monotonic()
        period = round(1e9 * _period_at(self._settings["real_time_factor"]))
        if period != self._timer.timer_period_ns:
            self._deadline = 0.0
            self._real_time_ticks = 0
            self._timer.timer_period_ns = period
            self._timer.reset()
        if now < self._deadline:
            return
        if self._paused:
            self._deadline = now + _PAUSED_PERIOD
        else:
            self._ticks.start(now)
            for name in self._world.tick():
                self.get_logger().debug(
                    f"{self._world.simulation.time:.2f} s: {name or 'robot'} stands"
                )
            self._ticks.end(time.monotonic())
            self._schedule(now)
        self._publish()

    def _schedule(self, now: float) -> None:
        """Set the earliest time of the next tick; the timer may fire before."""
        factor = self._settings["real_time_factor"]
        wait = self._settings["command_wait"]
        is_fast = not 0.0 < factor <= 1.0
        self._awaited = self._world.awaited() if is_fast or self._settings["lockstep"] else set()
        if self._awaited:
            self._deadline = now + wait / len(self._topics)
            self._real_time_ticks = _REAL_TIME_TICKS if wait > 0.0 and is_fast else 0
        elif self._real_time_ticks > 0:
            self._real_time_ticks -= 1
            self._deadline = max(self._deadline, now - TICK) + TICK

    def _publish(self) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=stamp_of(self._world.simulation.time)))
        for number, topics in enumerate(self._topics):
            topics.publish(self._world.simulation.wheel_angles(number))

    def _command(self, number: int, message: Twist) -> None:
        try:
            command = checks.command_from(message, self._topics[number].resolved("cmd_vel"))
            self._world.simulation.command(command, number=number)
        except MessageError as error:
            self._warn(f"ignored: {error}")
            return
        self.get_logger().debug(f"{self._world.simulation.time:.2f} s: {command}")
        if number not in self._awaited and command == STOP:
            return  # stop commands do not advance the clock
        self._awaited.discard(number)
        if not (self._paused or self._awaited):
            self._deadline = 0.0

    def _serve(self, handle: Callable[[Any], str], request: Any, response: Any) -> Any:
        """Answer a request with the text that `handle` returns, or with its error."""
        try:
            response.message = handle(request)
            response.success = True
            self._publish()
        except MessageError as error:
            response.message = str(error)
            response.success = False
            self._warn(f"ignored: {error}")
        return response

    def _place_robot(self, number: int, request: PlaceRobot.Request) -> str:
        frame = self._topics[number].frame
        checks.expect_frame(request.pose.header.frame_id, "pose.header.frame_id", expected=frame)
        pose = checks.pose_from(request.pose.pose, "pose.pose")
        self._world.place_robot(pose, number, Command(request.vx, request.w, vy=request.vy))
        who = self._world.robots[number].name or "robot"
        return f"{who} at x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.yaw:.3f} rad"

    def _place_object(self, number: int, name: str, request: PlaceObject.Request) -> str:
        if request.remove:
            self._world.remove_object(name)
            return f"{name} removed"
        frame = self._topics[number].frame
        checks.expect_frame(
            request.position.header.frame_id, "position.header.frame_id", expected=frame
        )
        point = request.position.point
        velocity = request.velocity
        self._world.place_object(name, point.x, point.y, vx=velocity.x, vy=velocity.y)
        return f"{name} at x {point.x:.3f} m, y {point.y:.3f} m"

    def _reset(self, _: Trigger.Request) -> str:
        self._world.reset()
        self._deadline = 0.0
        self._real_time_ticks = 0
        return "a new world, simulated time 0"

    def _pause(self, request: SetBool.Request) -> str:
        self._paused = bool(request.data)
        self._deadline = 0.0
        return "paused" if self._paused else "running"

    def _health(self) -> Health:
        values = {
            "simulated time (s)": f"{self._world.simulation.time:.2f}",
            "paused": self._paused,
        }
        return Health(values={**values, **self._ticks.diagnostics(), "last error": self._warn.last})


def _period_at(factor: float) -> float:
    """Return the real s between ticks."""
    return min(TICK / factor, _LONGEST_PERIOD) if factor else _FASTEST_PERIOD


def parameters_for(objects: Sequence[str]) -> tuple[Parameter, ...]:
    """Return the parameters of the node, among them five for each of the `objects`."""
    parameters = list(_COMMON)
    for place, name in enumerate(objects):
        start = f"position of the {name} after a reset: x, y in m from the area's center"
        parameters += [
            Parameter(f"{name}_start", [0.0, _ASIDE * place], start),
            Parameter(f"{name}_noise", 0.0, f"error of the {name}'s coordinates in m", 0.0, 1.0),
            Parameter(
                f"{name}_velocity_noise", 0.0, f"error of the {name}'s velocity in m/s", 0.0, 1.0
            ),
            Parameter(
                f"{name}_delay", 0.0, f"age of what is known of the {name} in simulated s", 0.0, 5.0
            ),
            Parameter(
                f"{name}_dropouts",
                0.0,
                f"probability that the {name} is not seen in a tick",
                0.0,
                0.99,
            ),
        ]
    return tuple(parameters)


def world_of(settings: Mapping[str, Any]) -> SimulatedWorld:
    """Return the world at its start.

    The sensor errors of its robots are independent. Raises SetupError.
    """
    if topic := map_topic(settings):
        raise SetupError(f"parameter map: expected a file (.yaml), got the topic {quoted(topic)}")
    (_, robot) = domain_and_robot(settings)
    names = settings["robots"]
    if len(set(names)) < len(names) or not all(
        is_name(name) for name in names if name or len(names) > 1
    ):
        expected = "expected different names of letters, digits and _"
        raise SetupError(f"parameter robots: {expected}, got {quoted(list(names))}")
    scene = robot.scene
    errors = {
        name: {kind: settings[f"{name}_{kind}"] for kind in _ERRORS} for name in scene.objects
    }
    objects = {name: ObjectErrors(**values) for name, values in errors.items()}
    config = SensorConfig(
        settings["drift"], settings["heading_drift"], settings["latency"], objects
    )
    starts = _starts(settings["robot_start"], len(names), scene.area)
    robots = [
        SimulatedRobot(name, Sensors(config, settings["seed"] + number), start)
        for number, (name, start) in enumerate(zip(names, starts, strict=True))
    ]
    try:
        places = {}
        for name in scene.objects:
            start = settings[f"{name}_start"]
            checks.count(start, f"parameter {name}_start", least=2, most=2)
            places[name] = scene.area.at(*start)[:2]
        return SimulatedWorld(robot, robots, places)
    except MessageError as error:
        raise SetupError(str(error)) from error


def _starts(numbers: Sequence[float], count: int, area: Area) -> list[Pose]:
    """Return the start of each robot.

    Those that are not given start `_ASIDE` to the left of the one before.
    """
    if (
        len(numbers) % 3
        or not 3 <= len(numbers) <= 3 * count
        or not all(map(math.isfinite, numbers))
    ):
        expected = f"expected finite x, y and yaw of 1 to {count} robots"
        raise SetupError(f"parameter robot_start: {expected}, got {list(numbers)}")
    starts = [area.at(*numbers[at : at + 3]) for at in range(0, len(numbers), 3)]
    while len(starts) < count:
        starts.append(starts[-1].compose(Pose(0.0, _ASIDE, 0.0)))
    return starts


class RobotTopics:
    """Publishes the observations of one robot's sensors, tf, joint states and the URDF.

    Topics and frames start with the robot's name, except /tf, in which `world` is the parent of the
    frames.
    """

    def __init__(
        self, node: Node, description: Robot, robot: SimulatedRobot, settings: Mapping[str, Any]
    ) -> None:
        self._robot = robot
        self._scene = description.scene
        self.frame, self.robot_frame = map(
            self.resolved, (settings["frame"], settings["robot_frame"])
        )
        self._odom = node.create_publisher(Odometry, self.resolved("odom"), NEWEST)
        topics = {name: self.resolved(name) for name in self._scene.objects}
        self._objects = {
            name: node.create_publisher(Odometry, at, NEWEST) for name, at in topics.items()
        }
        self._wheel_names = wheel_names(description)
        self._joints = node.create_publisher(JointState, self.resolved("joint_states"), RESULTS)
        self._tf = node.create_publisher(TFMessage, "tf", RESULTS)
        if robot.name:
            self._fixed = node.create_publisher(TFMessage, "tf_static", LATCHED)
            origin = transform_of(0.0, Pose(0.0, 0.0, 0.0), frame=_WORLD_FRAME, child=self.frame)
            self._fixed.publish(TFMessage(transforms=[origin]))
        self._description = node.create_publisher(
            String, self.resolved("robot_description"), LATCHED
        )
        self._description.publish(String(data=robot_urdf(description)))
        if description.grid is not None:
            self._map = node.create_publisher(OccupancyGrid, self.resolved("map"), LATCHED)
            self._map.publish(occupancy_grid_of(description.grid, frame=self.frame))

    def resolved(self, name: str) -> str:
        """Return the name of a topic, a service or a frame of this robot."""
        return f"{self._robot.name}/{name}" if self._robot.name else name

    def publish(self, wheels: list[float]) -> None:
        """Publish the last observation, and the angles of the wheels in rad."""
        world = self._robot.observed
        state = self._robot.observed.robot
        # Objects first: subscribers that act on odom then have the objects of the same tick.
        for name, there in world.objects.items():
            message = object_odometry_of(
                world.time, there, frame=self.frame, height=self._scene.radius(name)
            )
            self._objects[name].publish(message)
        self._odom.publish(odometry_of(world.time, state, frame=self.frame, child=self.robot_frame))
        if self._tf.get_subscription_count():
            there = transform_of(world.time, state.pose, frame=self.frame, child=self.robot_frame)
            self._tf.publish(TFMessage(transforms=[there]))
        if self._joints.get_subscription_count():
            message = JointState(name=list(self._wheel_names), position=wheels)
            message.header.stamp = stamp_of(world.time)
            self._joints.publish(message)


def transform_of(time: float, pose: Pose, *, frame: str, child: str) -> TransformStamped:
    """Write the pose of the frame `child` in `frame` at `time` (s) as a transform."""
    message = TransformStamped(child_frame_id=child)
    message.header.stamp = stamp_of(time)
    message.header.frame_id = frame
    transform = message.transform
    transform.translation.x = float(pose.x)
    transform.translation.y = float(pose.y)
    turn = transform.rotation
    turn.x, turn.y, turn.z, turn.w = quaternion_from_yaw(pose.yaw)
    return message


main = partial(run_node, SimulationNode, parameters_for([OBJECT]))
