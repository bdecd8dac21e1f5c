"""The goals of action servers, by what these publish: when each was executed, how, and its pose.

Status messages name goals by id. Their only stamp is that of a goal's acceptance, so they get the
stamp of the last odometry message. The latched status topic also names goals that ended before the
first message.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ator_ros.actions.remote import RemoteCall, status_name
from ator_ros.experience.records import Vocabulary
from ator_ros.experience.track import Segment
from ator_ros.geometry import FloatArray, Pose
from ator_ros.printable import quoted
from ator_ros.world.readers import MessageError, plain_frame, pose_from, seconds_from
from ator_ros.world.state import RobotState

PLAN = "plan"
"""Role of the topic of the path to a goal (nav_msgs/Path)."""
GOAL_POSE = "goal_pose"
"""Role of the topic of a goal as RViz publishes it before it is sent (PoseStamped)."""
STATUS_SUFFIX = "/_action/status"
"""Of the topic on which the server of an action publishes the status of its goals."""
FEEDBACK_SUFFIX = "/_action/feedback"
"""Of the topic on which the server of an action publishes feedback."""
NOT_CONNECTED = "tf does not connect odometry's frame with the goal's"
_MOST_GOALS = 10_000  # of a recording: a week of drives of one minute
_LONGEST_FRAME = 256  # characters of a frame's name
_MOST_PLACES = 100_000  # of a path: 2.5 km in steps of 2.5 cm
_MOST_ESTIMATES = 1000  # of the server for a goal: 8 min
_ESTIMATE_PERIOD = 0.5  # s; Nav2 sends feedback in each loop of its tree, every 10 ms
_SAME_PLACE = 0.01  # m
_MOVED = 0.5  # m by which a goal may move between two paths, as that of a tree that follows
_EARLY = 0.5  # s by which a path may come before the message that its goal is executed
_RECENT = 1.0  # s by which a goal_pose may precede its goal, and a goal the first status message
_ENDED = ("succeeded", "canceled", "aborted")
LOST = "lost"
"""Status of a goal whose server has ended or restarted while it was executed."""


def remote_calls(domain: Vocabulary) -> dict[str, RemoteCall]:
    """Return the servers of the remote actions of a domain, by the names of the actions."""
    specs = [spec for specs in domain.action_sets.values() for spec in specs]
    return {spec.name: spec.remote for spec in specs if spec.remote}


_THROUGH = "nav2_msgs/action/NavigateThroughPoses"


def through_servers(domain: Vocabulary) -> dict[str, tuple[str, str]]:
    """Return the action of the legs and the type of each server that drives through poses.

    They are those that actions declare as `through`. Nav2 has one beside the server of an action
    that passes its goals `early`.
    """
    found = {}
    for action, call in remote_calls(domain).items():
        if call.through is not None:
            found[call.through.server] = action, call.through.type
        elif call.early and call.type == "nav2_msgs/action/NavigateToPose":
            namespace = call.server.rpartition("/")
            found["".join((*namespace[:2], "navigate_through_poses"))] = action, _THROUGH
    return found


def usual_values(domain: Vocabulary, action: str) -> dict[str, float]:
    """Return usual values of the goal variables that an action declares; it stops at goals."""
    specs = [spec for specs in domain.action_sets.values() for spec in specs]
    declared = (spec.goal_variables for spec in specs if spec.name == action)
    return {variable.name: variable.usual for variable in next(declared, ())}


@dataclass(eq=False)
class ServerGoal:
    """A goal of an action server.

    Attributes
    ----------
    action : str
        The remote action of the domain.
    goal_id : bytes
        The UUID of the goal.
    segment : Segment or None
        The odometry in which its execution began; None: it did not begin.
    begin, end : float
        When its execution began and ended, in s by odometry's stamps; NaN: not recorded.
    status : str
        How it ended, perhaps `LOST`; empty: not recorded.
    start : RobotState or None
        The robot in odometry's frame when its execution began.
    frame, pose : str, Pose or None
        The goal's pose, and the frame that it is in; None: not recorded.
    odom_pose : Pose or None
        Odometry's frame in `frame` when the first pose in that frame was recorded; None: tf does
        not connect them.
    final_pose : Pose or None
        The robot in `frame` at the end.
    before_recording : bool
        Whether the server accepted it before the recording began.
    preempted : bool
        Whether the server accepted another goal before this one ended.
    is_passed : bool
        Whether the other one was accepted within the tolerance of this one's pose, so that the
        robot has passed it. Set by `Watch`.
    nearest : float
        How near in m the robot has passed it; infinite: unknown.
    from_goal_pose : bool
        Whether the pose is that of a goal_pose, which no plan replaces.
    first_path, path : ndarray of shape (n, 2), or None
        The first and the newest path to the goal, in m in `frame`; None: none was recorded.
    first_headings : ndarray of shape (n,), or None
        Those of the first path, in rad.
    poses : int
        How many poses the goal has, as its server's feedback says; 0 without that.
    recoveries : int
        How often the server has recovered, as its feedback says; 0 without feedback.
    server_estimates : list of float
        What the server estimated on the way that the drive takes in all, in s; at most two a
        second.
    """

    action: str
    goal_id: bytes = b""
    segment: Segment | None = None
    begin: float = math.nan
    end: float = math.nan
    status: str = ""
    start: RobotState | None = None
    frame: str = ""
    pose: Pose | None = None
    odom_pose: Pose | None = None
    final_pose: Pose | None = None
    before_recording: bool = False
    preempted: bool = False
    is_passed: bool = False
    nearest: float = math.inf
    from_goal_pose: bool = False
    first_path: FloatArray | None = None
    path: FloatArray | None = None
    first_headings: FloatArray | None = None
    poses: int = 0
    recoveries: int = 0
    server_estimates: list[float] = field(default_factory=list)
    _estimated_at: float = field(default=-math.inf, init=False)
    _plan_end: Pose | None = field(default=None, init=False)  # of the last path that was accepted
    _last_end: Pose | None = field(default=None, init=False)  # of the last path
    _is_confirmed: bool = field(default=False, init=False)  # whether two paths in a row led there

    @property
    def is_active(self) -> bool:
        """Whether its execution has begun and not ended."""
        return not (math.isnan(self.begin) or self.status)

    @property
    def start_in_frame(self) -> RobotState | None:
        """The robot in `frame` when the execution began; None if it is unknown."""
        if self.start is None or self.odom_pose is None:
            return None
        return replace(self.start, pose=self.odom_pose.compose(self.start.pose))

    def set_pose(
        self, frame: str, pose: Pose, odom_pose: Pose | None, *, from_goal_pose: bool
    ) -> None:
        """Set the pose of the goal: a later plan replaces an earlier one, but no goal_pose."""
        if from_goal_pose or not self.from_goal_pose:
            if self.pose is not None and self.pose.distance(pose) > _SAME_PLACE:
                self.first_path = None  # it led elsewhere
            if frame != self.frame or self.odom_pose is None:
                self.odom_pose = odom_pose
            self.frame = frame
            self.pose = pose
            self.from_goal_pose = from_goal_pose

    def accepts_plan(self, end: Pose) -> bool:
        """Return whether a path that ends there is the goal's, and not that of another request.

        Planners publish all paths that they are asked for. Once two paths in a row have led to the
        same place, a single one that leads elsewhere is ignored.
        """
        known = self._plan_end
        repeats = self._last_end is not None and self._last_end.distance(end) <= _MOVED
        self._last_end = end
        if known is not None and self._is_confirmed and known.distance(end) > _MOVED:
            if not repeats:
                return False
        else:
            self._is_confirmed = known is not None and known.distance(end) <= _MOVED
        self._plan_end = end
        return True

    def add_estimate(self, now: float, seconds: float) -> None:
        """Add that the server estimated at `now` that so many s remain."""
        is_due = now - self._estimated_at >= _ESTIMATE_PERIOD
        if is_due and len(self.server_estimates) < _MOST_ESTIMATES:
            self._estimated_at = now
            self.server_estimates.append(now - self.begin + seconds)

    def set_path(self, path: FloatArray, headings: FloatArray) -> None:
        """Set the newest path to the goal in the frame of the pose: (n, 2) in m, (n,) in rad."""
        self.path = path
        if self.first_path is None:
            self.first_path = path
            self.first_headings = headings

    @property
    def is_recovered(self) -> bool:
        """Whether it arrived after recoveries of its server, which take time of their own."""
        return self.status == "succeeded" and self.recoveries > 0

    @property
    def is_preempted(self) -> bool:
        """Whether another goal ended it."""
        return self.preempted and self.status == "aborted"

    def rejection(self) -> str:
        """Return why the goal is no episode; empty if it is one."""
        reasons = {
            "accepted before the recording began": self.before_recording,
            "its end was not recorded": not self.status,
            "canceled": self.status == "canceled",
            "its server ended or restarted": self.status == LOST,
            "preempted by another goal": self.is_preempted and not self.is_passed,
            "its start was not recorded": math.isnan(self.begin),
            "odometry was interrupted": not self.begin <= self.end,
            f"no {PLAN} or {GOAL_POSE} was recorded with it": self.pose is None,
            NOT_CONNECTED: self.odom_pose is None,
            "its server recovered on the way": self.is_recovered,
        }
        return next((reason for reason, holds in reasons.items() if holds), "")


class ServerGoals:
    """Collects the goals of action servers; messages are added in the order of arrival.

    `odom_pose_in` returns the pose of odometry's frame in another frame, or None if tf does not
    connect them. `goals` has all goals, by action and id.
    """

    def __init__(self, odom_pose_in: Callable[[str], Pose | None]) -> None:
        self._odom_pose_in = odom_pose_in
        self.goals: dict[tuple[str, bytes], ServerGoal] = {}
        self.numbers = 0
        """How many numbers of paths are kept in memory."""
        self._goal_pose: tuple[float, str, Pose] | None = None
        """Time of the last goal_pose, its frame and pose."""
        self._plan: tuple[float, Any] | None = None
        """Time of the last path that came while no goal was executed, and its message."""

    @property
    def active(self) -> list[ServerGoal]:
        """The goals that are executed, the oldest first."""
        return [goal for goal in self.goals.values() if goal.is_active]

    def add_status(
        self, action: str, message: Any, segment: Segment, now: float, robot: RobotState | None
    ) -> list[ServerGoal]:
        """Add an action_msgs/GoalStatusArray at `now` (s by odometry); return what ended with it.

        `robot` is in odometry's frame, None before its first message.
        """
        ended = []
        is_first = not any(known == action for known, _ in self.goals)
        # those that ended first
        for item in sorted(message.status_list, key=lambda item: -item.status):
            status = status_name(item.status)
            key = (action, bytes(item.goal_info.goal_id.uuid))
            if key not in self.goals:
                if len(self.goals) >= _MOST_GOALS:
                    raise MessageError(f"{action}: expected at most {_MOST_GOALS} goals, got more")
                for other in self.goals.values():
                    other.preempted |= other.is_active and other.action == action
                is_old = status in _ENDED or now - seconds_from(item.goal_info.stamp) > _RECENT
                before = is_first and is_old
                self.goals[key] = ServerGoal(action, key[1], before_recording=before)
            goal = self.goals[key]
            if status == "executing" and math.isnan(goal.begin):
                goal.segment = segment
                goal.begin = now
                goal.start = robot
                if self._goal_pose is not None and abs(now - self._goal_pose[0]) <= _RECENT:
                    _, frame, pose = self._goal_pose
                    goal.set_pose(frame, pose, self._odom_pose_in(frame), from_goal_pose=True)
                if self._plan is not None and 0.0 <= now - self._plan[0] <= _EARLY:
                    self.add_pose(self._plan[1], now)
                self._plan = None
            elif status in _ENDED and not goal.status:
                goal.status = status
                goal.end = now if segment is goal.segment else math.nan
                odom_pose = self._odom_pose_in(goal.frame)
                if odom_pose is not None and robot is not None:
                    goal.final_pose = odom_pose.compose(robot.pose)
                ended.append(goal)
        listed = {bytes(item.goal_info.goal_id.uuid) for item in message.status_list}
        return ended + self.lose(action, listed)

    def lose(self, action: str, kept: Collection[bytes] = ()) -> list[ServerGoal]:
        """End the active goals of an action that its server does not have any more; return them.

        `kept` are the ids of those that it has. A server always lists all active goals.
        """
        lost = [goal for goal in self.active if goal.action == action and goal.goal_id not in kept]
        for goal in lost:
            goal.status = LOST
        return lost

    def add_feedback(self, action: str, message: Any, now: float) -> None:
        """Add the feedback of a goal at `now` (s by odometry), as far as it is that of Nav2."""
        goal = self.goals.get((action, bytes(message.goal_id.uuid)))
        if goal is None or not goal.is_active:
            return
        goal.recoveries = max(
            goal.recoveries, int(getattr(message.feedback, "number_of_recoveries", 0))
        )
        goal.poses = max(goal.poses, int(getattr(message.feedback, "number_of_poses_remaining", 0)))
        remaining = getattr(message.feedback, "estimated_time_remaining", None)
        if remaining is not None:
            seconds = seconds_from(remaining, "feedback.estimated_time_remaining")
            if seconds > 0.0:  # Nav2's is 0 while the robot stands
                goal.add_estimate(now, seconds)

    def add_pose(self, message: Any, now: float) -> None:
        """Add the path to the active goal, or the pose of the goal that is sent next."""
        frame = plain_frame(message.header.frame_id)
        if len(frame) > _LONGEST_FRAME:
            raise MessageError(f"{PLAN}.header.frame_id: expected a frame, got {quoted(frame)}")
        if hasattr(message, "pose"):
            self._goal_pose = now, frame, pose_from(message.pose, GOAL_POSE)
        elif not message.poses:
            raise MessageError(f"{PLAN}.poses: expected at least one, got none")
        else:
            pose = pose_from(message.poses[-1].pose, f"{PLAN}.poses[-1]")
            path, headings = _path_from(message)
            if not self.active:
                self._plan = now, message
            for goal in self.active:
                if not goal.accepts_plan(pose):
                    continue
                goal.set_pose(frame, pose, self._odom_pose_in(frame), from_goal_pose=False)
                if frame == goal.frame:
                    self.numbers += 0 if goal.first_path is not None else path.size
                    goal.set_path(path, headings)

    def forget(self, kept: int, needed: Collection[ServerGoal]) -> None:
        """Forget the oldest goals that have ended, beyond the number `kept`.

        Of all but those that are still `needed`, only the name remains.
        """
        ended = [key for key, goal in self.goals.items() if not goal.is_active]
        for key in ended[: max(0, len(ended) - kept)]:
            del self.goals[key]
        self.numbers = 0
        for goal in self.goals.values():
            if goal.status and goal not in needed:
                goal.path = goal.first_path = goal.first_headings = goal.segment = None


def _path_from(message: Any) -> tuple[FloatArray, FloatArray]:
    """Return a nav_msgs/Path: places (n, 2) in m and headings (n,) in rad; raise MessageError."""
    if len(message.poses) > _MOST_PLACES:
        raise MessageError(
            f"{PLAN}.poses: expected at most {_MOST_PLACES}, got {len(message.poses)}"
        )
    rows = [
        (
            item.pose.position.x,
            item.pose.position.y,
            item.pose.orientation.z,
            item.pose.orientation.w,
        )
        for item in message.poses
    ]
    path = np.array(rows, dtype=float)
    if not np.isfinite(path).all():
        raise MessageError(f"{PLAN}.poses: expected finite numbers, got others")
    return path[:, :2], 2.0 * np.arctan2(path[:, 2], path[:, 3])
