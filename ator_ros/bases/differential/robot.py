"""The description of a robot with two driven wheels, which answers what `Base` asks."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from ator_ros.bases.description import (
    DEFAULT_DRIVE,
    ConfigError,
    Holder,
    Robot,
    at_least,
    at_most,
    rounded_up,
)
from ator_ros.bases.differential.driving import DrivingStyle, plain_driving
from ator_ros.bases.differential.durations import drive_time, turn_time
from ator_ros.bases.differential.legs import fastest_drives
from ator_ros.bases.differential.limits import Limits, StopBraking
from ator_ros.bases.differential.response import driven, stopping_distance
from ator_ros.bases.interface import Axis, Driving, Place, Standstills
from ator_ros.geometry import FloatArray, clip
from ator_ros.schema import Within
from ator_ros.world.scene import Mass, Size
from ator_ros.world.state import Command, RobotState

if TYPE_CHECKING:
    import pandas as pd

_MOST_WHEEL = 0.49  # greatest share of the robot's mass in one wheel
_USUAL_LAG = 0.1  # s; of motors that are not described


@dataclass(frozen=True, slots=True)
class DifferentialHolder(Holder):
    """A holder, with the limits of the base while it holds an object."""

    limits: Limits  # for commands while it is held


@dataclass(frozen=True, slots=True)
class Build:
    """Details of the body for the simulation; `simulation.urdf` derives those that are None."""

    # m; center of mass, behind the axle
    mass_behind: Annotated[float, Within(0.0, 10.0)] | None = None
    mass_height: Size | None = None  # m; center of mass, above the floor
    caster_behind: Size | None = None  # m; from the axle back to the caster
    wheel_mass: Mass | None = None  # kg; of each wheel
    # kg m^2; of each wheel with its motor at the wheel. 1 g and 1 cm have 1e-7, 100 kg and 1 m have
    # 100.
    wheel_inertia: Annotated[float, Within(1e-7, 100.0)] | None = None
    front_friction: Annotated[float, Within(0.0, 10.0)] = 0.15  # between the front and an object


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferentialBase(Robot):
    """A robot with two driven wheels of which only limits are known.

    That suffices where action servers drive it. Lengths in m from the middle of the axle. `grip` is
    the centripetal acceleration in m/s^2 above which its wheels may slide: rubber on a hard floor
    holds about 0.6 g, and two driven wheels carry about 0.7 of the weight.
    """

    drive: ClassVar[str] = DEFAULT_DRIVE
    driving: ClassVar[type[Driving]] = DrivingStyle

    limits: Limits
    holder: DifferentialHolder | None = None
    stop: StopBraking = field(default=StopBraking())
    grip: Annotated[float, Within(0.01, 100.0)] = 4.0  # up to 10 g

    def __post_init__(self) -> None:
        """Raise ConfigError if the holder contradicts the base."""
        Robot.__post_init__(self)
        if self.holder is not None and self.holder.limits.v_back not in (None, self.limits.v_back):
            raise ConfigError(
                "robot.holder.limits.v_back: expected none, as robot.limits.v_back holds with and "
                f"without an object, got {self.holder.limits.v_back:g}"
            )

    __hash__ = Robot.__hash__

    @classmethod
    def kind_for(cls, section: Mapping[str, Any]) -> type[Robot]:
        """Return the class of a robot whose wheels and motors are described, if any of them is."""
        return DifferentialRobot if _BODY & set(section) else DifferentialBase

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Driving and turning."""
        limits = self.limits
        stop = min(self.stop.forward, self.stop.backward)
        driving = Axis(
            name="vx",
            verb="move",
            unit="m/s",
            limit=limits.v,
            backward=limits.backward,
            rate=min(limits.a, limits.brake),
            stop=stop,
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
        return driving, turning

    @property
    def lag(self) -> float:
        """Time constant of the motors in s."""
        return _USUAL_LAG

    def greatest_speed(self, *, holding: bool = False) -> float:
        """See `Base.greatest_speed`."""
        return self.holder_for("holding an object").limits.v if holding else self.limits.v

    def holder_for(self, what: str) -> DifferentialHolder:
        """Return the holder, which `what` needs; raise ConfigError if the robot has none."""
        holder = Robot.holder_for(self, what)
        assert isinstance(holder, DifferentialHolder)
        return holder

    def moved(self, robot: RobotState, command: Command | None, seconds: float) -> RobotState:
        """See `Base.moved`."""
        return driven(robot, command, seconds, self.limits, self.stop)

    def stopping_distance(self, speed: float) -> float:
        """See `Base.stopping_distance`."""
        return max(stopping_distance(speed, self.stop), speed**2 / (2.0 * self.limits.brake))

    def standstills(self, robot: RobotState, seconds: float) -> Standstills:
        """Return where the robot may stand: straight ahead, or along its present arc."""
        reach = seconds * abs(robot.vx)
        stop = math.copysign(abs(stopping_distance(robot.vx, self.stop)) + reach, robot.vx)
        brake = math.copysign(robot.vx**2 / (2.0 * self.limits.brake) + reach, robot.vx)
        straight = (_place_after(robot, brake, 0.0),)
        arc = tuple(_place_on_arc(robot, share * brake) for share in (0.5, 1.0))
        return Standstills(_place_after(robot, stop, 0.0), (straight, arc))

    def unobserved_driving(self) -> DrivingStyle:
        """See `Base.unobserved_driving`."""
        return plain_driving(self.limits)

    def observed_driving(self, rows: pd.DataFrame) -> DrivingStyle:
        """Return limits, turns and approaches of an action; see `observation.observed_driving`."""
        from ator_ros.bases.differential import observation  # needs pandas

        return observation.observed_driving(rows, self)

    def completed_driving(self, driving: Driving, starts: pd.DataFrame) -> Driving:
        """Return `driving` with the angle above which it drives backward, if that is open."""
        from ator_ros.bases.differential import observation  # needs pandas

        style = driving_style(driving)
        if style.uses_quantities:
            return style
        return dataclasses.replace(style, backward_above=observation.backward_above(starts, self))

    def fastest(self, legs: FloatArray, driving: Driving | None) -> FloatArray:
        """See `Base.fastest`."""
        style = self.unobserved_driving() if driving is None else driving_style(driving)
        return fastest_drives(legs, style, self.hold, self.limits.aw)

    def route_time(
        self,
        length: FloatArray,
        turns: Sequence[FloatArray],
        speed: FloatArray,
        arrival_speed: FloatArray,
    ) -> FloatArray:
        """Return the times of routes at the limits, with turns on the spot at both ends."""
        limits = self.limits
        first, bends, last = turns
        first_turn = turn_time(first, limits.w, limits.aw)
        last_turn = turn_time(last, limits.w, limits.aw)
        turning = first_turn + last_turn + bends / limits.w
        return np.asarray(turning + drive_time(length, speed, arrival_speed, limits))

    def steady_rate(self, w: float, v: float) -> float:
        """Return the turn rate `w` (rad/s), limited so that wheels do not slide at `v` (m/s)."""
        most = self.grip / max(abs(v), 1e-3)
        return math.copysign(min(abs(w), most), w)

    def draw_velocity(self, rng: np.random.Generator) -> Command:
        """Draw a velocity, at which the wheels do not slide."""
        limits = self.limits
        least = -0.3 if limits.backward else 0.0
        v = float(rng.uniform(least, 0.8) * limits.v)
        w = float(rng.uniform(-0.5, 0.5) * limits.w)
        return Command(v, self.steady_rate(w, v))

    def content(self) -> dict[str, Any]:
        """Return all fields but the map, without a default `v_back`."""
        content = Robot.content(self)
        for section in filter(None, (content, content["holder"])):
            if section["limits"]["v_back"] is None:
                del section["limits"]["v_back"]
        return content


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferentialRobot(DifferentialBase):
    """A robot whose wheels and motors are described, as simulation and planned actions need them.

    Mass in kg, torque in N m, time in s.
    """

    wheel_radius: Size
    track: Size
    mass: Mass
    # Torques from a toy's to a 10 t vehicle's. A time constant of 0.1 ms is below the simulation's
    # step, and with 10 s a base does not follow its commands.
    wheel_torque: Annotated[float, Within(0.001, 10_000.0)]
    motor_time_constant: Annotated[float, Within(0.0001, 10.0)]
    build: Build = Build()

    def __post_init__(self) -> None:
        """Raise ConfigError if sizes, masses or torques contradict each other."""
        DifferentialBase.__post_init__(self)
        build = self.build
        caster = self.rear if build.caster_behind is None else build.caster_behind
        width = 2.0 * self.half_width
        torque = least_torque(self.mass, self.wheel_radius, self.limits)
        most_wheel = _MOST_WHEEL * self.mass
        at_most("build.wheel_mass", build.wheel_mass, most_wheel, "as the body has a mass")
        at_most("build.caster_behind", build.caster_behind, self.rear, "where the robot ends")
        at_most("build.mass_behind", build.mass_behind, caster, "where the robot is supported")
        why = f"which {self.mass:g} kg need to accelerate"
        at_least("wheel_torque", self.wheel_torque, torque, why)
        at_most("track", self.track, width, "the width of the robot with its wheels")

    __hash__ = Robot.__hash__

    @property
    def lag(self) -> float:
        """Time constant of the motors in s."""
        return self.motor_time_constant


_BODY = {"wheel_radius", "track", "mass", "wheel_torque", "motor_time_constant", "build"}
"""The fields of a description that only `DifferentialRobot` has."""


def differential(robot: Robot) -> DifferentialRobot:
    """Return a robot with two driven wheels that are described; raise ConfigError for others."""
    if isinstance(robot, DifferentialRobot):
        return robot
    if isinstance(robot, DifferentialBase):
        raise ConfigError(
            f"robot: expected the fields {', '.join(sorted(_BODY - {'build'}))} for simulation, "
            f"URDF and actions that drive the base themselves, robot {robot.name} has none"
        )
    raise ConfigError(
        f"robot.drive: expected {DEFAULT_DRIVE} for this simulation or action, got {robot.drive}"
    )


def driving_style(driving: Driving) -> DrivingStyle:
    """Return the style of a base with two driven wheels; raise TypeError for another."""
    if not isinstance(driving, DrivingStyle):
        raise TypeError(f"driving: expected a DrivingStyle, got {type(driving).__name__}")
    return driving


def least_torque(mass: float, wheel_radius: float, limits: Limits) -> float:
    """Return the torque in N m with which each of two wheels accelerates a mass in kg: F = m a."""
    return rounded_up(0.5 * mass * max(limits.a, limits.brake) * wheel_radius)


def _place_on_arc(robot: RobotState, path: float) -> Place:
    """Return the place after `path` m along the present arc, which turns by at most half a turn."""
    turned = clip(path * robot.w / robot.vx, math.pi) if robot.vx != 0.0 else 0.0
    return _place_after(robot, path, turned)


def _place_after(robot: RobotState, path: float, turned: float) -> Place:
    """Return the place after `path` m on an arc that turns by `turned` rad."""
    half = turned / 2.0
    chord = path * (math.sin(half) / half if turned else 1.0)
    yaw = robot.pose.yaw + half
    x = robot.pose.x + chord * math.cos(yaw)
    y = robot.pose.y + chord * math.sin(yaw)
    return x, y
