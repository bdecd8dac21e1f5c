"""The world of the node `simulation`: simulator, sensors, starts, and checks of placements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.simulation.sensors import Sensors
from ator_ros.simulation.simulated_base import COMMAND_TIMEOUT
from ator_ros.simulation.simulation import Simulation
from ator_ros.world import messages
from ator_ros.world.messages import MessageError
from ator_ros.world.state import STOP, Command, World

_FASTEST = 10.0
"""Greatest speed in m/s that an object is placed with: in one step of the physics it moves by its radius."""


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop of a robot: simulated times (s) of the last command to move, and of the standstill."""

    robot: str
    last_command: float
    stood: float


class SimulatedRobot:
    """One robot of the world: its description, observations and commands.

    Parameters
    ----------
    name : str
        Its name; empty where there is no other.
    robot : Robot
        Shape, masses and limits.
    sensors : Sensors
        Its sensors.
    start : Pose
        At the start and after a reset.

    Attributes
    ----------
    observed : World
        The last observation.
    """

    observed: World

    def __init__(self, name: str, robot: Robot, sensors: Sensors, start: Pose) -> None:
        self.name, self.robot, self.sensors, self.start = name, robot, sensors, start
        self.begin()

    def begin(self) -> None:
        """Forget all commands."""
        self._commanded, self._command = -math.inf, STOP
        self._driven: float | None = None

    def commanded(self, command: Command, time: float) -> None:
        """Note a command that came at `time` (s)."""
        self._commanded, self._command = time, command
        if command != STOP:
            self._driven = time

    def steered(self, time: float) -> bool:
        """Return whether a command holds at `time` (s)."""
        return time - self._commanded < COMMAND_TIMEOUT

    @property
    def commanded_to_move(self) -> bool:
        """Whether the last command was to move."""
        return self._command != STOP

    def observe(self, world: World) -> Stop | None:
        """Observe the true state; return the stop if the robot has come to stand."""
        self.observed = self.sensors.observe(world)
        driving = self.steered(world.time) and self.commanded_to_move
        if self._driven is None or driving or not world.robot.is_standing:
            return None
        stop, self._driven = Stop(self.name, self._driven, world.time), None
        return stop


