"""The node `simulation`: simulated robots and the objects of a domain on ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.domains.domain import domain_for
from ator_ros.nodes import messages
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health, Lateness
from ator_ros.nodes.parameters import OBJECT, declare_with_domain, digest_of
from ator_ros.nodes.qos import SENSOR_DATA, SERVICES
from ator_ros.nodes.robot_topics import RobotTopics
from ator_ros.nodes.running import run_node
from ator_ros.nodes.simulated_world import Stop
from ator_ros.nodes.simulation_settings import names_of, parameters_for, robots_of, simulated_of, world_of
from ator_ros.simulation.simulation import TICK
from ator_ros.world import messages as checks
from ator_ros.world.messages import MessageError

_FASTEST_PERIOD = 0.0005
_PAUSED_PERIOD = 0.05
_LAPSE = round(5.0 / TICK)  # ticks that take as long as in reality, after those that a command held for
_WARNING_PERIOD = 2.0
_LEAST_COUNTED = 0.5  # real s over which a pace is judged


class SimulationNode(Node):
    """Simulates one robot, or several, in one world; 20 ticks a second of simulated time.

    Parameters: see `parameters_for`; `real_time_factor` and `command_wait` can change while it runs.
    Where `robots` names robots, each has all topics and services that follow in the namespace of its name,
    and frames that begin with it. What concerns the whole world, it concerns from each namespace.

    Subscribes to
        cmd_vel (geometry_msgs/Twist or TwistStamped): clipped to the robot's limits; 0.5 s of simulated time
        after the last command the robot stands, as far as BaseController says.
    Publishes, every tick, as the robot's sensors see it, stamped with the simulated time of what they see
        odom (nav_msgs/Odometry): the middle of the axle, twist in the robot's frame.
        NAME of each object of the scene (nav_msgs/Odometry): position and velocity, both in the
        header's frame; nothing while the object is not there.
        joint_states, robot_description; tf of all robots: see `Embodiment`.
    Publishes
        /clock (rosgraph_msgs/Clock), when `publish_clock`: every tick.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    Services
        place_robot, and place_NAME of each object (ator_interfaces): teleport, with a velocity.
        reset (std_srvs/Trigger): a new world; simulated time starts at 0 again.
        pause (std_srvs/SetBool): stop and resume simulated time; a paused world is still published.

    Faster than real time, and with `lockstep`, a tick waits up to `command_wait` for a command while a
    command holds. This keeps simulation and controller in step on a busy machine, also when a program takes
    over that needs more than one tick to start. With several robots a tick waits for those that are commanded
    to move, for a shorter time the more there are: a robot whose controller ends must not stop the others.
    When no command holds any more, time passes no faster than in reality for five seconds: a program that a
    busy machine holds up for a moment then loses that moment, not minutes.
    """

    def __init__(self) -> None:
        super().__init__("simulation", automatically_declare_parameters_from_overrides=True)
        self._settings = declare_with_domain(self, parameters_for, self._change)
        self._names = names_of(self._settings)
        robots = robots_of(self._settings)
        self._digests = [robot.digest() for robot in robots]
        self._simulated = simulated_of(self._settings, robots)
        self._world = world_of(self._settings, self._simulated)
        self._paused = False
        self._deadline, self._due = 0.0, False
        self._unhurried = 0
        """How many of the next ticks take as long as in reality, unless they wait for a command."""
        self._awaited: set[int] = set()
        self._rejected = ""
        self._clock_publisher = None
        if self._settings["publish_clock"]:
            self._clock_publisher = self.create_publisher(Clock, "/clock", SENSOR_DATA)
        self._command_type = TwistStamped if self._settings["stamped_commands"] else Twist
        self._topics = [self._topics_of(number) for number in range(len(robots))]
        factor = self._settings["real_time_factor"]
        self._waits = self._waits_at(factor)
        self._lateness = Lateness()
        self._ticks, self._counted = 0, (time.monotonic(), 0)
        self._timer = self.create_timer(_period_at(factor), self._tick, clock=STEADY)
        commands = {topics.resolved("cmd_vel"): self._command_type for topics in self._topics}
        self._diagnostics = Diagnostics(self, self._health, commands)
        speed = f"at {factor:g} times real time" if factor else "as fast as possible"
        named = zip((robot.name for robot in robots), self._names, strict=True)
        told = [f"{kind} as {name}" if name else kind for kind, name in named]
        domain = domain_for(self._settings["domain"], self._settings["robot"]).name
        where = f"domain {domain}, ROS domain {self.context.get_domain_id()}"
        self.get_logger().info(
            f"simulating {', '.join(told)} {speed} ({where}): cmd_vel ({self._command_type.__name__}) to odom"
            f"{''.join(f', {name}' for name in robots[0].scene.objects)}"
        )

    def _topics_of(self, number: int) -> RobotTopics:
        """Offer topics and services of one robot."""
        robot, settings = self._simulated[number], self._settings
        frames = {name: settings[name] for name in ("frame", "robot_frame")}
        topics = RobotTopics(self, robot, **frames)
        callback = partial(self._command, number)
        self.create_subscription(self._command_type, topics.resolved("cmd_vel"), callback, SENSOR_DATA)
        services: dict[str, tuple[type[Any], Callable[[Any], str]]] = {
            "place_robot": (PlaceRobot, partial(self._place_robot, number)),
            "reset": (Trigger, self._reset),
            "pause": (SetBool, self._pause),
        }
        for name in topics.objects:
            services[f"place_{name}"] = PlaceObject, partial(self._place_object, number, name)
        for name, (kind, handle) in services.items():
            self.create_service(kind, topics.resolved(name), self._guarded(handle), qos_profile=SERVICES)
        return topics

    # Time

    def _waits_at(self, factor: float) -> bool:
        """Return whether ticks wait for commands. At real time or slower they do not, except in lockstep."""
        return bool(self._settings["lockstep"]) or factor == 0.0 or factor > 1.0

    def _change(self, values: Mapping[str, Any]) -> None:
        """Let time go at another speed from now on."""
        if "real_time_factor" in values:
            factor = values["real_time_factor"]
            self._waits, self._due, self._deadline = self._waits_at(factor), False, 0.0
            self._unhurried = 0
            self._timer.timer_period_ns = round(1e9 * _period_at(factor))
            self._timer.reset()
            self._counted = (time.monotonic(), self._ticks)

    def _tick(self) -> None:
        now = time.monotonic()
        if now < self._deadline:
            self._due = self._settings["real_time_factor"] > 0.0
            return
        self._due = False
        if self._paused:
            self._deadline = now + _PAUSED_PERIOD
        else:
            self._lateness.came(now)
            for stop in self._world.tick():
                self.get_logger().debug(_told(stop))
            self._ticks += 1
            self._awaited = set(self._world.awaited()) if self._waits else set()
            self._schedule(now)
        self._publish()

    def _schedule(self, now: float) -> None:
        """Set from when on the next tick may come, whatever the timer says."""
        factor, wait = self._settings["real_time_factor"], self._settings["command_wait"]
        if self._awaited:
            self._deadline = now + wait / len(self._topics)
            self._unhurried = _LAPSE if wait > 0.0 and not 0.0 < factor <= 1.0 else 0
        elif self._unhurried > 0:
            self._unhurried -= 1
            self._deadline = max(self._deadline, now - TICK) + TICK
            self._counted = (now, self._ticks)  # no lapse counts as slow

    def _publish(self) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=messages.stamp_of(self._world.time)))
        for topics in self._topics:
            topics.publish()

    # What comes in

    def _command(self, number: int, message: Twist | TwistStamped) -> None:
        topics = self._topics[number]
        try:
            where = topics.resolved("cmd_vel")
            if isinstance(message, TwistStamped):
                given = message.header.frame_id
                checks.frame(given, f"{where}.header.frame_id", expected=topics.robot_frame)
            self._world.command(checks.command_from(message, where), number)
        except MessageError as error:
            self._reject(str(error))
            return
        if not (number in self._awaited or self._world.told_to_move(number)):
            return  # who only stands hastens nobody
        self._awaited.discard(number)
        if not (self._paused or self._awaited):
            self._deadline = 0.0
            if self._due:  # its timer came before the command
                self._tick()

    def _reject(self, reason: str) -> None:
        self._rejected = reason
        self.get_logger().warning(f"ignored: {reason}", throttle_duration_sec=_WARNING_PERIOD)

    def _guarded(self, handle: Callable[[Any], str]) -> Callable[[Any, Any], Any]:
        """Return a service callback that answers with what `handle` says, or with why it could not."""

        def serve(request: Any, response: Any) -> Any:
            try:
                response.message = handle(request)
                response.success = True
                self._publish()
            except MessageError as error:
                response.message = str(error)
                response.success = False
                self._reject(str(error))
            return response

        return serve

    def _place_robot(self, number: int, request: PlaceRobot.Request) -> str:
        frame = self._topics[number].frame
        checks.frame(request.pose.header.frame_id, "pose.header.frame_id", expected=frame)
        pose = checks.pose_from(request.pose.pose, "pose.pose")
        self._world.place_robot(pose, number, v=request.v, w=request.w)
        who = self._names[number] or "robot"
        return f"{who} at x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.yaw:.3f} rad"

    def _place_object(self, number: int, name: str, request: PlaceObject.Request) -> str:
        if request.remove:
            self._world.remove_object(name)
            return f"{name} removed"
        frame = self._topics[number].frame
        checks.frame(request.position.header.frame_id, "position.header.frame_id", expected=frame)
        point, velocity = request.position.point, request.velocity
        self._world.place_object(name, point.x, point.y, vx=velocity.x, vy=velocity.y)
        return f"{name} at x {point.x:.3f} m, y {point.y:.3f} m"

    def _reset(self, _: Trigger.Request) -> str:
        self._world.reset()
        self._deadline, self._unhurried = 0.0, 0
        return "a new world, simulated time 0"

    def _pause(self, request: SetBool.Request) -> str:
        self._paused, self._deadline = bool(request.data), 0.0
        self._counted = (time.monotonic(), self._ticks)  # no pause counts as slow
        return "paused" if self._paused else "running"

    def _health(self) -> Health:
        now, wanted = time.monotonic(), self._settings["real_time_factor"]
        since, ticks = self._counted
        factor = (self._ticks - ticks) * TICK / (now - since)
        self._counted = (now, self._ticks)
        slow = not self._paused and now - since > _LEAST_COUNTED and factor < 0.9 * wanted
        return Health(
            f"expected {wanted:g} times real time, it is {factor:.2f}" if slow else "",
            values={
                "simulated time (s)": f"{self._world.time:.2f}",
                "real-time factor": f"{factor:.2f}",
                "paused": self._paused,
                "commands": "coming" if self._world.steered() else "none",
                "longest time between ticks (ms)": self._lateness.take(),
                "last error": self._rejected,
                "robot digest": ", ".join(self._digests),
                "parameters digest": digest_of(self._settings),
            },
        )


def _told(stop: Stop) -> str:
    """Return what the log says of a stop."""
    who = f"robot {stop.robot}" if stop.robot else "the robot"
    return f"{who} stands since {stop.stood:.2f} s, last told to move at {stop.last_command:.2f} s"


def _period_at(factor: float) -> float:
    """Return the real s between ticks."""
    return TICK / factor if factor else _FASTEST_PERIOD


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(SimulationNode, parameters_for([OBJECT]), args)
