"""The goals of action servers in recordings: when each was executed, how it ended, and its pose.

Status messages name goals by id. Their only stamp is that of a goal's acceptance, so they get the
stamp of the last odometry message. The latched status topic also names goals that ended before the
recording began.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.actions.remote import status_name
from ator_ros.experience.records import Vocabulary
from ator_ros.geometry import Pose
from ator_ros.printable import quoted
from ator_ros.world.readers import MessageError, plain_frame, pose_from, seconds_from

PLAN = "plan"
"""Role of the topic of the path to a goal (nav_msgs/Path)."""
GOAL_POSE = "goal_pose"
"""Role of the topic of a goal as RViz publishes it before it is sent (PoseStamped)."""
STATUS_SUFFIX = "/_action/status"
"""Of the topic on which the server of an action publishes the status of its goals."""
NOT_CONNECTED = "tf does not connect odometry's frame with the goal's"
_MOST_GOALS = 10_000  # of a recording: a week of drives of one minute
_LONGEST_FRAME = 256  # characters of a frame's name
_RECENT = 1.0  # s by which a goal_pose may precede its goal, and a goal the first status message
_ENDED = ("succeeded", "canceled", "aborted")


def status_topics(domain: Vocabulary) -> dict[str, str]:
    """Return the remote actions of a domain by the status topics of their servers."""
    specs = [spec for specs in domain.action_sets.values() for spec in specs if spec.remote]
    return {f"{spec.remote.server}{STATUS_SUFFIX}": spec.name for spec in specs if spec.remote}


@dataclass
class ServerGoal:
    """A goal of an action server.

    Attributes
    ----------
    action : str
        The remote action of the domain.
    segment : int
        Index of the segment of odometry in which its execution began.
    begin, end : float
        When its execution began and ended, in s by odometry's stamps; NaN: not recorded.
    status : str
        How it ended; empty: not recorded.
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
    from_goal_pose : bool
        Whether the pose is that of a goal_pose, which no plan replaces.
    """

    action: str
    segment: int = 0
    begin: float = math.nan
    end: float = math.nan
    status: str = ""
    frame: str = ""
    pose: Pose | None = None
    odom_pose: Pose | None = None
    final_pose: Pose | None = None
    before_recording: bool = False
    preempted: bool = False
    from_goal_pose: bool = False

    @property
    def is_active(self) -> bool:
        """Whether its execution has begun and not ended."""
        return not (math.isnan(self.begin) or self.status)

    def set_pose(
        self, frame: str, pose: Pose, odom_pose: Pose | None, *, from_goal_pose: bool
    ) -> None:
        """Set the pose of the goal: a later plan replaces an earlier one, but no goal_pose."""
        if from_goal_pose or not self.from_goal_pose:
            if frame != self.frame or self.odom_pose is None:
                self.odom_pose = odom_pose
            self.frame = frame
            self.pose = pose
            self.from_goal_pose = from_goal_pose

    def rejection(self) -> str:
        """Return why the goal is no episode; empty if it is one."""
        reasons = {
            "accepted before the recording began": self.before_recording,
            "its end was not recorded": not self.status,
            "canceled": self.status == "canceled",
            "preempted by another goal": self.preempted and self.status == "aborted",
            "its start was not recorded": math.isnan(self.begin),
            "odometry was interrupted": not self.begin <= self.end,
            f"no {PLAN} or {GOAL_POSE} was recorded with it": self.pose is None,
            NOT_CONNECTED: self.odom_pose is None,
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
        self._goal_pose: tuple[float, str, Pose] | None = None
        """Time of the last goal_pose, its frame and pose."""

    def add_status(self, action: str, message: Any, segment: int, now: float, robot: Pose) -> None:
        """Add an action_msgs/GoalStatusArray at `now` (s by odometry).

        `robot` is in odometry's frame.
        """
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
                self.goals[key] = ServerGoal(action, before_recording=is_first and is_old)
            goal = self.goals[key]
            if status == "executing" and math.isnan(goal.begin):
                goal.segment = segment
                goal.begin = now
                if self._goal_pose is not None and abs(now - self._goal_pose[0]) <= _RECENT:
                    _, frame, pose = self._goal_pose
                    goal.set_pose(frame, pose, self._odom_pose_in(frame), from_goal_pose=True)
            elif status in _ENDED and not goal.status:
                goal.status = status
                goal.end = now if segment == goal.segment else math.nan
                odom_pose = self._odom_pose_in(goal.frame)
                goal.final_pose = odom_pose.compose(robot) if odom_pose else None

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
            for goal in filter(lambda goal: goal.is_active, self.goals.values()):
                goal.set_pose(frame, pose, self._odom_pose_in(frame), from_goal_pose=False)
