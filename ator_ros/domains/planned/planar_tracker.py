"""Tracking of a planned motion by an omnidirectional base, with feedback on all three axes."""

from __future__ import annotations

import math

from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.bases.omni.planar_motion import PlanarPlan
from ator_ros.bases.omni.planar_response import within_limits
from ator_ros.domains.planned.tracker import DISTURBED_DISTANCE, DISTURBED_HEADING
from ator_ros.geometry import Pose
from ator_ros.world.state import CONTROL_PERIOD, Command, RobotState, World

_GAIN = 2.5  # m/s per m, and rad/s per rad; more is unstable at a lag of 0.2 s
_SLOWEST_LAG = 0.2  # s: lag above which the gain falls
# The plan's time passes more slowly while the robot is farther behind, in m and rad, than a base as
# described (0.03 m and 0.06 rad), and by `_LEAST_RATE` at most: a base weaker than described.
_BEHIND = 0.04
_TURNED_OFF = 0.1
_STRETCH = 0.125  # m above this deviation at which the time would stop
_TURN_STRETCH = 0.3  # rad
_LEAST_RATE = 0.3  # s of the plan in 1 s
_ROUNDING = 1e-6  # s: greatest error of sums of ticks


class PlanarTracker:
    """Steers an omnidirectional robot along a plan that starts at a time in s."""

    def __init__(self, robot: OmniRobot, plan: PlanarPlan, start_time: float) -> None:
        self.plan = plan
        self._robot = robot
        self._start = self._last_time = start_time
        self._rate = 1.0
        # The velocity of a command is reached after the ramp of a period and the lag of the motors.
        self._preview = 0.8 * CONTROL_PERIOD + robot.motor_time_constant
        self._gain = _GAIN * min(1.0, _SLOWEST_LAG / self._preview)

    def keep_time(self, world: World) -> None:
        """Advance the plan's time to the state of this tick, as fast as the robot follows."""
        passed = world.time - self._last_time
        self._last_time = world.time
        error = self.deviation(world)
        planned = self.plan.at(self.elapsed(world))
        behind = 0.0
        if planned.speed > 0.0:
            # The deviation is relative to the robot; nearly the same is relative to the plan.
            behind = (error.x * planned.vx + error.y * planned.vy) / planned.speed
        slower = max((behind - _BEHIND) / _STRETCH, (abs(error.yaw) - _TURNED_OFF) / _TURN_STRETCH)
        self._rate = max(_LEAST_RATE, 1.0 - max(0.0, slower))
        self._start += (1.0 - self._rate) * passed

    def left(self, world: World) -> float:
        """Return the time in s to the end of the plan; not positive afterwards."""
        return self.plan.duration - self.elapsed(world) - _ROUNDING

    def disturbed(self, world: World) -> bool:
        """Return whether the robot is too far from the plan to follow it."""
        error = self.deviation(world)
        is_far = math.hypot(error.x, error.y) > DISTURBED_DISTANCE
        return is_far or abs(error.yaw) > DISTURBED_HEADING

    def elapsed(self, world: World) -> float:
        """Return the time in s since the plan started."""
        return world.time - self._start

    def deviation(self, world: World) -> Pose:
        """Return the planned pose relative to the robot."""
        return world.robot.pose.relative(self.plan.at(self.elapsed(world)).pose)

    def planned_velocity(self, world: World) -> Command:
        """Return the planned velocity over the floor, in the frame of the robot."""
        planned = self.plan.at(self.elapsed(world))
        return _seen_from(world.robot.pose.yaw, planned)

    def command(self, world: World) -> Command:
        """Return the next velocity command."""
        error = self.deviation(world)
        ahead = self.plan.at(self.elapsed(world) + self._rate * self._preview)
        # The velocity over the floor, in the frame that the robot has in the middle of the period.
        turned = 0.5 * world.robot.w * CONTROL_PERIOD
        planned = _seen_from(world.robot.pose.yaw + turned, ahead)
        return within_limits(
            Command(
                self._rate * planned.vx + self._gain * error.x,
                self._rate * planned.w + self._gain * error.yaw,
                vy=self._rate * planned.vy + self._gain * error.y,
            ),
            self._robot.limits,
        )


def _seen_from(heading: float, state: RobotState) -> Command:
    """Return the velocity of a state in the frame of a robot with another heading in rad."""
    over_floor = Pose(0.0, 0.0, state.pose.yaw).compose(Pose(state.vx, state.vy, 0.0))
    vx, vy, _ = Pose(0.0, 0.0, heading).relative(over_floor)
    return Command(vx, state.w, vy=vy)
