"""A base from outside the package: a point that moves in any direction and never turns."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ator_ros.actions.base import Action, Goal, Status, Step, finished
from ator_ros.bases.description import Robot
from ator_ros.bases.interface import Axis, Driving, Standstills
from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import CONTROL_PERIOD, Command, RobotState, World


@dataclass(frozen=True, slots=True, kw_only=True)
class PointRobot(Robot):
    drive: ClassVar[str] = "point"
    speed: float
    lag: ClassVar[float] = 0.0  # type: ignore[misc]
    __hash__ = Robot.__hash__

    @property
    def axes(self) -> tuple[Axis, ...]:
        at_once = self.speed / CONTROL_PERIOD  # m/s^2
        ahead, aside = (
            Axis(name, "move", "m/s", self.speed, self.speed, at_once, at_once)
            for name in ("vx", "vy")
        )
        return ahead, aside

    def greatest_speed(self, *, holding: bool = False) -> float:
        return self.speed

    def moved(self, robot: RobotState, command: Command | None, seconds: float) -> RobotState:
        velocity = robot.velocity if command is None else command
        size = math.hypot(velocity.vx, velocity.vy)
        share = min(1.0, self.speed / size) if size else 0.0
        vx, vy = share * velocity.vx, share * velocity.vy
        pose = robot.pose.compose(Pose(seconds * vx, seconds * vy, 0.0))
        return RobotState(pose, vx, vy=vy)

    def stopping_distance(self, speed: float) -> float:
        return speed * CONTROL_PERIOD

    def standstills(self, robot: RobotState, seconds: float) -> Standstills:
        x, y, _ = self.moved(robot, None, seconds).pose
        return Standstills((x, y), (((x, y),),))

    def fastest(self, legs: FloatArray, driving: Driving | None) -> FloatArray:
        x, y, *_, xg, yg, _, _, _ = legs
        return np.stack([np.hypot(xg - x, yg - y) / self.speed, np.zeros_like(x)])

    def route_time(
        self, length: FloatArray, turns: Any, speed: FloatArray, arrival_speed: FloatArray
    ) -> FloatArray:
        return length / self.speed

    def draw_velocity(self, rng: np.random.Generator) -> Command:
        direction = rng.uniform(-math.pi, math.pi)
        return Command(self.speed * math.cos(direction), vy=self.speed * math.sin(direction))


class GoStraight(Action):
    """Move straight to the goal's place."""

    name = "goStraight"

    def start(self, world: World, goal: Goal) -> None:
        self._goal = goal.pose

    def step(self, world: World) -> Step:
        to = world.robot.pose.relative(self._goal)
        if math.hypot(to.x, to.y) < 0.01:
            return finished(Status.SUCCEEDED, "arrived")
        return Step(Command(to.x / CONTROL_PERIOD, vy=to.y / CONTROL_PERIOD), Status.RUNNING, "")
