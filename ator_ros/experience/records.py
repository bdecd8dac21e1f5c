"""Convert the executor's records (ator_interfaces/msg/ActionPerformance) to episodes, and check them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.situation import Situation
from ator_ros.experience.columns import LARGEST, MOST_OBJECTS
from ator_ros.experience.episode import Episode, sample_width
from ator_ros.files import is_name
from ator_ros.printable import printable, quoted
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import held_first, held_last, objects_in
from ator_ros.world.messages import MessageError, ObjectSource, object_from, pose_from, velocity
from ator_ros.world.state import RobotState


class Vocabulary(Protocol):
    """Name, objects, TOPs and goal variables of a domain; `ator_ros.domains.domain.Domain` is one."""

    @property
    def name(self) -> str:
        """Name of the domain."""

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of its objects."""

    def source(self, name: str) -> ObjectSource:
        """Return where the state of an object comes from."""

    @property
    def tops(self) -> tuple[Top, ...]:
        """Its TOPs, for a usual robot."""

    def tops_for(self, robot: Robot) -> tuple[Top, ...]:
        """Return its TOPs with the tolerances and regions of a robot in its scene."""

    @property
    def goal_variables(self) -> Mapping[str, GoalVariable]:
        """The goal variables that its actions declare, by name."""


def point_of(domain: Vocabulary, top: str) -> Point:
    """Return the point that goals of a TOP are meant for; the axle if the domain has no such TOP."""
    return next((known.point for known in domain.tops if known.name == top), Point.AXLE)


def drive_between(domain: Vocabulary, first: str | None, last: str | None) -> Top | None:
    """Return the TOP that drives with one object held at the start and another, or the same, at the end.

    Parameters
    ----------
    domain : Vocabulary
        Whose TOPs.
    first, last : str or None
        The objects held at the start and at the end; None: none.

    Returns
    -------
    Top or None
        The first with these roles, else the first that drives and holds nothing; None without any.
    """
    driving = [top for top in domain.tops if top.arrives]
    roles = [(held_first(top), held_last(top)) for top in driving]
    for wanted in ((first, last), (None, None)):
        if wanted in roles:
            return driving[roles.index(wanted)]
    return None


SUCCEEDED, FAILED = 1, 2  # codes of ator_interfaces/msg/Outcome
ENDED = (SUCCEEDED, FAILED)
"""Outcomes of actions that ended by themselves."""
_LONGEST_DRIVE = 600.0
"""In s, twenty times the default action_timeout: a goal that is farther away is in another unit or frame."""
_SLACK = 0.5
"""In m, above the tolerances of arrival: a robot that is at its goal already arrives in no time."""
_FASTEST = 4.0
"""Times limits.v: a base described at half its real speed keeps its records, with a factor of 2 to spare."""


def episode_of(message: Any, domain: Vocabulary, robot: Robot) -> Episode:
    """Convert a record of any action to an episode; it has no samples but its start.

    An action that no TOP of the domain calls is accepted under its name.

    Raises
    ------
    MessageError
        A value cannot be used, the TOP does not call the action, or the robot cannot have driven so far.
    """
    top = _called_top(message, domain)
    start, call = message.start, message.call
    objects = {
        item.name: object_from(item.position, item.velocity, "start.objects") for item in start.objects
    }
    state = RobotState(
        pose_from(start.robot, "start.robot"),
        velocity(start.v, "start.v"),
        velocity(start.w, "start.w", "rad/s"),
    )
    pose, speed = pose_from(call.goal.pose, "call.goal.pose"), velocity(call.speed, "call.speed")
    goal = Goal(pose, speed, point_of(domain, call.top), _values(call, domain))
    episode = Episode(
        situation=Situation(message.action, state, objects, goal),
        samples=np.empty((0, sample_width(objects))),
        duration=message.actual.duration,
        success=message.outcome.code == SUCCEEDED,
        reason=printable(message.outcome.reason, 200),
        position_error=message.actual.accuracy,
        heading_error=message.heading_error,
        objects=tuple(objects),
    )
    if fault := fault_of(episode, top, robot):
        raise MessageError(fault)
    return episode


def _values(call: Any, domain: Vocabulary) -> dict[str, float]:
    """Return the values of the domain's goal variables; older recordings have none."""
    given = {item.name: item.value for item in getattr(call, "values", ())}
    return {name: given[name] for name in domain.goal_variables if name in given}


def _called_top(message: Any, domain: Vocabulary) -> Top | None:
    """Return the TOP of a record, None for that of another domain; raises MessageError."""
    name, action = message.call.top, message.action
    action_set = getattr(message, "action_set", "") or DEFAULT_SET  # older recordings have none
    for field, value in (("action", action), ("action_set", action_set)):
        if not is_name(value):
            raise MessageError(f"{field}: expected a name of letters, digits and _, got {quoted(value)}")
    top = next((top for top in domain.tops if top.name == name), None)
    calling = [top.name for top in domain.tops if top.action == action]
    if name not in calling and (calling or top is not None):
        expected = f"one of {', '.join(calling)}, which call" if calling else "a TOP that calls"
        raise MessageError(f"call.top: expected {expected} {action}, got {quoted(name)}")
    return top


def fault_of(episode: Episode, top: Top | None, robot: Robot) -> str:
    """Return why an episode of a TOP cannot be used; an empty text if it can.

    The goal, and objects that the TOP is about, lie no farther than the robot drives in ten minutes, or in
    the duration if that is longer. A robot that arrived has driven at most `_FASTEST` times as fast as
    its limit.
    """
    if not _is_finite(episode):
        return "expected finite numbers, and objects with names of letters, digits and _"
    start, goal = episode.situation.robot.pose, episode.situation.goal.pose
    reach = farthest = robot.limits.v * max(_LONGEST_DRIVE, episode.duration)
    if episode.success and top is not None and top.arrives:
        farthest = _SLACK + _FASTEST * robot.limits.v * episode.duration
    if (distance := start.distance(goal)) > farthest:
        return f"start: expected at most {farthest:.3g} m to the goal, got {distance:.3g} m"
    for name in () if top is None else objects_in(top):
        there = episode.situation.objects.get(name)
        distance = 0.0 if there is None else math.hypot(there.x - start.x, there.y - start.y)
        if distance > reach:
            return f"start: expected at most {reach:.3g} m to {name}, got {distance:.3g} m"
    return ""


def _is_finite(episode: Episode) -> bool:
    """Return whether the episode has finite values, and objects with valid names."""
    goal, objects = episode.situation.goal, episode.situation.objects
    if len(objects) > MOST_OBJECTS or not all(map(is_name, objects)):
        return False
    errors = (episode.position_error, episode.heading_error)
    finite = all(abs(number) <= LARGEST for number in (episode.duration, *goal.values.values()))  # NaN is not
    return finite and not min(episode.duration, goal.speed, *errors) < 0.0 and math.inf not in errors
