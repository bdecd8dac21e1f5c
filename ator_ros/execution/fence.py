"""The area in which the robot may drive."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.actions.base import Goal, Point
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import routes_of
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.objects import at_object, at_rest, followed, has_left, is_at_front
from ator_ros.tops.ranges import Range, Ranges
from ator_ros.world.state import CONTROL_PERIOD, World

# s for which an object must lead out; before, its velocity may be wrong, see `VelocityCheck`
_DEBOUNCE = 0.3
_ROUNDING = 1e-6  # m; coordinates of 1e7 m have a resolution of 2e-9 m
_TOLERANCE = 0.05  # m by which an action may miss its goal or its path


def edge_distance(robot: Robot) -> float:
    """Return the least distance in m of a goal from the edge, so that `FenceWatch` does not end it.

    It is the sum of the position tolerance and of the distance that the robot drives at full speed
    until it follows the next command. The rate of odometry is not known yet; CONTROL_PERIOD is
    assumed.
    """
    return _TOLERANCE + robot.greatest_speed() * (CONTROL_PERIOD + robot.lag)


def _inside(
    axis: str, ranges: Ranges, edges: tuple[float, float], robot: Robot, goal: Goal
) -> Range:
    """Return the part of a coordinate's range between two edges of a fence, at all speeds."""
    full = ranges[axis](robot, goal)
    speeds = ranges.get("speed")
    speed = goal.speed if speeds is None else speeds(robot, goal).high
    distance = edge_distance(robot) + robot.stopping_distance(speed)
    distance += robot.hold if goal.point is Point.HOLD else 0.0  # at any heading
    low = max(full.low, edges[0] + distance)
    high = min(full.high, edges[1] - distance)
    if low <= high:
        return dataclasses.replace(full, low=low, high=high)
    value = getattr(goal.pose, axis)
    return dataclasses.replace(full, low=value, high=value, steps=1)


@dataclass(frozen=True, slots=True)
class Fence:
    """A rectangle for the middle of the robot's axle, in m in odometry's frame.

    Its body may stick out.
    """

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @classmethod
    def around(cls, robot: Robot) -> Fence:
        """Return the fence around the area and its margin."""
        return cls(*robot.scene.area.floor)

    @classmethod
    def of(cls, edges: Sequence[float]) -> Fence:
        """Return the fence with edges x_min, y_min, x_max, y_max in m.

        ValueError if they are not valid.
        """
        if len(edges) != 4 or not all(map(math.isfinite, edges)):
            raise ValueError(f"expected four finite numbers in m, got {list(edges)}")
        fence = cls(*edges)
        if not (fence.x_min < fence.x_max and fence.y_min < fence.y_max):
            raise ValueError(
                f"expected least x, least y, greatest x, greatest y in m, got {list(edges)}"
            )
        return fence

    def narrowed(self, ranges: Ranges, robot: Robot) -> Ranges:
        """Return the parts of ranges with which the robot stays inside at all speeds.

        The fence around the area changes no range. Where no values are left, the range is the
        goal's value.
        """
        if self == Fence.around(robot):
            return ranges
        edges = {"x": (self.x_min, self.x_max), "y": (self.y_min, self.y_max)}
        inside = {
            axis: functools.partial(_inside, axis, ranges, bounds)
            for axis, bounds in edges.items()
            if axis in ranges
        }
        return {**ranges, **inside}

    def outside(self, x: float, y: float) -> float:
        """Return the distance in m from (x, y) in m to the area; 0 inside."""
        return math.hypot(
            max(self.x_min - x, 0.0, x - self.x_max), max(self.y_min - y, 0.0, y - self.y_max)
        )

    def violation(self, chain: TopChain, robot: Robot, where: str = "chain") -> str | None:
        """Return the fault of the first step that leads out or into an obstacle, or None.

        Executor and refinement reject such chains with this sentence, which begins with `where`.
        """
        for number, call in enumerate(chain.calls):
            if self.leads_out(call, robot):
                x, y, _ = call.goal.robot_pose(robot)
                return (
                    f"{where}.calls[{number}].goal ({call.top.name}): expected a place for the "
                    f"robot inside the {self}, {edge_distance(robot):.2f} m from its edge, with "
                    f"room to stop, got the axle at x {x:.2f} m, y {y:.2f} m, "
                    f"{call.goal.speed:.2f} m/s; change scene.area or the parameter fence"
                )
        return self.unreachable(chain, robot, where)

    def unreachable(
        self,
        chain: TopChain,
        robot: Robot,
        where: str = "chain",
        start: tuple[float, float] | None = None,
        *,
        planned: bool = False,
    ) -> str | None:
        """Return the fault of the first step without a route from `start` (m), or None.

        Places that are free variables are not checked; `planned` as for `Routes.fault`.
        """
        routes = routes_of(robot)
        if routes is None:
            return None
        for number, call in enumerate(chain.calls):
            x, y, _ = call.goal.robot_pose(robot)
            given = call.top.arrives and not (call.opens("x") or call.opens("y"))
            if given and (fault := routes.fault(x, y, start, planned=planned)):
                return f"{where}.calls[{number}].goal ({call.top.name}): {fault}"
            start = (x, y) if given else None
        return None

    def leads_out(self, call: TopCall, robot: Robot) -> bool:
        """Return whether the goal of a step puts the robot, or the object that it holds, outside.

        The robot must stop `edge_distance` inside the edge, also after an arrival at speed. Steps
        whose post-condition does not move the robot to the goal never lead out.
        """
        if not call.top.arrives:
            return False
        goal = call.goal
        distance = edge_distance(robot)
        if goal.point is Point.HOLD and self.outside(goal.pose.x, goal.pose.y) > 0.0:
            return True
        pose = goal.robot_pose(robot)
        stopped = pose.ahead(robot.stopping_distance(goal.speed))
        x_min, y_min, x_max, y_max = dataclasses.astuple(self)
        inner = Fence(x_min + distance, y_min + distance, x_max - distance, y_max - distance)
        return any(inner.outside(*place[:2]) > _ROUNDING for place in (pose, stopped))

    def __str__(self) -> str:
        return (
            f"fence (x from {self.x_min:.10g} to {self.x_max:.10g} m, "
            f"y from {self.y_min:.10g} to {self.y_max:.10g} m)"
        )


