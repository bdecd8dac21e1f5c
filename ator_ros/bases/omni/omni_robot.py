"""The description of an omnidirectional robot, which answers what `Base` asks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from ator_ros.bases.description import ConfigError, Holder, Robot, at_least
from ator_ros.bases.differential.durations import Rates, drive_time, turn_time
from ator_ros.bases.interface import Axis, Driving, Place, Standstills
from ator_ros.bases.omni.omni_driving import OmniDriving, observed_limits
from ator_ros.bases.omni.omni_limits import OmniLimits
from ator_ros.bases.omni.planar_motion import leg_times
from ator_ros.bases.omni.planar_response import OmniStop, planar_moved
from ator_ros.geometry import FloatArray
from ator_ros.schema import Within
from ator_ros.world.scene import Mass
from ator_ros.world.state import Command, RobotState

if TYPE_CHECKING:
    import pandas as pd

_USUAL_LAG = 0.1  # s; of motors that are not described
_DRAWN = 0.8  # greatest share of the limits in starts in motion


@dataclass(frozen=True, slots=True)
class OmniHolder(Holder):
    """A holder, with the limits of the base while it holds an object."""

    limits: OmniLimits  # for commands while it is held


@dataclass(frozen=True, slots=True, kw_only=True)
class OmniBase(Robot):
    """A robot that moves in any direction, of which only limits are known.

    That suffices where action servers drive it. Lengths in m from its point, whose pose is
    estimated: usually its center.
    """

    drive: ClassVar[str] = "omni"
    driving: ClassVar[type[Driving]] = OmniDriving

    limits: OmniLimits
    holder: OmniHolder | None = None
    stop: OmniStop = field(default=OmniStop())

    __hash__ = Robot.__hash__

    @classmethod
    def kind_for(cls, section: Mapping[str, Any]) -> type[Robot]:
        """Return the class of a robot whose body is described, if any of its fields is."""
        return OmniRobot if _BODY & set(section) else OmniBase

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Moving ahead, moving aside and turning."""
        limits = self.limits
        ahead = Axis(
            name="vx",
            verb="move",
            unit="m/s",
            limit=limits.v,
            backward=limits.backward,
            rate=min(limits.a, limits.brake),
            stop=self.stop.moving,
        )
        aside = Axis(
            name="vy",
            verb="move",
            unit="m/s",
            limit=limits.sideways,
            backward=limits.sideways,
            rate=limits.side_change,
            stop=self.stop.moving,
        )
        turning = Axis(
            name="w",
            verb="turn",
            unit="rad/s",
            limit=limits.w,
            backward=limits.w,
            rate=limits.aw,
            stop=self.stop.turning,
        )
        return ahead, aside, turning

    @property
    def lag(self) -> float:
        """Time constant of the motors in s."""
        return _USUAL_LAG

    def greatest_speed(self, *, holding: bool = False) -> float:
        """See `Base.greatest_speed`."""
        return self.holder_for("holding an object").limits.v if holding else self.limits.v

    def holder_for(self, what: str) -> OmniHolder:
        """Return the holder, which `what` needs; raise ConfigError if the robot has none."""
        holder = Robot.holder_for(self, what)
        assert isinstance(holder, OmniHolder)
        return holder

    def moved(self, robot: RobotState, command: Command | None, seconds: float) -> RobotState:
        """See `Base.moved`."""
        return planar_moved(robot, command, seconds, self.limits, self.stop)

    def stopping_distance(self, speed: float) -> float:
        """See `Base.stopping_distance`."""
        return speed**2 / (2.0 * min(self.stop.moving, self.limits.least_change))

    def standstills(self, robot: RobotState, seconds: float) -> Standstills:
        """Return where the robot may stand: on along the line of its velocity over the floor.

        Actions keep that velocity while the robot turns. An action that brakes does so already,
        since its commands are early by the lag: at 3 m/s, `seconds` are as long as a third of the
        distance in which the base stops.
        """
        speed = robot.speed
        stop = seconds * speed + speed**2 / (2.0 * self.stop.moving)
        brake = speed**2 / (2.0 * self.limits.least_change)
        path = tuple(_place_ahead(robot, share * brake) for share in (0.5, 1.0))
        return Standstills(_place_ahead(robot, stop), (path,))

    def unobserved_driving(self) -> OmniDriving:
        """See `Base.unobserved_driving`."""
        return OmniDriving(self.limits)

    def observed_driving(self, rows: pd.DataFrame) -> OmniDriving:
        """Return the limits of an action that odometry shows; see `observed_limits`."""
        return OmniDriving(observed_limits(rows, self.limits))

    def fastest(self, legs: FloatArray, driving: Driving | None) -> FloatArray:
        """See `Base.fastest`."""
        style = self.unobserved_driving() if driving is None else driving
        if not isinstance(style, OmniDriving):
            raise TypeError(f"driving: expected an OmniDriving, got {type(style).__name__}")
        return leg_times(np.ascontiguousarray(legs), float(self.hold), style.limits.rates)

    def route_time(
        self,
        length: FloatArray,
        turns: Sequence[FloatArray],
        speed: FloatArray,
        arrival_speed: FloatArray,
    ) -> FloatArray:
        """Return the times of routes that are driven forward, turning while it drives.

        At a bend the velocity changes its direction at the greatest acceleration.
        """
        limits = self.limits
        first, bends, last = turns
        rates = Rates(limits.v, limits.w, limits.a, limits.brake, limits.aw)
        driven = drive_time(length, speed, arrival_speed, rates)
        driven = driven + 0.5 * bends * limits.v / limits.side_change
        turned = turn_time(np.minimum(first + bends + last, math.pi), limits.w, limits.aw)
        return np.asarray(np.maximum(driven, turned))

    def draw_velocity(self, rng: np.random.Generator) -> Command:
        """Draw a velocity in any direction."""
        direction = float(rng.uniform(-math.pi, math.pi))
        speed = float(rng.uniform(0.0, _DRAWN)) * self.limits.speed_towards(direction)
        w = float(rng.uniform(-0.5, 0.5)) * self.limits.w
        return Command(speed * math.cos(direction), w, vy=speed * math.sin(direction))


