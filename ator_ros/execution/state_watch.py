"""Monitoring of states during one goal: whether they are late, and whether objects are in the robot."""

from __future__ import annotations

import enum

from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import followed, objects_in
from ator_ros.world.state import World

# s, by the stamps, after which a base obeys a command to stand: two messages at 20 Hz, as in
# `MotionWatch`, and three to show it
_OBEYS = 0.25
_MARGIN = 0.05  # s; one message
_LEAST_LOSS = 0.1  # least share of the described deceleration in that time
# s for which an object must be inside the robot: longer than the wrong states of a reset
_STAYS = 0.5


class Timeliness(enum.Enum):
    """Whether states arrive in time."""

    IN_TIME = "in time"
    DOUBTFUL = "late, or of a clock that has become slower"
    LATE = "late"
    SLOWER = "of a clock that has become slower"
    UNKNOWN = "late, or of a clock that became slower while the robot stood"


class DelayWatch:
    """Decides whether delayed states are late, or of a clock that has become slower.

    The robot has to be commanded to stand while it is doubtful. If its states show that it brakes,
    the clock has become slower, as that of a simulation on a busy machine. A robot whose states
    are late is shown to drive on.

    `longest` is the greatest delay in s, at least 0.3: less than the time in which a base obeys
    does not show in its states.
    """

    def __init__(self, robot: Robot, longest: float) -> None:
        self._robot, self._longest = robot, max(longest, _OBEYS + _MARGIN)
        self._since: World | None = None

    @property
    def is_doubtful(self) -> bool:
        """Whether the last states were delayed while the robot was to stand."""
        return self._since is not None

    def judge(self, world: World, delay: float) -> Timeliness:
        """Process a state and its delay in s, see `Delay`."""
        if delay <= self._longest and self._since is None:
            return Timeliness.IN_TIME
        since = self._since = self._since or world
        if world.robot.is_standing:
            self._since = None
            return Timeliness.UNKNOWN if since is world else Timeliness.SLOWER
        elapsed = world.time - since.time
        if elapsed < _OBEYS + self._robot.motor_time_constant:
            return Timeliness.DOUBTFUL
        stop = self._robot.stop
        lost_v = abs(since.robot.v) - abs(world.robot.v)
        lost_w = abs(since.robot.w) - abs(world.robot.w)
        brakes = max(
            lost_v / min(stop.forward, stop.backward),
            lost_w / stop.turning,
        )
        return Timeliness.DOUBTFUL if brakes >= _LEAST_LOSS * elapsed else Timeliness.LATE


class PlaceWatch:
    """Detects objects that are seen where the robot is.

    A described object has a size. Other ones may be marks on the floor, unless the robot drives to
    them and they move along with it.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._inside: dict[str, World] = {}  # the first of the states in which an object is inside

    def fault(self, world: World, top: Top) -> str | None:
        """Process a state; return which object of `top` cannot be where it is seen, or None."""
        robot = self._robot
        inside = {name for name in objects_in(top) if self._is_inside(world, name)}
        self._inside = {name: self._inside.get(name, world) for name in sorted(inside)}
        for name, first in self._inside.items():
            stays = world.time - first.time >= _STAYS
            moved = world.robot.pose.distance(first.robot.pose)
            moves_along = name == followed(top) and moved > robot.front + robot.rear
            if stays and (robot.scene.radius(name) > 0.0 or moves_along):
                there = _relative(world, name)
                return (
                    f"the {name} cannot be at the robot: expected it outside the robot's body, got it "
                    f"{there.x:.2f} m ahead of the middle of the axle and {there.y:.2f} m to the left; "
                    "check what detects it"
                )
        return None

    def _is_inside(self, world: World, name: str) -> bool:
        """Return whether the center of an object is in the robot's body."""
        if name not in world.objects:
            return False
        robot, there = self._robot, _relative(world, name)
        return -robot.rear < there.x < robot.front and abs(there.y) < robot.half_width


def _relative(world: World, name: str) -> Pose:
    """Return the place of an object in the robot's frame."""
    pose, there = world.robot.pose, world.objects[name]
    return pose.relative(pose._replace(x=there.x, y=there.y))
