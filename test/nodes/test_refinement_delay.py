"""By how much requests to refinement delay each other, in time of computing (without ROS between)."""

from __future__ import annotations

import gc
import random
import time
from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.serialization import serialize_message

from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.trials import random_trial
from ator_ros.nodes.conversions import chain_of, situation_of
from ator_ros.nodes.refinement import refining_of
from ator_ros.nodes.refinement_answers import answer_of
from ator_ros.nodes.turns import Turns
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.calibration_file import load_calibration_if_any
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.slices import Slices, completed
from ator_ros.resources import resource_path
from ator_ros.robot.description import load_robot
from ator_ros.tools.benchmarks.requests import worst_request
from ator_ros.tools.benchmarks.service import LIMIT_DELAY_MS

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)
DEADLINE = 0.05
WORST = worst_request()  # to write it takes as long as many turns


@pytest.fixture(scope="module")
def refiner() -> Iterator[Refiner]:
    calibration = load_calibration_if_any(resource_path("models"))
    models = load_models(ROBOT, SOCCER.known_features)
    made = Refiner(ROBOT, models, ranges=SOCCER.ranges, calibration=calibration)
    for request in (WORST, short_request(0)):  # everything once
        serialize_message(completed(served(made, request)))
    gc.collect()
    gc.freeze()  # as the nodes do
    yield made
    gc.unfreeze()


def short_request(index: int) -> RefineSubgoal.Request:
    trial = random_trial(SOCCER, "dribble", LIBRARY, seed=802, index=index)
    return RefineSubgoal.Request(
        situation=situation_of(trial.world, frame="odom"),
        chain=chain_of(trial.chain, action_set="", frame="odom"),
    )


def served(refiner: Refiner, request: RefineSubgoal.Request) -> Slices[RefineSubgoal.Response]:
    choice = yield from refining_of(request, refiner, LIBRARY, frame="odom")
    yield
    return answer_of(choice, request, action_set="default", frame="odom", want_curve=False)


def delays(refiner: Refiner, worst: int, count: int) -> list[float]:
    """Return by how many s each of `count` short requests is delayed beside so many of the worst at once."""
    clock, chance, found = time.thread_time, random.Random(0), []
    turns = Turns(clock, deadline=DEADLINE, most=worst + 1)

    def again(answer: Any) -> None:
        if answer is not None:
            serialize_message(answer)
        turns.add(served(refiner, WORST), again, size=32)

    for _ in range(worst):
        again(None)
    for index in range(count):
        request, began = short_request(index), clock()
        serialize_message(completed(served(refiner, request)))
        alone, until = clock() - began, clock() + chance.uniform(0.001, 0.02)
        while clock() < until:
            turns.work()
        ended: list[Any] = []
        turns.add(served(refiner, request), ended.append, size=2)
        while not ended:
            turns.work()
        serialize_message(ended[0])
        found.append(clock() - until - alone)
    return found


@pytest.mark.long
@pytest.mark.parametrize("worst", [1, 4])
def test_the_worst_requests_delay_others_by_at_most_20_ms(refiner: Refiner, worst: int) -> None:
    found = sorted(delays(refiner, worst, 200))
    # Some of a busy machine's caches are cold: 1 % may take longer, up to twice as long.
    assert found[-3] < LIMIT_DELAY_MS / 1000.0
    assert found[-1] < 2.0 * LIMIT_DELAY_MS / 1000.0


@pytest.mark.long
def test_many_of_the_worst_at_once_are_all_answered_soon(refiner: Refiner) -> None:
    clock, ended = time.thread_time, []
    turns, began = Turns(clock, deadline=DEADLINE, most=32), clock()
    for _ in range(31):
        turns.add(served(refiner, WORST), ended.append, size=32)
    while turns:
        turns.work()
    assert len(ended) == 31
    assert all(answer.accepted and answer.cut_short for answer in ended)
    assert clock() - began < 0.5
