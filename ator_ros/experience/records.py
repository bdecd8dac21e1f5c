"""Convert the executor's records (ator_interfaces/msg/ActionPerformance) to episodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import Situation
from ator_ros.experience.columns import FARTHEST, MOST_OBJECTS
from ator_ros.experience.episode import Episode, sample_width
from ator_ros.experience.vocabulary import Vocabulary, point_of
from ator_ros.files import is_name
from ator_ros.geometry import Pose, yaw_from_quaternion
from ator_ros.printable import printable
from ator_ros.world.state import ObjectState, RobotState

SUCCEEDED, FAILED = 1, 2  # codes of ator_interfaces/msg/Outcome
ENDED = (SUCCEEDED, FAILED)
"""Outcomes of actions that were not broken off from outside."""


def episode_of(message: Any, domain: Vocabulary) -> Episode:
    """Convert a record of any action to an episode; it has no samples but its start."""
    start, call = message.start, message.call
    objects = {
        item.name: ObjectState(item.position.x, item.position.y, item.velocity.x, item.velocity.y)
        for item in start.objects
    }
    return Episode(
        situation=Situation(
            message.action,
            RobotState(pose_of(start.robot), start.v, start.w),
            objects,
            Goal(pose_of(call.goal.pose), call.speed, point_of(domain, call.top), _values(call, domain)),
        ),
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
    robot, goal, objects = episode.situation.robot, episode.situation.goal, episode.situation.objects
    if len(objects) > MOST_OBJECTS or not all(map(is_name, objects)):
        return False
    errors = (episode.position_error, episode.heading_error)
    numbers: tuple[float, ...] = (*robot.pose, robot.v, robot.w, *goal.pose, goal.speed, episode.duration)
    numbers += tuple(goal.values.values())
    numbers += tuple(number for there in objects.values() for number in (there.x, there.y))
    return finite(numbers) and not min(episode.duration, goal.speed, *errors) < 0.0 and math.inf not in errors


def finite(row: tuple[float, ...]) -> bool:
    """Return whether a row can be used: a sensor may have sent NaN."""
    return all(abs(number) <= FARTHEST for number in row)  # NaN is not


def pose_of(pose: Any) -> Pose:
    """Return the pose in the plane that a geometry_msgs/Pose stands for."""
    q = pose.orientation
    return Pose(pose.position.x, pose.position.y, yaw_from_quaternion(q.x, q.y, q.z, q.w))
