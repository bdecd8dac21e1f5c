"""The node `simulation`: a simulated robot and the objects of a domain on ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from ator_interfaces.srv import PlaceBall, PlaceRobot
from ator_ros.nodes import checks, conversions
from ator_ros.nodes.checks import MessageError
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health, Lateness
from ator_ros.nodes.embodiment import Embodiment
from ator_ros.nodes.parameters import (
    OBJECT,
    declare_with_domain,
    digest_of,
    robot_of,
)
from ator_ros.nodes.qos import SENSOR_DATA, SERVICES, STATES
from ator_ros.nodes.running import run_node
from ator_ros.nodes.simulation_settings import parameters_for, world_of
from ator_ros.simulation.simulation import TICK

_FASTEST_PERIOD = 0.0005
_PAUSED_PERIOD = 0.05
_WARNING_PERIOD = 2.0


class SimulationNode(Node):
    """Simulates one robot in one world; 20 ticks a second of simulated time.

    Parameters: see `parameters_for`; `real_time_factor` and `command_wait` can change while it runs.

    Subscribes to
        cmd_vel (geometry_msgs/Twist or TwistStamped): clipped to the robot's limits; 0.5 s of simulated time
        after the last command the robot stands, as far as BaseController says.
    Publishes, every tick, as the sensors see it, stamped with the simulated time of what they see
        odom (nav_msgs/Odometry): the middle of the axle, twist in the robot's frame.
        the topic of each object of the domain (nav_msgs/Odometry): position and velocity, both in the
        header's frame; nothing while the object is not there.
        /clock (rosgraph_msgs/Clock), when `publish_clock`.
    Publishes
        tf, joint_states, robot_description: see `Embodiment`.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    Services
        place_robot, and place_NAME of each object (ator_interfaces): teleport, with a velocity.
        reset (std_srvs/Trigger): a new world; simulated time starts at 0 again.
        pause (std_srvs/SetBool): stop and resume simulated time; a paused world is still published.

    Faster than real time, and with `lockstep`, a tick waits up to `command_wait` for a command, as long as a
    command holds: nobody who steers is left behind on a busy machine, also where one program hands over to
    another that takes longer to begin than one tick waits.
    """

    def __init__(self) -> None:
        super().__init__("simulation")
        self._settings = declare_with_domain(self, parameters_for, self._change)
        self._robot = robot_of(self._settings)
        self._world = world_of(self._settings, self._robot)
        self._paused = False
        self._deadline, self._due = 0.0, False
        self._rejected = ""
        self._offer_topics()
        self._offer_services()
        factor = self._settings["real_time_factor"]
        self._waits = self._waits_at(factor)
        self._lateness = Lateness()
        self._ticks, self._counted = 0, (time.monotonic(), 0)
        self._timer = self.create_timer(_period_at(factor), self._tick, clock=STEADY)
        self._diagnostics = Diagnostics(self, self._health, {"cmd_vel": self._command_type})
        speed = f"at {factor:g} times real time" if factor else "as fast as possible"
        self.get_logger().info(f"simulating {self._robot.name} {speed}")

    def _offer_topics(self) -> None:
        self._odom = self.create_publisher(Odometry, "odom", STATES)
        self._objects = {
            name: self.create_publisher(Odometry, name, STATES) for name in self._robot.scene.objects
        }
        self._clock_publisher = None
        if self._settings["publish_clock"]:
            self._clock_publisher = self.create_publisher(Clock, "/clock", SENSOR_DATA)
        settings = self._settings
        frames = {name: settings[name] for name in ("frame", "robot_frame")}
        self._embodiment = Embodiment(self, self._robot, **frames)
        self._command_type = TwistStamped if self._settings["stamped_commands"] else Twist
        self.create_subscription(self._command_type, "cmd_vel", self._command, SENSOR_DATA)

    def _offer_services(self) -> None:
        self._offer_service(PlaceRobot, "place_robot", self._place_robot)
        for name in self._objects:
            self._offer_service(PlaceBall, f"place_{name}", partial(self._place_object, name))
        self._offer_service(Trigger, "reset", self._reset)
        self._offer_service(SetBool, "pause", self._pause)

    def _offer_service(self, kind: type[Any], name: str, handle: Callable[[Any], str]) -> None:
        self.create_service(kind, name, self._guarded(handle), qos_profile=SERVICES)

    # Time

    def _waits_at(self, factor: float) -> bool:
        """Return whether ticks wait for who steers.

        No faster than real time a base waits for nobody, and who steers by hand sends what he likes.
        """
        return bool(self._settings["lockstep"]) or factor == 0.0 or factor > 1.0

    def _change(self, values: Mapping[str, Any]) -> None:
        """Let time go at another speed from now on."""
        if "real_time_factor" in values:
            factor = values["real_time_factor"]
            self._waits, self._due, self._deadline = self._waits_at(factor), False, 0.0
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
            stop = self._world.tick()
            if stop is not None:
                times = f"since {stop.stood:.2f} s, last told to move at {stop.last_command:.2f} s"
                self.get_logger().debug(f"the robot stands {times}")
            self._ticks += 1
            if self._waits and self._world.steered:
                self._deadline = now + self._settings["command_wait"]
        self._publish()

    def _publish(self) -> None:
        world, frame = self._world.observed, self._settings["frame"]
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=conversions.stamp_of(self._world.time)))
        # Objects come first, so that who acts on odom has the objects of the same tick.
        for name, there in world.objects.items():
            height = self._robot.scene.radius(name)
            message = conversions.object_odometry_of(world.time, there, frame=frame, height=height)
            self._objects[name].publish(message)
        robot_frame = self._settings["robot_frame"]
        odometry = conversions.odometry_of(world.time, world.robot, frame=frame, child=robot_frame)
        self._odom.publish(odometry)
        self._embodiment.publish(world)

    # What comes in

    def _command(self, message: Twist | TwistStamped) -> None:
        try:
            if isinstance(message, TwistStamped):
                expected = self._settings["robot_frame"]
                checks.frame(message.header.frame_id, "cmd_vel.header.frame_id", expected=expected)
                message = message.twist
            self._world.command(conversions.command_from(message))
        except MessageError as error:
            self._reject(str(error))
            return
        if not self._paused:
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

    def _place_robot(self, request: PlaceRobot.Request) -> str:
        frame = self._settings["frame"]
        checks.frame(request.pose.header.frame_id, "pose.header.frame_id", expected=frame)
        pose = conversions.pose_from(request.pose.pose, "pose.pose")
        self._world.place_robot(pose, v=request.v, w=request.w)
        return f"robot at x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.yaw:.3f} rad"

    def _place_object(self, name: str, request: PlaceBall.Request) -> str:
        if request.remove:
            self._world.remove_object(name)
            return f"{name} removed"
        frame = self._settings["frame"]
        checks.frame(request.position.header.frame_id, "position.header.frame_id", expected=frame)
        point, velocity = request.position.point, request.velocity
        self._world.place_object(name, point.x, point.y, vx=velocity.x, vy=velocity.y)
        return f"{name} at x {point.x:.3f} m, y {point.y:.3f} m"

    def _reset(self, _: Trigger.Request) -> str:
        self._world.reset()
        self._deadline = 0.0
        return "a new world, simulated time 0"

    def _pause(self, request: SetBool.Request) -> str:
        self._paused, self._deadline = bool(request.data), 0.0
        return "paused" if self._paused else "running"

    def _health(self) -> Health:
        now, wanted = time.monotonic(), self._settings["real_time_factor"]
        since, ticks = self._counted
        factor = (self._ticks - ticks) * TICK / (now - since)
        self._counted = (now, self._ticks)
        slow = not self._paused and factor < 0.9 * wanted
        return Health(
            f"expected {wanted:g} times real time, it is {factor:.2f}" if slow else "",
            values={
                "simulated time (s)": f"{self._world.time:.2f}",
                "real-time factor": f"{factor:.2f}",
                "paused": self._paused,
                "commands": "coming" if self._world.steered else "none",
                "longest time between ticks (ms)": self._lateness.take(),
                "last error": self._rejected,
                "robot digest": self._robot.digest(),
                "parameters digest": digest_of(self._settings),
            },
        )


def _period_at(factor: float) -> float:
    """Return the real s between ticks."""
    return TICK / factor if factor else _FASTEST_PERIOD


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(SimulationNode, parameters_for([OBJECT]), args)
