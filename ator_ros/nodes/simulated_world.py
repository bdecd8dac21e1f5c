"""The world of the node `simulation`: simulator, sensors, starts, and checks of placements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.simulation.sensors import Sensors
from ator_ros.world import readers
from ator_ros.world.readers import MessageError
from ator_ros.world.state import STOP, Command, World

_FASTEST = 10.0  # m/s of a placed object: it then moves by its radius in one step of the physics


@dataclass
class SimulatedRobot:
    """One robot of the world: its name, "" for a single one, sensors and start."""

    name: str
    sensors: Sensors
    start: Pose
    observed: World = field(init=False)


class SimulatedWorld:
    """One world that can be reset; every placement is checked before anything changes.

    All `robots` have the description `robot`. `object_starts` are the positions in m of the objects
    at the start and after a reset, which makes a new `simulation`. A start outside the floor or in
    another body raises MessageError.
    """

    def __init__(
        self,
        robot: Robot,
        robots: Sequence[SimulatedRobot],
        object_starts: Mapping[str, tuple[float, float]],
    ) -> None:
        self.robot = robot
        self.robots = tuple(robots)
        self._object_starts = object_starts
        self._idle = set[str]()
        for each in self.robots:
            self._check_inside(each.start.x, each.start.y, f"robot_start {each.name}".strip())
        for name, place in object_starts.items():
            self._check_inside(*place, f"{name}_start")
        self._begin()
        for name, place in object_starts.items():
            _check_clear(self.simulation.object_overlap(name, *place), f"{name}_start")
        for number, each in enumerate(self.robots):
            overlap = self.simulation.robot_overlap(each.start, number=number)
            _check_clear(overlap, f"robot_start {each.name}".strip())

    def _begin(self) -> None:
        self.simulation = Simulation(self.robot, robots=len(self.robots))
        for number, robot in enumerate(self.robots):
            self.simulation.place_robot(robot.start, number=number)
            robot.sensors.reset()
        for name, place in self._object_starts.items():
            self.simulation.place_object(name, *place)
        self._observe_all()

    def _observe(self, number: int) -> None:
        robot = self.robots[number]
        robot.observed = robot.sensors.observe(self.simulation.world(number=number))

    def _observe_all(self) -> None:
        for number in range(len(self.robots)):
            self._observe(number)

    def _observe_placed(self, name: str) -> None:
        """Observe a placed object immediately, without its sensor delay; odometry continues."""
        for robot in self.robots:
            robot.sensors.placed(name)
        self._observe_all()

    def awaited(self) -> set[int]:
        """Return the robots whose next command a tick waits for, by their indices in `robots`.

        Of several robots those that were commanded to stop are left out, as the others need their
        odometry.
        """
        unawaited = (None, STOP) if len(self.robots) > 1 else (None,)
        numbers = range(len(self.robots))
        return {
            number
            for number in numbers
            if self.simulation.commanded(number=number) not in unawaited
        }

    def tick(self) -> set[str]:
        """Advance by one control tick; return the names of the robots that have come to stand."""
        self.simulation.tick()
        self._observe_all()
        previous = self._idle
        self._idle = set[str]()
        for number, robot in enumerate(self.robots):
            is_standing = self.simulation.world(number=number).robot.is_standing
            if is_standing and self.simulation.commanded(number=number) in (None, STOP):
                self._idle.add(robot.name)
        return self._idle - previous

    def reset(self) -> None:
        """Make a new world; its time starts at 0."""
        self.simulation.close()
        self._begin()

    def place_robot(self, pose: Pose, number: int, velocity: Command = STOP) -> None:
        """Put the axle of a robot at `pose`, moving at `velocity`.

        `number` is its index in `robots`. Raises MessageError outside the floor, in another body,
        or beyond the robot's limits.
        """
        self._check_inside(pose.x, pose.y, "pose.pose.position")
        axes = {axis.name: axis for axis in self.robot.axes}
        for name, unit in (("vx", "m/s"), ("vy", "m/s"), ("w", "rad/s")):
            low = -axes[name].backward if name in axes else 0.0
            high = axes[name].limit if name in axes else 0.0
            readers.number(getattr(velocity, name), name, low=low, high=high, unit=unit)
        _check_clear(self.simulation.robot_overlap(pose, number=number), "pose.pose.position")
        self.simulation.place_robot(pose, velocity, number=number)
        self.robots[number].sensors.reset()
        self._observe(number)

    def place_object(self, name: str, x: float, y: float, *, vx: float, vy: float) -> None:
        """Put an object on the floor at (x, y) m, rolling at (vx, vy) m/s.

        Raises MessageError outside the floor, in another body, or above 10 m/s.
        """
        self._check_inside(x, y, "position.point")
        for axis, value in (("x", vx), ("y", vy)):
            readers.number(value, f"velocity.{axis}", low=-_FASTEST, high=_FASTEST, unit="m/s")
        _check_clear(self.simulation.object_overlap(name, x, y), "position.point")
        self.simulation.place_object(name, x, y, vx=vx, vy=vy)
        self._observe_placed(name)

    def remove_object(self, name: str) -> None:
        """Take an object off the floor."""
        self.simulation.remove_object(name)
        self._observe_placed(name)

    def _check_inside(self, x: float, y: float, where: str) -> None:
        x_min, y_min, x_max, y_max = self.robot.scene.area.floor
        readers.number(x, f"{where}.x", low=x_min, high=x_max, unit="m")
        readers.number(y, f"{where}.y", low=y_min, high=y_max, unit="m")


def _check_clear(overlap: str, where: str) -> None:
    if overlap:
        raise MessageError(f"{where}: expected a free place, got one that overlaps {overlap}")
