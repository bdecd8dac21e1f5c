"""A learning round: better models of durations and failures are adopted, worse ones rolled back."""

import dataclasses
import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from experience_rows import synthetic_model
from selection import few
from stored import ROBOT, episodes, losses, round_of, stored

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.experience.store import read_records
from ator_ros.experience.table import Episode
from ator_ros.geometry import wrap_angle
from ator_ros.learning.sets import CURRENT, RECORDS, current_set, digest_of, read_manifest
from ator_ros.performance.model_file import load_model, save_model
from ator_ros.performance.training import direct_of

NAME = "default/goToPose"


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shipped")
    save_model(folder / "goToPose.json", synthetic_model("goToPose", ROBOT))
    return folder


@pytest.mark.long
def test_an_unchanged_robot_keeps_its_models(tmp_path: Path, shipped: Path) -> None:
    switched = 0
    for seed in range(8):
        folder = tmp_path / str(seed)
        stored(folder / RECORDS, episodes(150, seed=seed + 10))
        result = round_of(folder, shipped)
        switched += bool(result["actions"][NAME]["kind"])
    assert switched <= 1


@pytest.mark.long
@pytest.mark.parametrize("before", few([0, 150, 500], 0))
def test_a_slower_robot_gets_new_models_soon(tmp_path: Path, shipped: Path, before: int) -> None:
    changed = episodes(45, seed=4, slower=1.3)
    stored(tmp_path / RECORDS, episodes(before, seed=3), changed)
    result = round_of(tmp_path, shipped)
    verdict = result["actions"][NAME]
    assert verdict["kind"]
    old, new = losses(verdict["reason"])
    assert new < 0.5 * old
    place = current_set(tmp_path)
    manifest = read_manifest(place)
    assert manifest.digest == digest_of(place)
    assert manifest.reasons[NAME] == verdict["reason"]
    assert manifest.seen[NAME] == before + 45
    again = round_of(tmp_path, shipped)
    assert not again["made"]
    assert "too few new records: 0" in again["actions"][NAME]["reason"]
    stored(tmp_path / "fresh", episodes(100, seed=99, slower=1.3))
    rows = read_records(tmp_path / "fresh", "default")
    model = load_model(place / "goToPose.json", ROBOT, SOCCER.known_features)
    assert np.mean(np.abs(model.predict(direct_of(rows)).duration - rows["duration"])) < 0.25
    assert model.errors is not None


def test_a_round_with_too_few_records_reports_the_required_number(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, episodes(5)).close()
    result = round_of(tmp_path, tmp_path / "no models")
    reason = "too few new records: 5, expected 12 that succeeded"
    assert result["actions"][NAME]["reason"] == reason
    assert result["made"] == ""


@pytest.mark.long
def test_a_set_with_larger_errors_is_rolled_back(tmp_path: Path, shipped: Path) -> None:
    stored(tmp_path / RECORDS, episodes(60, slower=1.3)).close()
    round_of(tmp_path, shipped)
    stored(tmp_path / RECORDS, episodes(30, seed=5)).close()  # the robot is as fast as before
    result = round_of(tmp_path, shipped)
    assert result["actions"][NAME]["kind"] == "back to the models of the start"
    folders = shipped, tmp_path / CURRENT
    models = (
        load_model(folder / "goToPose.json", ROBOT, SOCCER.known_features) for folder in folders
    )
    direct = direct_of(read_records(tmp_path / RECORDS, "default"))
    old, new = (model.predict(direct).duration for model in models)
    assert np.array_equal(old, new)


def test_cold_start_waits_until_predictions_are_useful(tmp_path: Path) -> None:
    nothing = tmp_path / "nothing"
    nothing.mkdir()
    folder = tmp_path / "learned"
    stored(folder / RECORDS, episodes(15)).close()
    first = round_of(folder, nothing)
    assert not first["made"]
    stored(folder / RECORDS, episodes(60, seed=2)).close()
    assert round_of(folder, nothing)["made"]


