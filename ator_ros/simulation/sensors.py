"""What a robot's sensors make of the true state: odometry drift, a noisy and late ball, dropouts."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import Pose
from ator_ros.world.state import BallState, World

_TELEPORT = 0.3


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """How the sensors err; the default is the truth.

    Attributes
    ----------
    drift : float
        Standard deviation in m of the odometry's position after 1 m of driving; grows with the root of it.
    heading_drift : float
        Standard deviation in rad of the odometry's heading after 1 m of driving; grows alike.
    ball_noise : float
        Standard deviation in m of each coordinate of the ball.
    ball_velocity_noise : float
        Standard deviation in m/s of each component of the ball's velocity.
    ball_delay : float
        Time in s from seeing the ball to knowing it, rounded up to a tick.
    ball_dropouts : float
        Probability in [0, 1) that the ball is not seen in a tick.
    latency : float
        Time in s from a state to word of it, rounded up to a tick: odometry and ball come that late, with the
        time of the state; what `ball_delay` delays is late by both. The first state, and the first after a
        reset or when something was placed, is told at once, and then for that time nothing newer.
    """

    drift: float = 0.0
    heading_drift: float = 0.0
    ball_noise: float = 0.0
    ball_velocity_noise: float = 0.0
    ball_delay: float = 0.0
    ball_dropouts: float = 0.0
    latency: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(
                    f"sensors: {field.name}: expected a number that is not negative, got {value!r}"
                )
        if self.ball_dropouts >= 1.0:
            raise ValueError(f"sensors: ball_dropouts: expected less than 1, got {self.ball_dropouts}")


#: What a real robot has to live with: odometry that drifts, a camera that sees the ball within 3 cm and late.
REALISTIC = SensorConfig(
    drift=0.02,
    heading_drift=0.01,
    ball_noise=0.015,
    ball_velocity_noise=0.05,
    ball_delay=0.1,
    ball_dropouts=0.05,
)


class Sensors:
    """Observes a world, once per control tick.

    The ball is seen from the robot, so that what is believed of it drifts with the odometry. From where it
    was seen last it is believed to have gone on at the velocity seen.

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
        self._seen: deque[tuple[float, BallState]] = deque()
        self._known: tuple[float, BallState] | None = None
        self._coming: deque[World] = deque()

    def observe(self, world: World) -> World:
        """Return what is believed of `world`, with the same time; with a latency, of the last that is known.

        A robot that has jumped, as when it was placed, is believed to be where it is.
        """
        if self.config == SensorConfig():
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
        return World(world.time, robot, self._see(world))

    def _dead_reckoning(self, pose: Pose) -> Pose:
        if self._true is None or self._true.distance(pose) > _TELEPORT:
            return pose
        moved = self._true.relative(pose)
        root = math.sqrt(math.hypot(moved.x, moved.y))
        x, y, yaw = self._rng.normal(size=3) * root
        drift, heading_drift = self.config.drift, self.config.heading_drift
        error = Pose(moved.x + drift * x, moved.y + drift * y, moved.yaw + heading_drift * yaw)
        return self._believed.compose(error)

    def _see(self, world: World) -> BallState | None:
        config = self.config
        numbers = self._rng.normal(size=4)
        missed = self._rng.random() < config.ball_dropouts and self._known is not None
        if world.ball is None:
            self._seen.clear()
            self._known = None
            return None
        if not missed:
            self._seen.append((world.time, self._measured(world, world.ball, numbers.tolist())))
        while self._seen and world.time - self._seen[0][0] >= config.ball_delay - 1e-9:
            self._known = self._seen.popleft()
        if self._known is None and self._seen:
            self._known = self._seen[0]  # better than nothing, just after the ball has appeared
        if self._known is None:
            return None
        time, ball = self._known
        return ball.after(world.time - time)

    def _measured(self, world: World, ball: BallState, numbers: list[float]) -> BallState:
        """Return the ball in the frame of the believed pose, with noise."""
        config, true = self.config, world.robot.pose
        moving = Pose(true.x + ball.vx, true.y + ball.vy, true.yaw)
        place = self._believed.compose(true.relative(Pose(ball.x, ball.y, 0.0)))
        velocity = self._believed.compose(true.relative(moving))
        x, y, vx, vy = numbers
        return BallState(
            place.x + config.ball_noise * x,
            place.y + config.ball_noise * y,
            velocity.x - self._believed.x + config.ball_velocity_noise * vx,
            velocity.y - self._believed.y + config.ball_velocity_noise * vy,
        )
