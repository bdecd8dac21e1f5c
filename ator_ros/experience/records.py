"""Conversion of the executor's records (ator_interfaces/msg/ActionPerformance) to episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import STOP, STOPS, GoalVariable
from ator_ros.actions.situation import ActionSpec, Situation
from ator_ros.bases.description import Robot
from ator_ros.bases.drive_parts import DriveParts
from ator_ros.experience.table import LARGEST, Episode
from ator_ros.files import is_name
from ator_ros.printable import printable, quoted
from ator_ros.tops.chain import Top
from ator_ros.world.readers import MessageError, ObjectSource, pose_from, velocity, world_from

_SUCCEEDED = 1
_FAILED = 2
ENDED = (_SUCCEEDED, _FAILED)
"""Codes of ator_interfaces/msg/Outcome of actions that ended by themselves."""
# s, twenty default action_timeouts: a farther goal is in another unit or frame
_LONGEST_DRIVE = 600.0
# m, above the tolerances of arrival: a robot that is at its goal already arrives in no time
_SLACK = 0.5
FASTEST = 4.0
"""Times a limit: a base may be described at half its real speed, and a factor of 2 is spare."""


class Vocabulary(Protocol):
    """The part of `ator_ros.domains.domain.Domain` that recordings need."""

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

    @property
    def action_sets(self) -> Mapping[str, tuple[ActionSpec, ...]]:
        """Its actions by set."""

    @property
    def goal_variables(self) -> Mapping[str, GoalVariable]:
        """The goal variables that its actions declare, by name."""


def episode_of(message: Any, domain: Vocabulary, robot: Robot) -> Episode:
    """Return the episode of a record of any action; its only sample is its start.

    An action that no TOP of the domain calls is accepted under its name, with goals for the axle.

    Raises
    ------
    MessageError
        A value cannot be used, the TOP does not call the action, or the robot cannot have driven so
        far.
    """
    name = message.call.top
    action = message.action
    for field, value in (("action", action), ("action_set", message.action_set or DEFAULT_SET)):
        if not is_name(value):
            raise MessageError(
                f"{field}: expected a name of letters, digits and _, got {quoted(value)}"
            )
    top = next((top for top in domain.tops if top.name == name), None)
    calling = [top.name for top in domain.tops if top.action == action]
    if name not in calling and (calling or top is not None):
        expected = f"one of {', '.join(calling)}, which call" if calling else "a TOP that calls"
        raise MessageError(f"call.top: expected {expected} {action}, got {quoted(name)}")
    start = world_from(message.start, where="start")
    call = message.call
    pose = pose_from(call.goal.pose, "call.goal.pose")
    speed = velocity(call.speed, "call.speed")
    given = {item.name: item.value for item in call.values}
    values = {name: given[name] for name in domain.goal_variables if name in given}
    if action in passing_actions(domain, message.action_set or DEFAULT_SET):
        passed = getattr(call, "passing", False) and not getattr(message, "stopped", True)
        values[STOP] = 0.0 if passed else 1.0
    point = Point.AXLE if top is None else top.point
    # Unknown parts are 0, NaN or missing in the message.
    first, last, driven = (getattr(message, name, 0.0) for name in DriveParts._fields)
    first, last = (
        each if 0.0 < each <= message.actual.duration else math.nan for each in (first, last)
    )
    parts = DriveParts(first, last, driven if 0.0 < abs(driven) <= LARGEST else math.nan)
    nearer = math.nan
    if values.get(STOP) == 0.0:
        end = world_from(message.end, where="end").robot.pose
        nearer = float(np.maximum(0.0, end.distance(pose) - message.actual.accuracy))
    episode = Episode(
        situation=Situation(action, start.robot, start.objects, Goal(pose, speed, point, values)),
        duration=message.actual.duration,
        success=message.outcome.code == _SUCCEEDED,
        reason=printable(message.outcome.reason, 200),
        position_error=message.actual.accuracy,
        heading_error=math.nan if values.get(STOP) == 0.0 else message.heading_error,
        parts=parts,
        nearer=nearer,
    )
    if fault := fault_in(episode, top, robot):
        raise MessageError(fault)
    return episode


def passing_actions(domain: Vocabulary, action_set: str) -> frozenset[str]:
    """Return the actions of a set that can pass their goals, see `STOP`."""
    specs = domain.action_sets.get(action_set, ())
    return frozenset(spec.name for spec in specs if STOPS in spec.goal_variables)


def fault_in(episode: Episode, top: Top | None, robot: Robot) -> str:
    """Return why an episode of a TOP cannot be used; empty if it can."""
    goal = episode.situation.goal
    errors = (episode.position_error, episode.heading_error)  # may be NaN
    finite = all(abs(number) <= LARGEST for number in (episode.duration, *goal.values.values()))
    if not finite or min(episode.duration, goal.speed, *errors) < 0.0 or math.inf in errors:
        return "expected finite numbers, and no negative speed, duration or error"
    farthest = robot.greatest_speed() * max(_LONGEST_DRIVE, episode.duration)
    if episode.success and top is not None and top.arrives:
        farthest = _SLACK + FASTEST * robot.greatest_speed() * episode.duration
    distance = episode.situation.robot.pose.distance(goal.pose)
    too_far = f"start: expected at most {farthest:.3g} m to the goal, got {distance:.3g} m"
    return too_far if distance > farthest else ""
