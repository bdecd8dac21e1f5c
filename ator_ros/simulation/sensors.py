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

_TELEPORT = 0.3  # m; a robot that moves farther in a tick was placed


@dataclass(frozen=True, slots=True)
class ObjectErrors:
    """Errors in the observations of an object; by default none.

    Attributes
    ----------
    noise : float
        Standard deviation of each coordinate, in m.
    velocity_noise : float
        Standard deviation of each component of the velocity, in m/s.
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
    drift, heading_drift : float
        Standard deviations of the odometry after 1 m of driving: of the position in m, of the
        heading in rad. They grow with the square root of the distance.
    latency : float
        Time in s from a state to its messages, rounded up to a tick. The messages have the time of
        the state. `ObjectErrors.delay` is added. The first state, also after a reset, arrives at
        once.
    objects : mapping of str to ObjectErrors
        Errors by the name of the object; others have none.
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
        self._errors = errors
        self._rng = rng
        # the known one first, then delayed ones
        self._observed: deque[tuple[float, ObjectState]] = deque()

    def observe(
        self, time: float, there: ObjectState | None, robot: Pose, odometry: Pose
    ) -> ObjectState | None:
        """Return the estimate at `time` (s) of an object that is `there`; None if it is nowhere."""
        numbers = self._rng.normal(size=4).tolist()
        missed = self._rng.random() < self._errors.dropouts
        if there is None:
            self._observed.clear()
            return None
        if not (missed and self._observed):  # the first observation is neither missed nor delayed
            self._observed.append((time, self._measured(there, numbers, robot, odometry)))
        while len(self._observed) > 1 and time - self._observed[1][0] >= self._errors.delay - 1e-9:
            self._observed.popleft()
        last, state = self._observed[0]
        return state.after(time - last)

    def _measured(
        self, there: ObjectState, numbers: list[float], robot: Pose, odometry: Pose
    ) -> ObjectState:
        """Return the object in the frame of odometry, with noise; `robot` is the true pose."""
        errors = self._errors
        x, y, vx, vy = numbers
        moving = Pose(
            robot.x + there.vx,
            robot.y + there.vy,
            robot.yaw,
        )
        place = odometry.compose(robot.relative(Pose(there.x, there.y, 0.0)))
        velocity = odometry.compose(robot.relative(moving))
        return ObjectState(
            place.x + errors.noise * x,
            place.y + errors.noise * y,
            velocity.x - odometry.x + errors.velocity_noise * vx,
            velocity.y - odometry.y + errors.velocity_noise * vy,
        )


class Sensors:
    """Observes a world, once per control tick; the same seed and worlds give the same observations.

    Objects are observed from the robot, so that their estimates drift with the odometry.
    """

    def __init__(self, config: SensorConfig, seed: int = 0) -> None:
        self.config = config
        self._rng = np.random.default_rng(seed)
        self.reset()

    def reset(self) -> None:
        """Reset odometry to the next true pose, and delete all observations."""
        self._true: Pose | None = None
        self._odometry = Pose(0.0, 0.0, 0.0)
        self._observed: dict[str, _ObservedObject] = {}
        self._delayed: deque[World] = deque()

    def placed(self, name: str) -> None:
        """Delete the observations of an object that was placed or removed."""
        self._observed.pop(name, None)

    def observe(self, world: World) -> World:
        """Return the estimate of a world; with a latency, that of an earlier world.

        The estimate has the time of its world. Odometry of a robot that has jumped, as when it was
        placed, is reset to its true pose.
        """
        if self.config.exact:
            return world
        pose = world.robot.pose
        self._odometry = self._dead_reckoning(pose)
        self._true = pose
        for name in (*self.config.objects, *world.objects):
            if name not in self._observed:
                errors = self.config.objects.get(name, ObjectErrors())
                self._observed[name] = _ObservedObject(errors, self._rng)
        known = {}
        for name, item in self._observed.items():
            state = item.observe(
                world.time,
                world.objects.get(name),
                pose,
                self._odometry,
            )
            if state is not None:
                known[name] = state
        robot = dataclasses.replace(world.robot, pose=self._odometry)
        self._delayed.append(World(world.time, robot, known))
        least_age = self.config.latency - 1e-9
        while len(self._delayed) > 1 and world.time - self._delayed[1].time >= least_age:
            self._delayed.popleft()
        return self._delayed[0]

    def _dead_reckoning(self, pose: Pose) -> Pose:
        if self._true is None or self._true.distance(pose) > _TELEPORT:
            return pose
        moved = self._true.relative(pose)
        root = math.sqrt(math.hypot(moved.x, moved.y))
        x, y, yaw = self._rng.normal(size=3) * root
        drift = self.config.drift
        heading_drift = self.config.heading_drift
        error = Pose(
            moved.x + drift * x,
            moved.y + drift * y,
            moved.yaw + heading_drift * yaw,
        )
        return self._odometry.compose(error)
