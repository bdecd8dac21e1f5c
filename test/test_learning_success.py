"""Failures teach, too: what fails is predicted to fail, and refinement chooses something else."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from stored import ROBOT, episodes, stored

from ator_ros.actions.situation import Situation
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.policies import reopened
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial
from ator_ros.experience.episode import Episode, sample_width
from ator_ros.experience.store import RecordStore
from ator_ros.geometry import wrap_angle
from ator_ros.learning.round import Source, learn
from ator_ros.learning.sets import RECORDS, current_set, publish, read_manifest
from ator_ros.performance.model_file import load_model, load_models
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import RobotState

SUCCESS = "default/goToPose/success"
SHARP = math.radians(60.0)


def turn_of(episode: Episode) -> float:
    pose, goal = episode.situation.robot.pose, episode.situation.goal.pose
    return abs(wrap_angle(math.atan2(goal.y - pose.y, goal.x - pose.x) - pose.yaw))


def failing(stream: Iterator[Episode]) -> Iterator[Episode]:
    """Yield episodes of which those fail, at the time limit, that begin with a sharp turn."""
    for episode in stream:
        fails = turn_of(episode) > SHARP
        yield dataclasses.replace(
            episode, success=not fails, duration=60.0 if fails else episode.duration, position_error=0.01
        )


def round_of(folder: Path, models: Path = SOCCER.shipped_models) -> dict:
    told = learn(Source(folder, SOCCER, ROBOT, models), time="2026-01-01T00:00:00Z")
    if told["made"]:
        publish(folder, Path(told["made"]))
    return told


def test_what_fails_is_predicted_to_fail_after_some_tens_of_records(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, failing(episodes(60)))
    verdict = round_of(tmp_path)["actions"][SUCCESS]
    assert "Brier score" in verdict["reason"]
    assert verdict["after"] < 0.5 * verdict["before"]
    place = current_set(tmp_path)
    assert place is not None
    change = next(c for c in read_manifest(place).changes if c.measure == "success")
    assert (change.tested, change.before) == (verdict["tested"], verdict["before"])
    assert read_manifest(place).seen[SUCCESS] == 60
    model = load_model(place / "goToPose.json", ROBOT, SOCCER.known_features)
    fresh = list(failing(episodes(200, seed=9)))
    said = np.array([_success(model, episode) for episode in fresh])
    fails = np.array([not episode.success for episode in fresh])
    assert said[fails].mean() < 0.2
    assert said[~fails].mean() > 0.8


def _success(model, episode: Episode) -> float:
    start, goal = episode.situation.robot, episode.situation.goal
    direct = {
        "x": start.pose.x, "y": start.pose.y, "yaw": start.pose.yaw, "v": start.v, "w": start.w,
        "xg": goal.pose.x, "yg": goal.pose.y, "yawg": goal.pose.yaw, "speedg": goal.speed, "hold": 0.0,
    }  # fmt: skip
    return float(model.predict(direct, ("success",)).success[0])


def test_a_few_failures_by_chance_are_no_pattern(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    stream = (dataclasses.replace(e, success=bool(rng.random() > 0.1)) for e in episodes(200))
    stored(tmp_path / RECORDS, stream)
    verdict = round_of(tmp_path)["actions"][SUCCESS]
    assert verdict["kind"] in ("", *(f"the rate of {size} episodes" for size in (200, 100)))


def test_failures_at_the_time_limit_are_no_lies(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, (dataclasses.replace(e, success=False, duration=600.0) for e in episodes(40)))
    assert round_of(tmp_path)["actions"][SUCCESS]["episodes"] == 40


def test_what_is_not_done_any_more_is_not_forgotten(tmp_path: Path) -> None:
    stored(tmp_path / RECORDS, failing(episodes(60))).close()
    assert round_of(tmp_path)["actions"][SUCCESS]["kind"]
    straight = [episode for episode in episodes(400, seed=4) if turn_of(episode) < 0.8 * SHARP]
    for begin in range(0, 120, 30):
        stored(tmp_path / RECORDS, iter(straight[begin : begin + 30])).close()
        assert "start" not in round_of(tmp_path)["actions"][SUCCESS]["kind"]
    place = current_set(tmp_path)
    assert place is not None
    model = load_model(place / "goToPose.json", ROBOT, SOCCER.known_features)
    sharp = [episode for episode in episodes(200, seed=9) if turn_of(episode) > 1.2 * SHARP]
    assert np.mean([_success(model, episode) for episode in sharp]) < 0.3


class Pitch:
    """Chains played without a simulator: a dribble that begins with a sharp turn loses the ball."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.library = SOCCER.library(ROBOT, "default")
        self.store: RecordStore = stored(folder / RECORDS)
        self.truth = load_models(ROBOT, SOCCER.known_features, folder=SOCCER.shipped_models)

    def refiner(self) -> Refiner:
        place = current_set(self.folder) or SOCCER.shipped_models
        models = load_models(ROBOT, SOCCER.known_features, folder=place)
        return Refiner(ROBOT, models, ranges=SOCCER.ranges, failure_cost=SOCCER.time_limit)

    def play(self, chains: range) -> float:
        """Return the share of the chains that fail; records are stored."""
        refiner, failed = self.refiner(), 0
        for index in chains:
            trial = random_trial(SOCCER, "dribble", self.library, seed=77, index=index)
            naive = refiner.naive(trial.world, open_speeds(trial.chain))
            chain = refiner.refine(trial.world, reopened(naive, trial.chain)).chain
            failed += self._executed(trial, chain, np.random.default_rng(index))
        return failed / len(chains)

    def _executed(self, trial: Trial, chain: TopChain, rng: np.random.Generator) -> bool:
        first, second = chain.calls
        times = [a["duration"] for a in predict_chain(trial.world, chain, self.truth, ROBOT).actions]
        back = ROBOT.hold
        arrived = first.goal.pose
        there = arrived._replace(
            x=arrived.x - back * math.cos(arrived.yaw), y=arrived.y - back * math.sin(arrived.yaw)
        )
        sharp = abs(
            wrap_angle(math.atan2(second.goal.pose.y - there.y, second.goal.pose.x - there.x) - there.yaw)
        )
        fails = sharp > SHARP
        starts = (trial.world.robot, RobotState(there))
        for call, start, time, ok in zip(chain.calls, starts, times, (True, not fails), strict=True):
            self.store.append(
                "default",
                Episode(
                    Situation(call.top.action, start, trial.world.objects, call.goal),
                    np.empty((0, sample_width(trial.world.objects))),
                    max(time + 0.05 * rng.standard_normal(), 0.1),
                    ok,
                    "",
                    0.01,
                    0.01,
                    tuple(trial.world.objects),
                ),
            )
        return fails


def test_an_action_that_begins_to_fail_leads_to_other_choices(tmp_path: Path) -> None:
    pitch = Pitch(tmp_path)
    for begin in (0, 20, 40):
        pitch.play(range(begin, begin + 20))
        round_of(tmp_path)
    assert Pitch(tmp_path / "shipped").play(range(60, 90)) > 0.3
    assert pitch.play(range(60, 90)) < 0.1
