"""Sensor errors: drift of odometry; noise, delay and dropouts of objects; latency of both."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState, World

_TELEPORT = 0.3


@dataclass(frozen=True, slots=True)
class ObjectErrors:
    """Errors in the observations of an object; by default none.

    Attributes
    ----------
    noise : float
        Standard deviation in m of each coordinate.
    velocity_noise : float
        Standard deviation in m/s of each component of the velocity.
    delay : float
        Time in s from an observation until it is known, rounded up to a tick.
    dropouts : float
        Probability in [0, 1) that the object is not observed in a tick.
    """

    noise: float = 0.0
    velocity_noise: float = 0.0
    delay: float = 0.0
    dropouts: float = 0.0


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """Errors of all sensors; by default none.

    Attributes
    ----------
    drift : float
        Standard deviation in m of the odometry's position after 1 m of driving; grows with the square root.
    heading_drift : float
        Standard deviation in rad of the odometry's heading after 1 m of driving; grows likewise.
    latency : float
        Time in s from a state to its messages, rounded up to a tick: odometry and objects arrive that late,
        with the time of the state; `ObjectErrors.delay` is added to it. The first state, and the first after
        a reset or a placement of the robot, arrives at once, and then nothing newer for that time.
    objects : mapping of str to ObjectErrors
        Errors of each object by its name; others are observed exactly.
    """

    drift: float = 0.0
    heading_drift: float = 0.0
    latency: float = 0.0
    objects: Mapping[str, ObjectErrors] = field(default_factory=dict, hash=False)

    @property
    def exact(self) -> bool:
        """Whether there are no errors."""
        exact_objects = all(errors == ObjectErrors() for errors in self.objects.values())
        return exact_objects and not (self.drift or self.heading_drift or self.latency)


class _ObservedObject:
    """The observations of one object; the last known one is extrapolated at constant velocity."""

    def __init__(self, errors: ObjectErrors, rng: np.random.Generator) -> None:
        self._errors, self._rng = errors, rng
        self._pending: deque[tuple[float, ObjectState]] = deque()
        self._known: tuple[float, ObjectState] | None = None

    def observe(
        self, time: float, there: ObjectState | None, true: Pose, believed: Pose
    ) -> ObjectState | None:
        """Return the estimate at `time` (s) of an object that is `there`; None if it is unknown.

        `true` is the robot's pose, and `believed` that of its odometry.
        """
        numbers = self._rng.normal(size=4)
        missed = self._rng.random() < self._errors.dropouts and self._known is not None
        if there is None:
            self._pending.clear()
            self._known = None
            return None
        if not missed:
            self._pending.append((time, self._measured(there, numbers.tolist(), true, believed)))
        while self._pending and time - self._pending[0][0] >= self._errors.delay - 1e-9:
            self._known = self._pending.popleft()
        if self._known is None and self._pending:
            self._known = self._pending[0]  # without delay, just after the object has appeared
        if self._known is None:
            return None
        last, state = self._known
        return state.after(time - last)

    def _measured(self, there: ObjectState, numbers: list[float], true: Pose, believed: Pose) -> ObjectState:
        """Return the object in the frame of the believed pose, with noise."""
        errors = self._errors
        moving = Pose(true.x + there.vx, true.y + there.vy, true.yaw)
        place = believed.compose(true.relative(Pose(there.x, there.y, 0.0)))
        velocity = believed.compose(true.relative(moving))
        x, y, vx, vy = numbers
        return ObjectState(
            place.x + errors.noise * x,
            place.y + errors.noise * y,
            velocity.x - believed.x + errors.velocity_noise * vx,
            velocity.y - believed.y + errors.velocity_noise * vy,
        )


class Sensors:
    """Observes a world, once per control tick.

    Objects are observed from the robot, so that their estimates drift with the odometry.

    The same seed and worlds give the same observations.
    """

    def __init__(self, config: SensorConfig, seed: int = 0) -> None:
        self.config = config
        self._rng = np.random.default_rng(seed)
        self.reset()

    def reset(self) -> None:
        """Reset odometry to the next true pose, and forget all observations."""
        self._true: Pose | None = None
        self._believed = Pose(0.0, 0.0, 0.0)
        self._observed: dict[str, _ObservedObject] = {}
        self._coming: deque[World] = deque()

    def placed(self, name: str) -> None:
        """Forget the observations of an object that was placed or removed."""
        self._observed.pop(name, None)

    def observe(self, world: World) -> World:
        """Return the estimate of `world`, with the same time; with a latency, that of an earlier world.

        Odometry of a robot that has jumped, as when it was placed, is reset to its true pose.
        """
        if self.config.exact:
            return world
        pose = world.robot.pose
        self._believed, self._true = self._dead_reckoning(pose), pose
        for name in (*self.config.objects, *world.objects):
            if name not in self._observed:
                errors = self.config.objects.get(name, ObjectErrors())
                self._observed[name] = _ObservedObject(errors, self._rng)
        seen = {
            name: item.observe(world.time, world.objects.get(name), pose, self._believed)
            for name, item in self._observed.items()
        }
        robot = dataclasses.replace(world.robot, pose=self._believed)
        known = {name: state for name, state in seen.items() if state is not None}
        self._coming.append(World(world.time, robot, known))
        while len(self._coming) > 1 and world.time - self._coming[1].time >= self.config.latency - 1e-9:
            self._coming.popleft()
        return self._coming[0]

    def _dead_reckoning(self, pose: Pose) -> Pose:
        if self._true is None or self._true.distance(pose) > _TELEPORT:
            return pose
        moved = self._true.relative(pose)
        root = math.sqrt(math.hypot(moved.x, moved.y))
        x, y, yaw = self._rng.normal(size=3) * root
        drift, heading_drift = self.config.drift, self.config.heading_drift
        error = Pose(moved.x + drift * x, moved.y + drift * y, moved.yaw + heading_drift * yaw)
        return self._believed.compose(error)
