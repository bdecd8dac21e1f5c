"""Computes, while an action server is idle, what the rounds that it drove would have saved."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Mapping
from threading import Thread
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from std_msgs.msg import Header

from ator_ros.experience.watched_paths import WatchedPaths
from ator_ros.geometry import Pose
from ator_ros.learning.savings import Round, RoundSavings, missing_legs, savings_of
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.path_planner import ENDS_WITHIN, PLANNER_TYPE
from ator_ros.nodes.qos import ACTION_QUEUES
from ator_ros.nodes.remote_messages import action_type
from ator_ros.refinement.chain_prediction import PredictsPerformance
from ator_ros.tops.library import TopLibrary

_SUCCEEDED = 4  # action_msgs/GoalStatus
_PERIOD = 1.0  # real s between two requests to the planner
_QUIET = 2.0  # real s without a goal after which the server counts as idle
_MOST_WAITING = 20  # rounds that wait for the server to be idle
_MOST_FAILURES = 5  # requests without a path after which another order stays unknown
_ANSWER = 5.0  # real s that an answer of the planner may take


class RoundSavingsQueue:
    """Rounds that wait for the paths of their legs, and are then compared in a thread.

    Paths that no drive has shown are asked of the planner, at most one a second, and only while no
    goal is executed. A request that is refused or interrupted is repeated.

    Parameters
    ----------
    planner : str
        The action, of type nav2_msgs/ComputePathToPose; empty: another order is unknown where
        paths are.
    frame : str
        Of the map.
    paths : WatchedPaths
        Receives the paths.
    """

    def __init__(self, node: Node, planner: str, frame: str, paths: WatchedPaths) -> None:
        self._frame = frame
        self._paths = paths
        self._kind = action_type(PLANNER_TYPE) if planner else None
        self._client = (
            ActionClient(node, self._kind, planner, **ACTION_QUEUES) if self._kind else None
        )
        self._waiting: deque[Round] = deque(maxlen=_MOST_WAITING)
        self._failures = 0  # of requests for the first round
        self._asked: tuple[Pose, Pose] | None = None
        self._asked_at = -math.inf  # real s
        self._busy_at = -math.inf  # real s at which a goal was executed last
        self._is_busy = False
        self._thread: Thread | None = None
        self._found: RoundSavings | None = None

    def add(self, found: Round) -> None:
        """Add a round that has ended."""
        self._waiting.append(found)

    def update(
        self,
        library: TopLibrary,
        models: Mapping[str, PredictsPerformance],
        *,
        is_busy: bool,
        may_pass: bool,
    ) -> RoundSavings | None:
        """Do what is due; call it twice a second. Return what a round would have saved, if known.

        `is_busy` is whether the server executes a goal.
        """
        now = time.monotonic()
        self._is_busy = is_busy
        if is_busy:
            self._busy_at = now
        if self._thread is not None:
            return self._result()
        if not self._waiting or not models or now - self._busy_at < _QUIET:
            return None
        missing = missing_legs(self._waiting[0], self._paths)
        may_ask = self._client is not None and self._failures < _MOST_FAILURES
        if missing and may_ask:
            self._ask(missing[self._failures % len(missing)], now)
            return None
        arguments = (self._waiting[0], library, models, may_pass, not missing)
        self._thread = Thread(target=self._compare, args=arguments, daemon=True)
        self._thread.start()
        return None

    def _result(self) -> RoundSavings | None:
        """Return what the thread has found, once it has ended uninterrupted."""
        if self._thread is None or self._thread.is_alive():
            return None
        self._thread = None
        found = self._found
        self._found = None
        if found is not None:
            self._waiting.popleft()
            self._failures = 0
        return found

    def _compare(
        self,
        found: Round,
        library: TopLibrary,
        models: Mapping[str, PredictsPerformance],
        may_pass: bool,
        knows_all: bool,
    ) -> None:
        """Compare a round; a goal that begins meanwhile has priority."""
        savings = savings_of(
            found,
            library,
            models,
            may_pass=may_pass,
            knows_all=knows_all,
            deadline=lambda: self._is_busy,
        )
        self._found = None if self._is_busy else savings

    def _ask(self, leg: tuple[Pose, Pose], now: float) -> None:
        """Ask the planner for the path of a leg, unless an answer is due."""
        is_due = self._asked is None or now - self._asked_at > _ANSWER
        if self._kind is None or self._client is None:
            return
        if not is_due or now - self._asked_at < _PERIOD:
            return
        self._asked_at = now
        if not self._client.server_is_ready():
            self._failures += 1
            return
        self._asked = leg
        ends = dict(zip(("start", "goal"), map(self._stamped, leg), strict=True))
        request = self._kind.Goal(use_start=True, **ends)
        self._client.send_goal_async(request).add_done_callback(self._accepted)

    def _stamped(self, pose: Pose) -> PoseStamped:
        return PoseStamped(header=Header(frame_id=self._frame), pose=pose_of(pose))

    def _accepted(self, future: Any) -> None:
        handle = future.result()
        if handle is None or not handle.accepted:
            self._asked = None
            self._failures += 1
            return
        handle.get_result_async().add_done_callback(self._take)

    def _take(self, future: Any) -> None:
        """Take the path of the leg that was asked for."""
        answer = future.result()
        leg = self._asked
        self._asked = None
        if leg is None or answer.status != _SUCCEEDED:
            self._failures += 1
            return
        poses = [item.pose.position for item in answer.result.path.poses]
        path = np.array([(place.x, place.y) for place in poses], dtype=float).reshape(-1, 2)
        start, goal = leg
        if len(path) < 2 or not np.isfinite(path).all():
            self._failures += 1
            return
        off = max(math.dist(path[0], start[:2]), math.dist(path[-1], goal[:2]))
        if off > ENDS_WITHIN:
            self._failures += 1
            return
        self._paths.add((start.x, start.y), (goal.x, goal.y), path)
