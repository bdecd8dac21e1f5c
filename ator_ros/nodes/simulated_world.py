"""The world that the node `simulation` keeps: simulator, sensors, start, and what may be placed where."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.geometry import Pose
from ator_ros.nodes import checks
from ator_ros.robot.description import Robot
from ator_ros.simulation.base_controller import COMMAND_TIMEOUT
from ator_ros.simulation.sensors import Sensors
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.state import STOP, Command, World


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop of the robot: simulated time (s) of the last command to move, and since when it stands."""

    last_command: float
    stood: float


class SimulatedWorld:
    """One world that can be reset; every wish is checked before anything changes.

    Parameters
    ----------
    robot : Robot
        Shape, masses, limits, with its scene.
    sensors : Sensors
        What is observed of the world.
    robot_start : Pose
        Of the robot, at the start and after a reset.
    object_starts : mapping of str to (x, y)
        Positions in m of the objects then, by name.

    Raises
    ------
    MessageError
        A start outside the floor.
    """

    def __init__(
        self,
        robot: Robot,
        sensors: Sensors,
        *,
        robot_start: Pose,
        object_starts: Mapping[str, tuple[float, float]],
    ) -> None:
        self._robot = robot
        self._sensors = sensors
        self._robot_start = robot_start
        self._object_starts = object_starts
        self._check_inside(robot_start.x, robot_start.y, "robot_start")
        for name, place in object_starts.items():
            self._check_inside(*place, f"{name}_start")
        self._simulation = Simulation(robot)
        self._begin()

    def _begin(self) -> None:
        self._simulation.place_robot(self._robot_start)
        for name, place in self._object_starts.items():
            self._simulation.place_object(name, *place)
        self._commanded, self._command = -math.inf, STOP
        self._driven: float | None = None
        self._changed()

    def _changed(self) -> None:
        self._sensors.reset()
        self.observed: World = self._sensors.observe(self._simulation.world())

    @property
    def time(self) -> float:
        """Simulated time in s since the start or the last reset."""
        return self._simulation.time

    @property
    def steered(self) -> bool:
        """Whether a command holds."""
        return self.time - self._commanded < COMMAND_TIMEOUT

    def tick(self) -> Stop | None:
        """Advance by one control tick; tell when the robot has come to stand."""
        self._simulation.tick()
        world = self._simulation.world()
        self.observed = self._sensors.observe(world)
        driving = self.steered and self._command != STOP
        if self._driven is None or driving or not world.robot.is_standing:
            return None
        stop, self._driven = Stop(self._driven, world.time), None
        return stop

    def command(self, command: Command) -> None:
        """Send the base a velocity command."""
        self._simulation.command(command)
        self._commanded, self._command = self.time, command
        if command != STOP:
            self._driven = self.time

    def reset(self) -> None:
        """Make a new world; its time starts at 0."""
        self._simulation.close()
        self._simulation = Simulation(self._robot)
        self._begin()

    def place_robot(self, pose: Pose, *, v: float, w: float) -> None:
        """Put the robot's axle at `pose`, moving at v (m/s) and w (rad/s).

        Raises
        ------
        MessageError
            Outside the floor, or faster than the robot's limits.
        """
        limits = self._robot.limits
        self._check_inside(pose.x, pose.y, "pose.pose.position")
        checks.number(v, "v", low=-limits.v, high=limits.v, unit="m/s")
        checks.number(w, "w", low=-limits.w, high=limits.w, unit="rad/s")
        self._simulation.place_robot(pose, v=v, w=w)
        self._changed()

    def place_object(self, name: str, x: float, y: float, *, vx: float, vy: float) -> None:
        """Put an object on the floor at (x, y) m, rolling at (vx, vy) m/s.

        Raises
        ------
        MessageError
            Outside the floor, or faster than 10 m/s.
        """
        self._check_inside(x, y, "position.point")
        for axis, value in (("x", vx), ("y", vy)):
            checks.number(
                value, f"velocity.{axis}", low=-checks.FASTEST_OBJECT, high=checks.FASTEST_OBJECT, unit="m/s"
            )
        self._simulation.place_object(name, x, y, vx=vx, vy=vy)
        self._changed()

    def remove_object(self, name: str) -> None:
        """Take an object off the floor."""
        self._simulation.remove_object(name)
        self._changed()

    def _check_inside(self, x: float, y: float, where: str) -> None:
        x_most, y_most = self._robot.scene.area.floor
        checks.number(x, f"{where}.x", low=-x_most, high=x_most, unit="m")
        checks.number(y, f"{where}.y", low=-y_most, high=y_most, unit="m")