class SimulatedWorld:
    """One world that can be reset; every placement is checked before anything changes.

    Parameters
    ----------
    robots : sequence of SimulatedRobot
        At least one; the scene is that of the first.
    object_starts : mapping of str to (x, y)
        Positions in m of the objects at the start and after a reset, by name.

    Raises
    ------
    MessageError
        A start outside the floor, or two bodies that overlap at the start.
    """

    def __init__(
        self, robots: Sequence[SimulatedRobot], object_starts: Mapping[str, tuple[float, float]]
    ) -> None:
        self._robots = tuple(robots)
        self._scene = robots[0].robot.scene
        self._object_starts = object_starts
        for number, robot in enumerate(self._robots):
            self._check_inside(robot.start.x, robot.start.y, f"robot_start {robot.name}".strip())
            for other in self._robots[:number]:
                _check_apart(robot, robot.start, other, other.start, "robot_start")
        for name, place in object_starts.items():
            self._check_inside(*place, f"{name}_start")
        self._begin()
        self._check_starts()

    def _check_starts(self) -> None:
        """Raise MessageError where a robot or an object starts in another body."""
        for name, place in self._object_starts.items():
            self._check_clear(self._simulation.object_overlap(name, *place), f"{name}_start")
        for number, robot in enumerate(self._robots):
            overlap = self._simulation.robot_overlap(robot.start, number=number)
            self._check_clear(overlap, f"robot_start {robot.name}".strip())

    def _begin(self) -> None:
        first, *others = (each.robot for each in self._robots)
        self._simulation = Simulation(first, others=others)
        for number, robot in enumerate(self._robots):
            self._simulation.place_robot(robot.start, number=number)
            robot.begin()
        for name, place in self._object_starts.items():
            self._simulation.place_object(name, *place)
        self._changed()

    def _changed(self, *numbers: int) -> None:
        """Reset the sensors of some robots, by default of all."""
        for number in numbers or range(len(self._robots)):
            robot = self._robots[number]
            robot.sensors.reset()
            robot.observed = robot.sensors.observe(self._simulation.world(number=number))

    def _appears(self, name: str) -> None:
        """Reset the sensors of all robots for one object; their odometry stays."""
        for number, robot in enumerate(self._robots):
            world = self._simulation.world(number=number)
            robot.sensors.placed(name, world)
            robot.observed = robot.sensors.observe(world)

    @property
    def time(self) -> float:
        """Simulated time in s since the start or the last reset."""
        return self._simulation.time

    def steered(self) -> frozenset[int]:
        """Return the numbers of the robots that a command holds for."""
        return frozenset(number for number, robot in enumerate(self._robots) if robot.steered(self.time))

    def awaited(self) -> frozenset[int]:
        """Return the numbers of the robots whose next command a tick waits for.

        Where there are several, one that was commanded to stop is not waited for, as the others need
        their odometry.
        """
        steered = self.steered()
        if len(self._robots) == 1:
            return steered
        return frozenset(number for number in steered if self._robots[number].commanded_to_move)

    def commanded_to_move(self, number: int) -> bool:
        """Return whether a robot's last command was to move."""
        return self._robots[number].commanded_to_move

    def tick(self) -> Iterator[Stop]:
        """Advance by one control tick; return which robots have come to stand."""
        self._simulation.tick()
        stops = [
            robot.observe(self._simulation.world(number=number)) for number, robot in enumerate(self._robots)
        ]
        return filter(None, stops)

    def command(self, command: Command, number: int) -> None:
        """Send a base a velocity command."""
        self._simulation.command(command, number=number)
        self._robots[number].commanded(command, self.time)

    def reset(self) -> None:
        """Make a new world; its time starts at 0."""
        self._simulation.close()
        self._begin()

    def place_robot(self, pose: Pose, number: int, *, v: float, w: float) -> None:
        """Put a robot's axle at `pose`, moving at v (m/s) and w (rad/s).

        Raises
        ------
        MessageError
            Outside the floor, in another robot, an object or a wall, or faster than the robot's limits.
        """
        placed = self._robots[number]
        limits = placed.robot.limits
        self._check_inside(pose.x, pose.y, "pose.pose.position")
        messages.number(v, "v", low=-limits.v, high=limits.v, unit="m/s")
        messages.number(w, "w", low=-limits.w, high=limits.w, unit="rad/s")
        for other, robot in enumerate(self._robots):
            if other != number:
                there = self._simulation.world(number=other).robot.pose
                _check_apart(placed, pose, robot, there, "pose.pose.position")
        self._check_clear(self._simulation.robot_overlap(pose, number=number), "pose.pose.position")
        self._simulation.place_robot(pose, v=v, w=w, number=number)
        self._changed(number)

    def place_object(self, name: str, x: float, y: float, *, vx: float, vy: float) -> None:
        """Put an object on the floor at (x, y) m, rolling at (vx, vy) m/s.

        Raises
        ------
        MessageError
            Outside the floor, in a robot, another object or a wall, or faster than 10 m/s.
        """
        self._check_inside(x, y, "position.point")
        for axis, value in (("x", vx), ("y", vy)):
            messages.number(value, f"velocity.{axis}", low=-_FASTEST, high=_FASTEST, unit="m/s")
        self._check_clear(self._simulation.object_overlap(name, x, y), "position.point")
        self._simulation.place_object(name, x, y, vx=vx, vy=vy)
        self._appears(name)

    def remove_object(self, name: str) -> None:
        """Take an object off the floor."""
        self._simulation.remove_object(name)
        self._appears(name)

    def _check_clear(self, overlap: str, where: str) -> None:
        """Raise MessageError for a place where a body would overlap another one."""
        if overlap:
            raise MessageError(f"{where}: expected a free place, got one that overlaps {overlap}")

    def _check_inside(self, x: float, y: float, where: str) -> None:
        x_min, y_min, x_max, y_max = self._scene.area.floor
        messages.number(x, f"{where}.x", low=x_min, high=x_max, unit="m")
        messages.number(y, f"{where}.y", low=y_min, high=y_max, unit="m")


def _check_apart(robot: SimulatedRobot, pose: Pose, other: SimulatedRobot, there: Pose, where: str) -> None:
    """Raise MessageError where two robots might overlap."""
    least, distance = robot.robot.reach + other.robot.reach, pose.distance(there)
    if distance < least:
        raise MessageError(
            f"{where}: expected {robot.name} at least {least:.2f} m from {other.name}, got {distance:.2f} m"
        )
