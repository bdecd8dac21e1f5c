"""Failures are learned: situations with failures are predicted to fail."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from stored import ROBOT, episodes, losses, round_of, stored

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.episode import Episode
from ator_ros.experience.store import read_records
from ator_ros.geometry import wrap_angle
from ator_ros.learning.sets import CURRENT, RECORDS, current_set, read_manifest
from ator_ros.performance.model_file import load_model
from ator_ros.performance.training import direct_of

SUCCESS = "default/goToPose/success"
SHARP = math.radians(60.0)


def turn_of(episode: Episode) -> float:
    pose, goal = episode.situation.robot.pose, episode.situation.goal.pose
    return abs(wrap_angle(math.atan2(goal.y - pose.y, goal.x - pose.x) - pose.yaw))


def failing(stream: Iterator[Episode]) -> Iterator[Episode]:
    """Yield episodes; those that start with a sharp turn fail at the time limit."""
    for episode in stream:
        fails = turn_of(episode) > SHARP
        yield dataclasses.replace(
            episode, success=not fails, duration=60.0 if fails else episode.duration, position_error=0.01
        )


def test_failures_are_predicted_after_tens_of_records(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, failing(episodes(60)))
    verdict = round_of(tmp_path)["actions"][SUCCESS]
    assert "Brier score" in verdict["reason"]
    old, new = losses(verdict["reason"])
    assert new < 0.5 * old
    place = current_set(tmp_path)
    assert read_manifest(place).reasons[SUCCESS] == verdict["reason"]
    assert read_manifest(place).seen[SUCCESS] == 60
    model = load_model(place / "goToPose.json", ROBOT, SOCCER.known_features)
    stored(tmp_path / "fresh", failing(episodes(200, seed=9)))
    rows = read_records(tmp_path / "fresh", "default")
    predicted = model.predict(direct_of(rows), ("success",)).success
    assert predicted[~rows["success"]].mean() < 0.2
    assert predicted[rows["success"]].mean() > 0.8


def test_a_few_random_failures_are_not_a_pattern(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    stream = (dataclasses.replace(e, success=bool(rng.random() > 0.1)) for e in episodes(200))
    stored(tmp_path / RECORDS, stream)
    verdict = round_of(tmp_path)["actions"][SUCCESS]
    assert verdict["kind"] in ("", *(f"the rate of {size} episodes" for size in (200, 100)))


def test_avoided_failures_are_not_forgotten(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, failing(episodes(60))).close()
    assert round_of(tmp_path)["actions"][SUCCESS]["kind"]
    straight = [episode for episode in episodes(400, seed=4) if turn_of(episode) < 0.8 * SHARP]
    for begin in range(0, 120, 30):
        stored(tmp_path / RECORDS, iter(straight[begin : begin + 30])).close()
        assert "start" not in round_of(tmp_path)["actions"][SUCCESS]["kind"]
    model = load_model(tmp_path / CURRENT / "goToPose.json", ROBOT, SOCCER.known_features)
    sharp = (episode for episode in episodes(200, seed=9) if turn_of(episode) > 1.2 * SHARP)
    stored(tmp_path / "sharp", sharp)
    rows = read_records(tmp_path / "sharp", "default")
    assert model.predict(direct_of(rows), ("success",)).success.mean() < 0.3
