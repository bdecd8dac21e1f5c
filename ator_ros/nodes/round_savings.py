"""Computes, while an action server is idle, what the rounds that it drove would have saved."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from threading import Thread
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node

from ator_ros.experience.watched_paths import WatchedPaths
from ator_ros.geometry import Pose
from ator_ros.learning.savings import Round, RoundSavings, missing_legs, savings_of
from ator_ros.nodes.path_planner import PLANNER_TYPE, path_from, planner_goal
from ator_ros.nodes.qos import ACTION_QUEUES
from ator_ros.nodes.remote_messages import action_type
from ator_ros.nodes.server_statuses import ServerStatuses
from ator_ros.refinement import RefinementError
from ator_ros.refinement.chain_prediction import PredictsPerformance
from ator_ros.tops.library import TopLibrary

_PERIOD = 1.0  # real s between two requests to the planner
_QUIET = 2.0  # real s without a goal after which the server counts as idle
_MOST_WAITING = 20  # rounds that wait for the server to be idle
_MOST_FAILURES = 5  # requests without a path or an answer after which another order stays unknown
_ANSWER = 5.0  # real s that an answer of the planner may take


class RoundSavingsQueue:
    """Rounds that wait for the paths of their legs, and are then compared in a thread.

    Paths that no drive has shown are asked of the planner, at most one a second, and only while
    neither the server nor the planner executes a goal. A request that is refused or interrupted is
    repeated.

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
        self._planner = planner
        self._client: ActionClient | None = None
        self._statuses = ServerStatuses(node, [planner] if planner else [])
        if planner:
            self._client = ActionClient(node, action_type(PLANNER_TYPE), planner, **ACTION_QUEUES)
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
        if missing and self._client is not None and self._failures < _MOST_FAILURES:
            self._ask(self._client, missing[self._failures % len(missing)], now)
            return None
        compare = partial(
            savings_of,
            self._waiting[0],
            library,
            models,
            may_pass=may_pass,
            knows_all=not missing,
            deadline=lambda: self._is_busy,
        )
        self._thread = Thread(target=self._compare, args=(compare,), daemon=True)
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

    def _compare(self, compare: Callable[[], RoundSavings]) -> None:
        """Compare a round; a goal that begins meanwhile has priority."""
        savings = compare()
        self._found = None if self._is_busy else savings

    def _ask(self, client: ActionClient, leg: tuple[Pose, Pose], now: float) -> None:
        """Ask the planner for the path of a leg, unless an answer is due."""
        if now - self._asked_at < (_PERIOD if self._asked is None else _ANSWER):
            return
        if self._asked is None and self._statuses.busy():
            return
        self._asked_at = now
        if self._asked is not None or not client.server_is_ready():
            self._fail()
            return
        self._asked = leg
        request = planner_goal(self._frame, *leg)
        client.send_goal_async(request).add_done_callback(partial(self._accepted, leg))

    def _accepted(self, leg: tuple[Pose, Pose], future: Any) -> None:
        handle = future.result()
        if handle is not None and handle.accepted:
            handle.get_result_async().add_done_callback(partial(self._take, leg))
        else:
            self._asked = None  # it is asked again

    def _take(self, leg: tuple[Pose, Pose], future: Any) -> None:
        """Take the path of the leg that was asked for."""
        answer = future.result()
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            if answer.result.error_code:
                self._fail()
            else:  # another client has interrupted the request: it is repeated
                self._asked = None
            return
        start, goal = (pose[:2] for pose in leg)
        try:
            path = path_from(answer.result.path, start, goal, name=self._planner, frame=self._frame)
        except RefinementError:
            self._fail()
            return
        self._asked = None
        self._paths.add(start, goal, path)

    def _fail(self) -> None:
        self._asked = None
        self._failures += 1
