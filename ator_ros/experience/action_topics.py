"""Goals that action servers executed, from the servers' own topics in a recording.

Requests and answers are in the service events of an action (``NAME/_action/send_goal/_service_event`` and
``NAME/_action/get_result/_service_event``, of servers or clients with introspection); when a goal was
accepted and when it ended is in ``NAME/_action/status`` too.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GOAL_VARIABLES
from ator_ros.actions.remote import RemoteCall, failure_in, status_name, value_at
from ator_ros.actions.situation import Situation
from ator_ros.experience.episode import Episode
from ator_ros.experience.records import fault_of
from ator_ros.experience.streams import Track
from ator_ros.experience.vocabulary import Vocabulary
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.printable import printable
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.outcome import failure, shortfall, unmet
from ator_ros.world.messages import plain_frame, pose_from
from ator_ros.world.state import World

_ASKED, _RESULT, _STATUS = "send_goal/_service_event", "get_result/_service_event", "status"
_FINAL = ("succeeded", "canceled", "aborted")


@dataclass
class _Execution:
    """One goal of a server; times in s of odometry."""

    stretch: int = -1
    goal: Any = None
    begun: float = math.nan
    ended: float = math.nan
    status: int = 0
    result: Any = None


class ActionTopics:
    """Collects one robot's goals from the topics of a domain's action servers.

    Parameters
    ----------
    domain : Vocabulary
        Its remote actions.
    """

    def __init__(self, domain: Vocabulary) -> None:
        self._domain = domain
        self._executions: dict[tuple[str, bytes], _Execution] = defaultdict(_Execution)
        self._pending: dict[tuple[str, str, bytes, int], bytes] = {}
        self._taken: Counter[str] = Counter()
        self._left_out: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}

    @property
    def left_out(self) -> int:
        """Number of goals that cannot be used."""
        return self._left_out.total()

    def left_out_lines(self) -> list[str]:
        """Return a line for each server of whose goals some were left out, with the first reason."""
        return [
            f"left out {count} of {self._taken[server]} goals of {server}: {self._reasons[server]}"
            for server, count in self._left_out.items()
        ]

    def take(self, topic: str, message: Any, now: float, stretch: int) -> None:
        """Take a message of one of `topics_of`, which came at `now` s of odometry in a numbered stretch."""
        server, _, part = topic.partition("/_action/")
        if part == _STATUS:
            for item in message.status_list:
                self._take_status(server, bytes(item.goal_info.goal_id.uuid), item.status, now, stretch)
            return
        key = server, part, bytes(message.info.client_gid), int(message.info.sequence_number)
        for request in message.request:
            self._pending[key] = uuid = bytes(request.goal_id.uuid)
            if part == _ASKED:
                self._executions[server, uuid].goal = request.goal
        asked = self._pending.get(key)
        if asked is None:  # it was sent before the recording began
            return
        for answer in message.response:
            if part == _ASKED and answer.accepted:
                self._take_status(server, asked, 1, now, stretch)
            elif part == _RESULT:
                self._take_status(server, asked, answer.status, now, stretch)
                self._executions[server, asked].result = answer.result

    def _take_status(self, server: str, uuid: bytes, status: int, now: float, stretch: int) -> None:
        execution = self._executions[server, uuid]
        if math.isnan(execution.begun) and status_name(status) in ("accepted", "executing"):
            execution.begun, execution.stretch = now, stretch
        if math.isnan(execution.ended) and status_name(status) in _FINAL:
            # Of another stretch: odometry ceased, or its clock was reset, while it drove.
            execution.ended, execution.status = (now if execution.stretch == stretch else -math.inf), status

    def episodes(self, tracks: Sequence[Track | None], robot: Robot, frame: str) -> Iterator[Episode]:
        """Yield the goals that began and ended; those that cannot be used are counted as left out.

        Parameters
        ----------
        tracks : sequence of Track or None
            The stretches by their numbers; None: one without odometry.
        robot : Robot
            The robot that was recorded.
        frame : str
            Of its odometry.
        """
        for (server, _), execution in self._executions.items():
            track = tracks[execution.stretch] if execution.stretch >= 0 else None
            if execution.goal is None or math.isnan(execution.begun) or math.isnan(execution.ended):
                continue  # it began before the recording did, or ended after it
            self._taken[server] += 1
            found = self._read(server, execution, track, robot, frame)
            if isinstance(found, Episode):
                yield found
            else:
                self._left_out[server] += 1
                self._reasons.setdefault(server, printable(found, 200))

    def _read(
        self, server: str, execution: _Execution, track: Track | None, robot: Robot, frame: str
    ) -> Episode | str:
        """Return the episode, or why it is left out."""
        if track is None or execution.ended <= execution.begun:
            return "expected odometry from its start to its end, got a gap or a reset"
        try:
            return self._episode(server, execution, track, robot, frame)
        except (AttributeError, TypeError, ValueError) as error:  # another type of action than declared
            return f"expected goal and result as the domain declares: {error}"

    def _episode(
        self, server: str, execution: _Execution, track: Track, robot: Robot, frame: str
    ) -> Episode | str:
        """Return the episode, or why it is left out."""
        action, call = self._action_of(server, execution.goal)
        top = next((top for top in self._domain.tops_for(robot) if top.action == action), None)
        if call is None or top is None:
            return "expected the constants of an action that the domain declares"
        if not _told(call, execution):
            return f"expected its end and its result, got {status_name(execution.status)}"
        if (given := plain_frame(_frame_of(call, execution.goal))) not in ("", frame):
            return f"goal: expected a pose in frame {frame}, got {given}"
        episode = _episode(top, call, execution, track, robot)
        return fault_of(episode, top, robot) or episode

    def _action_of(self, server: str, goal: Any) -> tuple[str, RemoteCall | None]:
        """Return the action of a server whose constants a goal has: several may share one server."""
        for action, call in self._domain.remote_calls.items():
            constants = [filling for filling in call.goal if filling.constant is not None]
            if call.server.strip("/") == server and all(
                value_at(goal, filling.field) == filling.constant for filling in constants
            ):
                return action, call
        return "", None


def topics_of(domain: Vocabulary) -> dict[str, set[str]]:
    """Return the topics of the domain's action servers, without a namespace, with their types."""
    topics: dict[str, set[str]] = defaultdict(set)
    for call in domain.remote_calls.values():
        events = f"{call.server.strip('/')}/_action/"
        topics[events + _ASKED].add(f"{call.type}_SendGoal_Event")
        topics[events + _RESULT].add(f"{call.type}_GetResult_Event")
        topics[events + _STATUS].add("action_msgs/msg/GoalStatusArray")
    return dict(topics)


