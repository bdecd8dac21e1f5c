"""Monitoring of states during one goal: whether they are late, and objects where they can be."""

from __future__ import annotations

import enum
import math

from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import followed, is_at_front, is_held, objects_in
from ator_ros.world.delay import Delay
from ator_ros.world.state import World

# s, by the stamps, after which a base obeys a command to stand: two messages at 20 Hz, as in
# `MotionWatch`, and three to show it
_REACTION = 0.25
_MESSAGE = 0.05  # s between two messages at 20 Hz
# least share of the described deceleration in that time: a base that drives on loses nothing, and
# one that `MotionWatch` accepts as slow a quarter or more
_LEAST_LOSS = 0.1
# s for which an object must be inside the robot: longer than the wrong states after a reset
_PERSISTS = 0.5
# s between two states above which the first is forgotten: so at least three states are wrong
_LONGEST_GAP = 0.4
# m by which a place beside the robot may differ: noise of cameras
_FIXED = 0.05
# s by which detections may be late: then the place differs with the robot's speed
_FIXED_TIME = 0.1
# m by which an object may seem to be in the robot: noise of cameras and errors of its description
_OVERLAP = 0.08
_BACKWARD = 0.1  # m that a robot drives backward, away from an object that it has pushed
_FOLLOWED = 0.3  # greatest share of that by which the place beside the robot may differ
_PULLED = 3  # states in a row in which it must be so: noise of cameras
# An object that rolls or walks may by chance keep its place while the robot drives evenly.
_SPEED_CHANGE = 0.4  # share of the greatest speed by which the speed must vary, or
_TURN = 1.0  # rad by which the robot must turn
_DRIVEN = 3.0  # lengths of the robot that it must drive meanwhile


class Timeliness(enum.Enum):
    """Whether states arrive in time."""

    IN_TIME = "in time"
    DOUBTFUL = "late, or of a clock that has become slower"
    LATE = "late"


class DelayWatch:
    """Decides whether delayed states are late, or of a clock that has become slower.

    The robot has to be commanded to stand while it is doubtful. If its states show that it brakes,
    the clock has become slower, as that of a simulation on a busy machine. A robot whose states
    are late is shown to drive on. Once the robot stands, neither can harm, and `delay` restarts.

    `longest` is the greatest delay in s, at least 0.3: less than the time in which a base obeys
    does not show in its states.
    """

    def __init__(self, robot: Robot, longest: float, delay: Delay) -> None:
        self._robot = robot
        self._longest = max(longest, _REACTION + _MESSAGE)
        self._delay = delay
        self._since: World | None = None
        self.greatest = 0.0
        """The greatest delay in s since it was last in time."""

    @property
    def seconds(self) -> float:
        """The delay of the newest state in s."""
        return self._delay.seconds

    @property
    def is_doubtful(self) -> bool:
        """Whether the last states were delayed while the robot was to stand."""
        return self._since is not None

    def judge(self, world: World) -> Timeliness:
        """Process a state."""
        delay = self._delay.seconds
        if delay <= self._longest:
            return self._in_time()
        self.greatest = max(self.greatest, delay)
        if world.robot.is_standing:
            self._delay.restart()
            return self._in_time()
        since = self._since = self._since or world
        elapsed = world.time - since.time
        if elapsed < _REACTION + self._robot.lag:
            return Timeliness.DOUBTFUL
        brakes = max(
            (abs(getattr(since.robot, axis.name)) - abs(getattr(world.robot, axis.name)))
            / axis.stop
            for axis in self._robot.axes
        )
        return Timeliness.DOUBTFUL if brakes >= _LEAST_LOSS * elapsed else Timeliness.LATE

    def _in_time(self) -> Timeliness:
        self._since = None
        self.greatest = 0.0
        return Timeliness.IN_TIME


