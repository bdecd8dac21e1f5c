"""The node `simulation`: the simulated Pioneer, a ball and a field on ROS."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from ator_interfaces.srv import PlaceBall, PlaceRobot
from ator_ros.geometry import Pose
from ator_ros.nodes import checks, conversions
from ator_ros.nodes.checks import MessageError
from ator_ros.nodes.node_support import (
    LATCHED,
    SENSOR_DATA,
    STEADY,
    Diagnostics,
    Health,
    Parameter,
    SetupError,
    declare_parameters,
    run_node,
)
from ator_ros.robot import ConfigError, load_robot
from ator_ros.simulation.base_controller import COMMAND_TIMEOUT
from ator_ros.simulation.bodies import robot_urdf
from ator_ros.simulation.pioneer import TICK, PioneerSimulation

PARAMETERS = (
    Parameter("frame", "odom", "frame of poses and of the ball"),
    Parameter("robot_frame", "base_link", "frame of the robot, in the middle of its axle"),
    Parameter("real_time_factor", 1.0, "simulated per real seconds; 0: as fast as possible", 0.0, 100.0),
    Parameter(
        "command_wait", 0.1, "real s that a tick waits for a command, at real_time_factor 0", 0.0, 10.0
    ),
    Parameter("publish_clock", False, "whether to publish the simulated time on /clock"),
    Parameter("stamped_commands", False, "whether cmd_vel is a TwistStamped"),
    Parameter("robot_start", [-2.0, 0.0, 0.0], "pose of the robot after a reset: x, y in m, yaw in rad"),
    Parameter("ball_start", [0.0, 0.0], "position of the ball after a reset: x, y in m"),
)

_FASTEST_PERIOD = 0.0005
_PAUSED_PERIOD = 0.05
_WARNING_PERIOD = 2.0


class SimulationNode(Node):
    """Simulates one Pioneer in one world; 20 ticks a second of simulated time.

    Parameters: see `PARAMETERS`; all are read at the start only.

    Subscribes to
        cmd_vel (geometry_msgs/Twist or TwistStamped): clipped to the robot's limits; 0.5 s of simulated time
        after the last command the robot stops.
    Publishes, every tick, stamped with simulated time
        odom (nav_msgs/Odometry): the middle of the axle, twist in the robot's frame.
        ball (nav_msgs/Odometry): position and velocity, both in the header's frame; nothing without a ball.
        /clock (rosgraph_msgs/Clock), when `publish_clock`.
    Publishes
        robot_description (std_msgs/String, transient local): URDF.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    Services
        place_robot, place_ball (ator_interfaces): teleport, with a velocity.
        reset (std_srvs/Trigger): a new world; simulated time starts at 0 again.
        pause (std_srvs/SetBool): stop and resume simulated time; a paused world is still published.

    At `real_time_factor` 0 a tick waits up to `command_wait` for the command that answers the last one, as
    long as commands come: so nobody who steers is left behind, however fast the machine.
    """

    def __init__(self) -> None:
        super().__init__("simulation")
        self._settings = declare_parameters(self, PARAMETERS)
        try:
            self._robot = load_robot()
            self._start, self._ball_start = self._read_start()
        except (ConfigError, MessageError) as error:
            raise SetupError(str(error)) from error
        self._paused = False
        self._rejected = ""
        self._simulation: PioneerSimulation | None = None
        self._make_world()
        self._offer_topics()
        self._offer_services()
        factor = self._settings["real_time_factor"]
        self._ran, self._ran_ticks, self._ticks, self._achieved = time.monotonic(), 0, 0, 0.0
        self._timer = self.create_timer(
            TICK / factor if factor else _FASTEST_PERIOD, self._tick, clock=STEADY
        )
        self._diagnostics = Diagnostics(self, self._health)
        self.get_logger().info(
            f"simulating {self._robot.name} at {factor:g} times real time (0: as fast as possible)"
        )

    def _read_start(self) -> tuple[Pose, tuple[float, float]]:
        robot, ball = self._settings["robot_start"], self._settings["ball_start"]
        checks.count(robot, "parameter robot_start", least=3, most=3)
        checks.count(ball, "parameter ball_start", least=2, most=2)
        self._check_inside(robot[0], robot[1], "parameter robot_start")
        self._check_inside(ball[0], ball[1], "parameter ball_start")
        return Pose(robot[0], robot[1], checks.position(robot[2], "parameter robot_start: yaw")), (
            ball[0],
            ball[1],
        )

    def _check_inside(self, x: float, y: float, where: str) -> None:
        field = self._robot.field
        checks.number(abs(x), f"{where}: |x|", low=0.0, high=field.length / 2 + field.margin, unit="m")
        checks.number(abs(y), f"{where}: |y|", low=0.0, high=field.width / 2 + field.margin, unit="m")

    def _make_world(self) -> None:
        if self._simulation is not None:
            self._simulation.close()
        self._simulation = PioneerSimulation(self._robot)
        self._simulation.place_robot(self._start)
        self._simulation.place_ball(*self._ball_start)
        self._commanded = -COMMAND_TIMEOUT  # simulated time of the last command
        self._deadline = 0.0

    def _offer_topics(self) -> None:
        self._odom = self.create_publisher(Odometry, "odom", SENSOR_DATA)
        self._ball = self.create_publisher(Odometry, "ball", SENSOR_DATA)
        self._clock_publisher = None
        if self._settings["publish_clock"]:
            self._clock_publisher = self.create_publisher(Clock, "/clock", SENSOR_DATA)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        self._description.publish(String(data=robot_urdf(self._robot)))
        kind = TwistStamped if self._settings["stamped_commands"] else Twist
        self.create_subscription(kind, "cmd_vel", self._command, SENSOR_DATA)

    def _offer_services(self) -> None:
        self.create_service(PlaceRobot, "place_robot", self._guarded(self._place_robot))
        self.create_service(PlaceBall, "place_ball", self._guarded(self._place_ball))
        self.create_service(Trigger, "reset", self._guarded(self._reset))
        self.create_service(SetBool, "pause", self._guarded(self._pause))

    # Time

    def _tick(self) -> None:
        assert self._simulation is not None
        now = time.monotonic()
        if self._paused:
            if now >= self._deadline:
                self._deadline = now + _PAUSED_PERIOD
                self._publish()
            return
        if now < self._deadline:
            return
        self._simulation.tick()
        self._ticks += 1
        if self._settings["real_time_factor"] == 0.0 and self._steered():
            self._deadline = now + self._settings["command_wait"]
        self._publish()

    def _steered(self) -> bool:
        assert self._simulation is not None
        return self._simulation.time - self._commanded < COMMAND_TIMEOUT

    def _publish(self) -> None:
        assert self._simulation is not None
        world, frame = self._simulation.world(), self._settings["frame"]
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=conversions.stamp_of(world.time)))
        if world.ball is not None:
            height = self._robot.ball.radius
            self._ball.publish(
                conversions.ball_odometry_of(world.time, world.ball, frame=frame, height=height)
            )
        robot_frame = self._settings["robot_frame"]
        # The ball comes first, so that who acts on odom has the ball of the same tick.
        self._odom.publish(conversions.odometry_of(world.time, world.robot, frame=frame, child=robot_frame))

    # What comes in

    def _command(self, message: Twist | TwistStamped) -> None:
        assert self._simulation is not None
        try:
            if isinstance(message, TwistStamped):
                expected = self._settings["robot_frame"]
                checks.frame(message.header.frame_id, "cmd_vel.header.frame_id", expected=expected)
                message = message.twist
            self._simulation.command(conversions.command_from(message))
        except MessageError as error:
            self._reject(str(error))
            return
        self._commanded = self._simulation.time
        if not self._paused:
            self._deadline = 0.0

    def _reject(self, reason: str) -> None:
        self._rejected = reason
        self.get_logger().warning(f"ignored: {reason}", throttle_duration_sec=_WARNING_PERIOD)

    def _guarded(self, handle: Callable[[Any], str]) -> Callable[[Any, Any], Any]:
        """Give a service callback that answers with what `handle` says, or with why it could not."""

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
        assert self._simulation is not None
        checks.frame(request.pose.header.frame_id, "pose.header.frame_id", expected=self._settings["frame"])
        pose = conversions.pose_from(request.pose.pose, "pose.pose")
        self._check_inside(pose.x, pose.y, "pose.pose.position")
        limits = self._robot.limits
        v = checks.number(request.v, "v", low=-limits.v, high=limits.v, unit="m/s")
        w = checks.number(request.w, "w", low=-limits.w, high=limits.w, unit="rad/s")
        self._simulation.place_robot(pose, v=v, w=w)
        return f"robot at x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.yaw:.3f} rad"

    def _place_ball(self, request: PlaceBall.Request) -> str:
        assert self._simulation is not None
        if request.remove:
            self._simulation.remove_ball()
            return "ball removed"
        checks.frame(
            request.position.header.frame_id, "position.header.frame_id", expected=self._settings["frame"]
        )
        x, y = request.position.point.x, request.position.point.y
        self._check_inside(x, y, "position.point")
        vx, vy = (
            checks.number(v, "velocity", low=-10.0, high=10.0, unit="m/s")
            for v in (request.velocity.x, request.velocity.y)
        )
        self._simulation.place_ball(x, y, vx=vx, vy=vy)
        return f"ball at x {x:.3f} m, y {y:.3f} m"

    def _reset(self, _: Trigger.Request) -> str:
        self._make_world()
        return "a new world, simulated time 0"

    def _pause(self, request: SetBool.Request) -> str:
        self._paused, self._deadline = bool(request.data), 0.0
        return "paused" if self._paused else "running"

    def _health(self) -> Health:
        assert self._simulation is not None
        now = time.monotonic()
        self._achieved = (self._ticks - self._ran_ticks) * TICK / (now - self._ran)
        self._ran, self._ran_ticks = now, self._ticks
        wanted = self._settings["real_time_factor"]
        slow = wanted > 0.0 and not self._paused and self._achieved < 0.9 * wanted
        return Health(
            f"slower than asked for: {self._achieved:.2f} instead of {wanted:g} times real time"
            if slow
            else "",
            values={
                "simulated time (s)": f"{self._simulation.time:.2f}",
                "real-time factor": f"{self._achieved:.2f}",
                "paused": self._paused,
                "commands": "coming" if self._steered() else "none",
                "last rejected": self._rejected,
                "robot digest": self._robot.digest(),
            },
        )


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(SimulationNode, args)
