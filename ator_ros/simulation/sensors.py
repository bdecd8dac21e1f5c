"""What a robot's sensors make of the true state: odometry drift, noisy and late objects, dropouts."""

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
class Sight:
    """How the robot sees an object; the default is the truth.

    Attributes
    ----------
    noise : float
        Standard deviation in m of each coordinate.
    velocity_noise : float
        Standard deviation in m/s of each component of the velocity.
    delay : float
        Time in s from seeing the object to knowing it, rounded up to a tick.
    dropouts : float
        Probability in [0, 1) that the object is not seen in a tick.
    """

    noise: float = 0.0
    velocity_noise: float = 0.0
    delay: float = 0.0
    dropouts: float = 0.0

    def __post_init__(self) -> None:
        _check(self)
        if self.dropouts >= 1.0:
            raise ValueError(f"sensors: dropouts: expected less than 1, got {self.dropouts}")


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """How the sensors err; the default is the truth.

    Attributes
    ----------
    drift : float
        Standard deviation in m of the odometry's position after 1 m of driving; grows with the root of it.
    heading_drift : float
        Standard deviation in rad of the odometry's heading after 1 m of driving; grows alike.
    latency : float
        Time in s from a state to its messages, rounded up to a tick: odometry and objects come that late,
        with the time of the state; what `Sight.delay` delays is late by both. The first state, and the first
        after a reset or when the robot was placed, comes at once, and then for that time nothing newer. An
        object that was placed is seen at once.
    objects : mapping of str to Sight
        How each object is seen, by its name; one that is not named is seen exactly.
    """

    drift: float = 0.0
    heading_drift: float = 0.0
    latency: float = 0.0
    objects: Mapping[str, Sight] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        _check(self)

    @property
    def exact(self) -> bool:
        """Whether the truth is observed."""
        seen_truly = all(sight == Sight() for sight in self.objects.values())
        return seen_truly and not (self.drift or self.heading_drift or self.latency)


def _check(config: Sight | SensorConfig) -> None:
    """Make sure that all numbers of `config` are finite and not negative; raises ValueError."""
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        if not isinstance(value, Mapping) and not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"sensors: {item.name}: expected a number that is not negative, got {value!r}")


#: What a real robot has to live with: a camera that sees an object within 3 cm and late, …
REALISTIC_SIGHT = Sight(noise=0.015, velocity_noise=0.05, delay=0.1, dropouts=0.05)
#: … and odometry that drifts.
REALISTIC = SensorConfig(drift=0.02, heading_drift=0.01)


class _Seeing:
    """One object as it is seen.

    From where it was seen last it is believed to have gone on at the velocity seen.
    """

    def __init__(self, sight: Sight, rng: np.random.Generator) -> None:
        self._sight, self._rng = sight, rng
        self._seen: deque[tuple[float, ObjectState]] = deque()
        self._known: tuple[float, ObjectState] | None = None

    def look(self, time: float, there: ObjectState | None, true: Pose, believed: Pose) -> ObjectState | None:
        """Return what is believed at `time` (s) of an object that is `there`; None: nothing is known."""
        numbers = self._rng.normal(size=4)
        missed = self._rng.random() < self._sight.dropouts and self._known is not None
        if there is None:
            self._seen.clear()
            self._known = None
            return None
        if not missed:
            self._seen.append((time, self._measured(there, numbers.tolist(), true, believed)))
        while self._seen and time - self._seen[0][0] >= self._sight.delay - 1e-9:
            self._known = self._seen.popleft()
        if self._known is None and self._seen:
            self._known = self._seen[0]  # better than nothing, just after the object has appeared
        if self._known is None:
            return None
        last, state = self._known
        return state.after(time - last)

    def _measured(self, there: ObjectState, numbers: list[float], true: Pose, believed: Pose) -> ObjectState:
        """Return the object in the frame of the believed pose, with noise."""
        sight = self._sight
        moving = Pose(true.x + there.vx, true.y + there.vy, true.yaw)
        place = believed.compose(true.relative(Pose(there.x, there.y, 0.0)))
        velocity = believed.compose(true.relative(moving))
        x, y, vx, vy = numbers
        return ObjectState(
            place.x + sight.noise * x,
            place.y + sight.noise * y,
            velocity.x - believed.x + sight.velocity_noise * vx,
            velocity.y - believed.y + sight.velocity_noise * vy,
        )


class Sensors:
    """Observes a world, once per control tick.

    Objects are seen from the robot, so that what is believed of them drifts with the odometry.

    Parameters
    ----------
    config : SensorConfig
        How the sensors err.
    seed : int
        The same seed and worlds give the same observations.
    """

    def __init__(self, config: SensorConfig, seed: int = 0) -> None:
        self.config = config
        self._rng = np.random.default_rng(seed)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next observation of the robot is true."""
        self._true: Pose | None = None
        self._believed = Pose(0.0, 0.0, 0.0)
        self._seeing = {name: _Seeing(sight, self._rng) for name, sight in self.config.objects.items()}
        self._coming: deque[World] = deque()

    def placed(self, name: str, world: World) -> None:
        """See an object where it now is, or no more, also in observations that are still delayed."""
        if self.config.exact:
            return
        self._seeing[name] = _Seeing(self.config.objects.get(name, Sight()), self._rng)
        there = self._believe(world).objects.get(name)
        known = {} if there is None else {name: there}
        self._coming = deque(
            dataclasses.replace(each, objects={**_without(each.objects, name), **known})
            for each in self._coming
        )

    def observe(self, world: World) -> World:
        """Return what is believed of `world`, with the same time; with a latency, of the last that is known.

        A robot that has jumped, as when it was placed, is believed to be where it is.
        """
        if self.config.exact:
            return world
        self._coming.append(self._believe(world))
        while len(self._coming) > 1 and world.time - self._coming[1].time >= self.config.latency - 1e-9:
            self._coming.popleft()
        return self._coming[0]

    def _believe(self, world: World) -> World:
        pose = world.robot.pose
        self._believed = self._dead_reckoning(pose)
        self._true = pose
        robot = dataclasses.replace(world.robot, pose=self._believed)
        for name in world.objects:
            if name not in self._seeing:
                self._seeing[name] = _Seeing(Sight(), self._rng)
        seen = {
            name: seeing.look(world.time, world.objects.get(name), pose, self._believed)
            for name, seeing in self._seeing.items()
        }
        return World(world.time, robot, {name: state for name, state in seen.items() if state is not None})

    def _dead_reckoning(self, pose: Pose) -> Pose:
        if self._true is None or self._true.distance(pose) > _TELEPORT:
            return pose
        moved = self._true.relative(pose)
        root = math.sqrt(math.hypot(moved.x, moved.y))
        x, y, yaw = self._rng.normal(size=3) * root
        drift, heading_drift = self.config.drift, self.config.heading_drift
        error = Pose(moved.x + drift * x, moved.y + drift * y, moved.yaw + heading_drift * yaw)
        return self._believed.compose(error)


def _without(objects: Mapping[str, ObjectState], name: str) -> dict[str, ObjectState]:
    return {other: state for other, state in objects.items() if other != name}
