"""Conversion of the executor's records to episodes."""

import math
from functools import reduce
from typing import Any

import numpy as np
import pytest
from bags import ROBOT, action_performance, own_types

from ator_ros.bases.drive_parts import DriveParts, part_times
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.records import episode_of
from ator_ros.geometry import Pose
from ator_ros.world.readers import MessageError

TYPES = own_types()
LONG_NAME = "b" * 1_000_000


def record(**fields: object) -> Any:
    """Return the record of a goToBall of 3 s, with `fields` by path, as in call__goal__pose."""
    made = action_performance(TYPES, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=3.0, code=1)
    for path, value in fields.items():
        *parents, last = path.split("__")
        owner = reduce(
            lambda part, name: part[int(name)] if name.isdigit() else getattr(part, name),
            parents,
            made,
        )
        setattr(owner, last, value)
    return made


def test_a_record_becomes_an_episode() -> None:
    episode = episode_of(record(), SOCCER, ROBOT)
    assert (episode.situation.action, episode.duration, episode.success) == ("goToPose", 3.0, True)
    assert episode.situation.goal.pose == pytest.approx((1.5, 0.5, 0.7))
    assert list(episode.situation.objects) == ["ball"]
    assert episode.parts == DriveParts(first_turn=0.4, last_turn=0.6, driven=1.5)
    # Without a set, it is an action of the default one; another program may not know the errors.
    unknown = episode_of(record(action_set="", heading_error=math.nan), SOCCER, ROBOT)
    assert unknown.situation == episode.situation


@pytest.mark.parametrize(
    "fields",
    [{"first_turn": math.nan}, {"last_turn": 0.0}, {"last_turn": -0.1}, {"first_turn": 2.5}],
)
def test_a_record_may_lack_the_parts_of_the_drive(fields: dict[str, float]) -> None:
    episode = episode_of(record(**fields), SOCCER, ROBOT)
    assert np.isnan(part_times(episode.rows(0, ("ball",)))).any()


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("actual__duration", math.nan, "expected finite numbers"),
        ("actual__duration", -1.0, "no negative speed, duration or error"),
        ("heading_error", math.inf, "expected finite numbers"),
        ("call__speed", math.inf, "call.speed: expected a finite number"),
        ("start__robot__position__x", 1e300, "start.robot.position.x: expected a finite number"),
        ("start__robot__position__x", -900.0, "start: expected at most"),
        (
            "call__goal__pose__position__y",
            math.inf,
            "call.goal.pose.position.y: expected a finite number",
        ),
        ("start__objects__0__position__x", math.inf, "start.objects[0].position: x: expected a"),
        ("start__objects__0__name", LONG_NAME, "start.objects[0].name: expected"),
        ("action", "../../elsewhere", "action: expected a name of letters"),
        ("action_set", "no name", "action_set: expected a name of letters"),
        ("action", "shoot", "call.top: expected one of shoot, which call shoot, got 'goToBall'"),
        ("call__top", "visit", "call.top: expected one of "),
        ("call__top", "shoot", "call.top: expected one of "),
    ],
)
def test_an_unusable_record_is_rejected_with_its_fault(
    path: str, value: object, expected: str
) -> None:
    with pytest.raises(MessageError) as raised:
        episode_of(record(**{path: value}), SOCCER, ROBOT)
    assert expected in str(raised.value)
    assert len(str(raised.value)) < 500