@dataclass(frozen=True, slots=True, kw_only=True)
class OmniRobot(OmniBase):
    """A robot whose body and motors are described, as simulation and planned actions need them.

    Mass in kg, time in s. `grip` is the greatest acceleration in m/s^2 that the friction of the
    wheels transmits; the simulated base pushes with no more than mass times grip.
    """

    mass: Mass
    # A time constant of 0.1 ms is below the simulation's step, and with 10 s a base does not follow
    # its commands.
    motor_time_constant: Annotated[float, Within(0.0001, 10.0)]
    grip: Annotated[float, Within(0.01, 100.0)] = 6.0  # rubber on a hard floor: about 0.6 g
    front_friction: Annotated[float, Within(0.0, 10.0)] = 0.15  # between the front and an object

    def __post_init__(self) -> None:
        """Raise ConfigError if the holder or the friction contradicts the base."""
        Robot.__post_init__(self)
        limits = self.limits
        least = max(limits.a, limits.brake, limits.side_change, self.stop.moving)
        at_least("grip", self.grip, least, "the greatest of limits and stop")

    __hash__ = Robot.__hash__

    @property
    def lag(self) -> float:
        """Time constant of the motors in s."""
        return self.motor_time_constant


_BODY = {"mass", "motor_time_constant", "grip", "front_friction"}
"""The fields of a description that only `OmniRobot` has."""


def omnidirectional(robot: Robot) -> OmniRobot:
    """Return an omnidirectional robot whose body is described; raise ConfigError for others."""
    if isinstance(robot, OmniRobot):
        return robot
    if isinstance(robot, OmniBase):
        raise ConfigError(
            "robot: expected the fields mass, motor_time_constant for simulation, URDF and actions "
            f"that drive the base themselves, robot {robot.name} has none"
        )
    raise ConfigError(f"robot.drive: expected {OmniBase.drive}, got {robot.drive}")


def _place_ahead(robot: RobotState, distance: float) -> Place:
    """Return the place at a distance in m along the velocity over the floor."""
    heading = robot.pose.yaw + math.atan2(robot.vy, robot.vx)
    x = robot.pose.x + distance * math.cos(heading)
    y = robot.pose.y + distance * math.sin(heading)
    return x, y