class FenceWatch:
    """Detects, during one goal, that the robot is about to leave the area.

    A robot that starts outside may drive in. Its distance must not exceed that of its start plus
    twice its reach, which it needs to turn. Once inside, it must stay inside. After `longest_gap` s
    without a state the robot is commanded to stand anyway.
    """

    def __init__(self, fence: Fence, robot: Robot, longest_gap: float) -> None:
        self._fence = fence
        self._robot = robot
        self._longest_gap = longest_gap
        self._allowed = math.inf
        self._time: float | None = None
        self._period = 0.0  # s between the last two states
        self._leads_out_since = math.inf

    @property
    def pausing(self) -> bool:
        """Whether the robot should stand because the followed object leads out."""
        return self._leads_out_since < math.inf

    def fault(self, world: World, call: TopCall) -> str | None:
        """Process a state during `call`; return why the goal must end, or None."""
        pose = world.robot.pose
        here = self._fence.outside(pose.x, pose.y)
        self._allowed = min(self._allowed, here + 2.0 * self._robot.reach if here > 0.0 else 0.0)
        # The base follows the command for the next state at the earliest.
        elapsed = 0.0 if self._time is None else world.time - self._time
        self._period = min(elapsed, self._longest_gap)
        self._time = world.time
        return self._leaving(world, 0.0) or self._following(world, call)

    def may_leave(self, world: World, delay: float) -> bool:
        """Return whether the robot may leave if the last state is late by `delay` s."""
        return self._leaving(world, delay) is not None

    def _leaving(self, world: World, delay: float) -> str | None:
        robot = world.robot
        pose = world.robot.pose
        stands = self._robot.standstills(robot, delay + self._period + self._robot.lag)
        outside = self._fence.outside
        braking = min(max(outside(*place) for place in path) for path in stands.braking)
        if max(outside(*stands.commanded), braking) <= self._allowed:
            return None
        return (
            f"the robot would leave the {self._fence}: it drives at {robot.speed:.2f} m/s "
            f"from x {pose.x:.2f} m, y {pose.y:.2f} m, {math.degrees(pose.yaw):.0f} degrees, "
            "and could not stand inside"
        )

    def _following(self, world: World, call: TopCall) -> str | None:
        """Return why the object must not be followed, if it has led out for `_DEBOUNCE` s."""
        resting = at_rest(world, self._robot)
        name = followed(call.top)
        if (
            name is None
            or is_at_front(world, self._robot, name)
            or not has_left(resting, call, self._robot)
        ):
            self._leads_out_since = math.inf
            return None
        goal = at_object(call.goal, resting, name)
        out = self._fence.leads_out(dataclasses.replace(call, goal=goal), self._robot)
        self._leads_out_since = min(self._leads_out_since, world.time) if out else math.inf
        if world.time - self._leads_out_since < _DEBOUNCE:
            return None
        x, y, _ = goal.pose
        return (
            f"the {name} leaves the {self._fence}: {call.top.name} would lead to x {x:.2f} m, "
            f"y {y:.2f} m"
        )
