"""Goals in recordings of action servers: when each was executed, how it ended, and its pose.

Status messages name goals by id, and have no stamp but that of a goal's acceptance; they get the stamp of the
last odometry message. The latched status topic also names goals from before the recording began.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.actions.remote import status_name
from ator_ros.experience.records import Vocabulary
from ator_ros.geometry import Pose
from ator_ros.world.messages import MessageError, plain_frame, pose_from, seconds_from

PLAN, GOAL_POSE = "plan", "goal_pose"
"""Roles of topics: the path to a goal (nav_msgs/Path), and a goal as RViz publishes it before it is sent."""
_RECENT = 1.0  # s by which a goal_pose may precede its goal, and a goal the first status message
_ENDED = ("succeeded", "canceled", "aborted")


def status_topics(domain: Vocabulary) -> dict[str, str]:
    """Return the remote actions of a domain by the status topics of their servers."""
    specs = [spec for specs in domain.action_sets.values() for spec in specs if spec.remote]
    return {f"{spec.remote.server}/_action/status": spec.name for spec in specs if spec.remote}


@dataclass
class ServerGoal:
    """A goal of an action server.

    Attributes
    ----------
    action : str
        The remote action of the domain.
    segment : int
        Number of the segment of odometry in which it began.
    begin, end : float
        s by odometry's stamps; NaN: unknown.
    status : str
        How it ended; empty: not recorded.
    frame, pose : str, Pose or None
        The goal's pose in a frame; None: not recorded.
    base, reached : Pose or None
        In that frame: odometry's frame when the first pose came, and the robot at the end; None: unknown.
    early, preempted, exact : bool
        Whether it is older than the recording, whether another goal came before its end, and whether its
        pose is that of a goal_pose.
    """

    action: str
    segment: int = 0
    begin: float = math.nan
    end: float = math.nan
    status: str = ""
    frame: str = ""
    pose: Pose | None = None
    base: Pose | None = None
    reached: Pose | None = None
    early: bool = False
    preempted: bool = False
    exact: bool = False

    @property
    def is_active(self) -> bool:
        """Whether its execution has begun and not ended."""
        return not (math.isnan(self.begin) or self.status)

    def take_pose(self, frame: str, pose: Pose, base: Pose | None, *, exact: bool) -> None:
        """Take a pose: a later plan replaces an earlier one, and none replaces an `exact` pose."""
        if exact or not self.exact:
            self.base = self.base if frame == self.frame and self.base else base
            self.frame, self.pose, self.exact = frame, pose, exact

    def fault(self) -> str:
        """Return why it is no experience; an empty text if it is."""
        faults = {
            "accepted before the recording began": self.early,
            "its end was not recorded": not self.status,
            "canceled": self.status == "canceled",
            "preempted by another goal": self.preempted and self.status == "aborted",
            "its start was not recorded": math.isnan(self.begin),
            "odometry was interrupted": not self.begin <= self.end,
            f"no {PLAN} or {GOAL_POSE} was recorded with it": self.pose is None,
            f"tf does not connect odometry's frame with {self.frame}": self.base is None,
        }
        return next((reason for reason, holds in faults.items() if holds), "")


class ServerGoals:
    """Collects the goals of action servers in the order of arrival.

    Parameters
    ----------
    base : callable
        Returns the pose of odometry's frame in another frame; None if tf does not connect them.

    Attributes
    ----------
    goals : mapping
        All goals by action and id.
    """

    def __init__(self, base: Callable[[str], Pose | None]) -> None:
        self._base = base
        self.goals: dict[tuple[str, bytes], ServerGoal] = {}
        self._given: tuple[float, str, Pose] | None = None
        """Time of the last goal_pose, its frame and pose."""

    def take_status(self, action: str, message: Any, segment: int, now: float, robot: Pose) -> None:
        """Take an action_msgs/GoalStatusArray at `now` (s by odometry); `robot` is in odometry's frame."""
        is_first = not any(known == action for known, _ in self.goals)
        for item in sorted(message.status_list, key=lambda item: -item.status):  # those that ended first
            status, key = status_name(item.status), (action, bytes(item.goal_info.goal_id.uuid))
            if key not in self.goals:
                for other in self.goals.values():
                    other.preempted |= other.is_active and other.action == action
                late = now - seconds_from(item.goal_info.stamp) > _RECENT
                self.goals[key] = ServerGoal(action, early=is_first and (late or status in _ENDED))
            goal = self.goals[key]
            if status == "executing" and math.isnan(goal.begin):
                goal.segment, goal.begin = segment, now
                if self._given is not None and abs(now - self._given[0]) <= _RECENT:
                    _, frame, pose = self._given
                    goal.take_pose(frame, pose, self._base(frame), exact=True)
            elif status in _ENDED and not goal.status:
                goal.status, goal.end = status, now if segment == goal.segment else math.nan
                base = self._base(goal.frame)
                goal.reached = base.compose(robot) if base else None

    def take_goal(self, message: Any, now: float) -> None:
        """Take the path to the active goal, or the pose of the goal that is sent next (PoseStamped)."""
        frame = plain_frame(message.header.frame_id)
        if hasattr(message, "pose"):
            self._given = now, frame, pose_from(message.pose, GOAL_POSE)
        elif not message.poses:
            raise MessageError(f"{PLAN}.poses: expected at least one, got none")
        else:
            pose = pose_from(message.poses[-1].pose, f"{PLAN}.poses[-1]")
            for goal in filter(lambda goal: goal.is_active, self.goals.values()):
                goal.take_pose(frame, pose, self._base(frame), exact=False)