def _told(call: RemoteCall, execution: _Execution) -> bool:
    """Return whether it is known how a goal ended, other than by a cancellation."""
    known = execution.result is not None or not call.success.fields
    ended = status_name(execution.status)
    return known and (ended != "canceled" or ended in call.success.status)


def _frame_of(call: RemoteCall, goal: Any) -> str:
    """Return the frame of a goal's pose; empty where it tells none."""
    poses = [value_at(goal, filling.field) for filling in call.goal if filling.source == "goal"]
    return next((str(pose.header.frame_id) for pose in poses if hasattr(pose, "header")), "")


def _episode(top: Top, call: RemoteCall, execution: _Execution, track: Track, robot: Robot) -> Episode:
    begin, end = execution.begun, min(execution.ended, track.end)
    start, last = track.world(begin), track.world(end)
    goal = _goal_of(call, execution.goal, top.point, last.robot.pose)
    reason = failure_in(call, execution.status, execution.result)
    if reason is None and (lacks := unmet(top, last, goal, robot)):
        reason = failure(top, lacks)
    error, heading_error = _errors(top, goal, last, robot)
    return Episode(
        situation=Situation(top.action, start.robot, start.objects, goal),
        samples=track.samples(begin, end),
        duration=round(end - begin, 6),
        success=reason is None,
        reason=reason or f"{call.server} succeeded",
        position_error=error,
        heading_error=heading_error,
        objects=track.names,
    )


def _goal_of(call: RemoteCall, message: Any, point: Point, rest: Pose) -> Goal:
    """Return the goal that a message was filled with; what it lacks is where the robot came to rest."""
    values: dict[str, float] = {"x": rest.x, "y": rest.y, "yaw": rest.yaw, "speed": 0.0}
    for filling in call.goal:
        value = value_at(message, filling.field)
        if filling.source == "goal":
            pose = pose_from(getattr(value, "pose", value), "goal")
            values |= {"x": pose.x, "y": pose.y, "yaw": pose.yaw}
        elif filling.goal_variable is not None:
            values[filling.goal_variable] = float(value)
    pose = Pose(values["x"], values["y"], values["yaw"])
    own = {name: value for name, value in values.items() if name not in GOAL_VARIABLES}
    return Goal(pose, values["speed"], point, own)


def _errors(top: Top, goal: Goal, last: World, robot: Robot) -> tuple[float, float]:
    """Return the errors at the end as `Episode` has them."""
    if not top.arrives:
        return shortfall(top, last, goal, robot), math.nan
    pose, wanted = last.robot.pose, goal.robot_pose(robot)
    return pose.distance(wanted), abs(wrap_angle(pose.yaw - wanted.yaw))