class ObjectWatch:
    """Detects objects that are seen where they cannot be.

    An object cannot be inside the robot's body. A described object has a size; other ones may be
    marks on the floor, unless the robot drives to them and they move along with it. Nor can an
    object to which the robot drives keep its place beside the robot while the robot speeds up,
    brakes or turns: then its detector sees a part of the robot. The robot may push an object at
    its front, but cannot pull it backward, nor turn with it unless its holder holds it.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._inside: dict[str, World] = {}  # the first of the states in which an object is inside
        self._fixed: _FixedObject | None = None
        self._last = -math.inf  # s; time of the last state

    def fault(self, world: World, top: Top) -> str | None:
        """Process a state; return which object of `top` cannot be where it is seen, or None."""
        if world.time - self._last > _LONGEST_GAP:
            self._inside = {}
            self._fixed = None
        self._last = world.time
        return self._overlap(world, top) or self._companion(world, followed(top))

    def _overlap(self, world: World, top: Top) -> str | None:
        """Return which object is inside the robot, or None."""
        robot = self._robot
        inside = {name for name in objects_in(top) if self._is_inside(world, name)}
        self._inside = {name: self._inside.get(name, world) for name in sorted(inside)}
        for name, first in self._inside.items():
            stays = world.time - first.time >= _PERSISTS
            moved = world.robot.pose.distance(first.robot.pose)
            moves_along = name == followed(top) and moved > robot.front + robot.rear
            if stays and (robot.scene.radius(name) > 0.0 or moves_along):
                return (
                    f"the {name} cannot be at the robot: expected it outside the robot's body, "
                    f"got it {_place(world, name)}; check what detects it"
                )
        return None

    def _companion(self, world: World, name: str | None) -> str | None:
        """Return that the followed object moves with the robot, without being pushed, or None."""
        if name is None or name not in world.objects:
            self._fixed = None
            return None
        fixed = self._fixed
        if fixed is None or not fixed.continues(world, name):
            self._fixed = _FixedObject(world, name)
            return None
        if is_at_front(world, self._robot, name):
            is_pulled = fixed.is_pulled
            is_turned = fixed.turns_with(self._robot) and not is_held(world, self._robot, name)
            moves_with = is_pulled or is_turned
        else:
            moves_with = fixed.moves_with(self._robot)
        if not moves_with:
            return None
        return (
            f"the {name} moves with the robot: expected another place beside it after it drove "
            f"{fixed.driven:.1f} m, got the same {_place(world, name)}; its detector may see a "
            "part of the robot"
        )

    def _is_inside(self, world: World, name: str) -> bool:
        """Return whether an object overlaps with the robot's body by more than an error."""
        if name not in world.objects:
            return False
        robot = self._robot
        there = _relative(world, name)
        off = math.hypot(
            max(-robot.rear - there.x, 0.0, there.x - robot.front),
            max(abs(there.y) - robot.half_width, 0.0),
        )
        return off < robot.scene.radius(name) - _OVERLAP or off == 0.0


class _FixedObject:
    """An object that has been at one place in the robot's frame since `first`."""

    def __init__(self, first: World, name: str) -> None:
        self.driven = 0.0  # m
        self._name = name
        self._place = _relative(first, name)
        self._last = first
        self._turned = 0.0  # rad
        self._slowest = self._fastest = first.robot.vx  # m/s
        self._ahead = self._farthest = 0.0  # m driven forward, and the most so far
        self._pulled = 0  # states in a row

    def continues(self, world: World, name: str) -> bool:
        """Process the next state; return whether the object `name` is still at that place."""
        robot = world.robot
        before = self._last.robot
        self._last = world
        self.driven += before.pose.distance(robot.pose)
        step = before.pose.relative(robot.pose)
        self._turned += step.yaw
        self._ahead += step.x
        self._farthest = max(self._farthest, self._ahead)
        self._slowest = min(self._slowest, robot.vx)
        self._fastest = max(self._fastest, robot.vx)
        off = self._place.distance(_relative(world, name))
        backward = self._farthest - self._ahead
        pulled = backward >= _BACKWARD and off <= _FOLLOWED * backward
        self._pulled = self._pulled + 1 if pulled else 0
        return name == self._name and off <= _FIXED + _FIXED_TIME * abs(robot.vx)

    def moves_with(self, robot: Robot) -> bool:
        """Return whether the robot has moved so that no other object could have kept its place."""
        changes = self._fastest - self._slowest >= _SPEED_CHANGE * robot.greatest_speed()
        return self.turns_with(robot) or (changes and self._is_far(robot))

    def turns_with(self, robot: Robot) -> bool:
        """Return whether the robot has turned, so that nothing that it does not hold has."""
        return abs(self._turned) >= _TURN and self._is_far(robot)

    @property
    def is_pulled(self) -> bool:
        """Whether the object has followed the robot backward, as nothing at its front does."""
        return self._pulled >= _PULLED

    def _is_far(self, robot: Robot) -> bool:
        return self.driven >= _DRIVEN * (robot.front + robot.rear)


def _place(world: World, name: str) -> str:
    there = _relative(world, name)
    return f"{there.x:.2f} m ahead of the middle of the axle and {there.y:.2f} m to the left"


def _relative(world: World, name: str) -> Pose:
    """Return the place of an object in the robot's frame."""
    pose = world.robot.pose
    there = world.objects[name]
    return pose.relative(pose._replace(x=there.x, y=there.y))