def test_a_new_set_keeps_the_search_ranges_of_the_previous_experience(
    tmp_path: Path, shipped: Path
) -> None:
    starts = {"speedg": (0.0, 0.5), "braking": (0.0, 0.35)}
    bounded, action = tmp_path / "bounded", synthetic_model("goToPose", ROBOT)
    shutil.copytree(shipped, bounded)
    save_model(
        bounded / "goToPose.json",
        dataclasses.replace(action, metadata={"training": {"starts": starts}}),
    )
    folder = tmp_path / "learned"
    stored(folder / RECORDS, episodes(24, seed=4, slower=1.5))
    assert round_of(folder, bounded)["made"]
    file = folder / CURRENT / "goToPose.json"
    model = load_model(file, ROBOT, SOCCER.known_features)
    assert model.experience == starts
    training = model.metadata["training"]
    kinds = "duration: the present model scaled to 30 episodes; success: the rate of 24 episodes"
    assert training["kind"].startswith(kinds)
    assert (training["command"], training["episodes"]) == ("learning", 24)
    assert model.metadata["action_set"] == "default"


def test_records_with_impossible_durations_have_no_effect(tmp_path: Path, shipped: Path) -> None:
    records = [
        dataclasses.replace(e, duration=9e5) if n % 10 == 0 else e
        for n, e in enumerate(episodes(24))
    ]
    stored(tmp_path / RECORDS, iter(records))
    assert not round_of(tmp_path, shipped)["actions"][NAME]["kind"]


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
            episode,
            success=not fails,
            duration=60.0 if fails else episode.duration,
            position_error=0.01,
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


@pytest.mark.long
def test_avoided_failures_are_not_forgotten(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, failing(episodes(60))).close()
    assert round_of(tmp_path)["actions"][SUCCESS]["kind"]
    straight = [episode for episode in episodes(400, seed=4) if turn_of(episode) < 0.8 * SHARP]
    for begin in (0, 30):
        stored(tmp_path / RECORDS, iter(straight[begin : begin + 30])).close()
        assert "start" not in round_of(tmp_path)["actions"][SUCCESS]["kind"]
    model = load_model(tmp_path / CURRENT / "goToPose.json", ROBOT, SOCCER.known_features)
    sharp = (episode for episode in episodes(200, seed=9) if turn_of(episode) > 1.2 * SHARP)
    stored(tmp_path / "sharp", sharp)
    rows = read_records(tmp_path / "sharp", "default")
    assert model.predict(direct_of(rows), ("success",)).success.mean() < 0.3


@pytest.mark.long
@pytest.mark.parametrize("known", [True, False])
def test_drives_that_were_held_up_are_described_apart(
    tmp_path: Path, shipped: Path, known: bool
) -> None:
    drives = list(episodes(60, seed=4, slower=1.3))
    for number in (9, 25, 41, 52):
        drives[number] = dataclasses.replace(
            drives[number], duration=drives[number].duration + 20.0
        )
    stored(tmp_path / RECORDS, iter(drives))
    models = shipped if known else tmp_path / "none"
    assert round_of(tmp_path, models)["made"]
    file = tmp_path / CURRENT / "goToPose.json"
    model = load_model(file, ROBOT, SOCCER.known_features)
    assert model.held_up.drives >= (4 if known else 3)
    assert model.held_up.delay == pytest.approx(20.0, abs=2.0)
    stored(tmp_path / "fresh", episodes(60, seed=99, slower=1.3))
    rows = read_records(tmp_path / "fresh", "default")
    assert np.mean(np.abs(model.predict(direct_of(rows)).duration - rows["duration"])) < 0.4


@pytest.mark.long
def test_errors_of_a_tree_that_remains_become_known(tmp_path: Path) -> None:
    folder = tmp_path / "learned"
    file = folder / CURRENT / "goToPose.json"
    known = []
    for seed in range(6):
        stored(folder / RECORDS, episodes(20, seed=40 + seed)).close()
        round_of(folder, tmp_path / "none")
        if file.exists():
            model = load_model(file, ROBOT, SOCCER.known_features)
            assert model.errors is not None
            known.append(len(model.errors.points))
    assert known[0] <= 20
    assert known[-1] >= 40
