"""Convert the executor's records (ator_interfaces/msg/ActionPerformance) to episodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import Situation
from ator_ros.experience.columns import LARGEST, MOST_OBJECTS
from ator_ros.experience.episode import Episode, sample_width
from ator_ros.experience.vocabulary import Vocabulary, point_of
from ator_ros.files import is_name
from ator_ros.printable import printable
from ator_ros.world.messages import object_from, pose_from, velocity
from ator_ros.world.state import RobotState

SUCCEEDED, FAILED = 1, 2  # codes of ator_interfaces/msg/Outcome
ENDED = (SUCCEEDED, FAILED)
"""Outcomes of actions that were not broken off from outside."""


def episode_of(message: Any, domain: Vocabulary) -> Episode:
    """Convert a record of any action to an episode; it has no samples but its start.

    Raises
    ------
    MessageError
        A pose or a velocity cannot be used.
    """
    start, call = message.start, message.call
    objects = {
        item.name: object_from(item.position, item.velocity, "start.objects") for item in start.objects
    }
    robot = RobotState(
        pose_from(start.robot, "start.robot"),
        velocity(start.v, "start.v"),
        velocity(start.w, "start.w", "rad/s"),
    )
    pose, speed = pose_from(call.goal.pose, "call.goal.pose"), velocity(call.speed, "call.speed")
    goal = Goal(pose, speed, point_of(domain, call.top), _values(call, domain))
    return Episode(
        situation=Situation(message.action, robot, objects, goal),
        samples=np.empty((0, sample_width(objects))),
        duration=message.actual.duration,
        success=message.outcome.code == SUCCEEDED,
        reason=printable(message.outcome.reason, 200),
        position_error=message.actual.accuracy,
        heading_error=message.heading_error,
        objects=tuple(objects),
    )


def _values(call: Any, domain: Vocabulary) -> dict[str, float]:
    """Return the values of the domain's goal variables; recordings from before there were any have none."""
    given = {item.name: item.value for item in getattr(call, "values", ())}
    return {name: given[name] for name in domain.goal_variables if name in given}


def sound(episode: Episode) -> bool:
    """Return whether the episode has finite values, and objects with valid names."""
    goal, objects = episode.situation.goal, episode.situation.objects
    if len(objects) > MOST_OBJECTS or not all(map(is_name, objects)):
        return False
    errors = (episode.position_error, episode.heading_error)
    finite = all(abs(number) <= LARGEST for number in (episode.duration, *goal.values.values()))  # NaN is not
    return finite and not min(episode.duration, goal.speed, *errors) < 0.0 and math.inf not in errors
