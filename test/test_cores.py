"""Loops that several cores share: every item once, the same results, and no waiting for a busy core."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest

from ator_ros import cores
from ator_ros.cores import in_shares, together, use_cores
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.run_up_times import run_up_times
from ator_ros.evaluation.trials import open_places, open_speeds, random_trial
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import feature_table
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import load_robot


@pytest.fixture(autouse=True)
def one_core_again(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Pretend that there are four cores, and use one again in the end."""
    monkeypatch.setattr(cores.os, "sched_getaffinity", lambda _: {0, 1, 2, 3})
    yield
    use_cores(1)


@pytest.mark.parametrize("most", [1, 2, 3])
@pytest.mark.parametrize(("count", "least"), [(0, 5), (1, 5), (5, 5), (6, 5), (1000, 7)])
def test_every_item_is_computed_once(most: int, count: int, least: int) -> None:
    use_cores(most)
    done: list[int] = []
    in_shares(lambda first, end: done.extend(range(first, end)), count, least)
    assert sorted(done) == list(range(count))


def test_another_core_takes_shares_while_this_one_computes() -> None:
    use_cores(2)
    met = threading.Barrier(2, timeout=10.0)

    def run(first: int, end: int) -> None:
        if first in (0, 50):
            met.wait()  # breaks unless both shares are under way at once

    in_shares(run, 150, 50)


@pytest.mark.parametrize("most", [1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_calls_made_together_return_in_their_order(most: int, count: int) -> None:
    use_cores(most)
    assert together([partial(pow, number, 2) for number in range(count)]) == [n * n for n in range(count)]


def test_calls_are_made_at_once_where_two_cores_are_used() -> None:
    use_cores(2)
    met = threading.Barrier(2, timeout=10.0)
    together([met.wait, met.wait])  # breaks unless both are under way at once


def test_calls_made_together_may_share_loops_themselves() -> None:
    use_cores(2)
    done: list[int] = []

    def loop() -> None:
        in_shares(lambda first, end: done.extend(range(first, end)), 300, 10)

    together([loop] * 5)
    assert sorted(done) == sorted(5 * list(range(300)))


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_of_a_call_is_raised(failing: int) -> None:
    use_cores(2)

    def call(number: int) -> None:
        time.sleep(0.01)
        if number == failing:
            raise ArithmeticError(f"call {number}")

    with pytest.raises(ArithmeticError, match=f"call {failing}"):
        together([partial(call, number) for number in range(2)])


@pytest.mark.parametrize("most", [1, 2, 3])
def test_of_several_errors_that_of_the_first_call_is_raised(most: int) -> None:
    use_cores(most)

    def call(number: int) -> None:
        time.sleep(0.002 * (8 - number))  # the later ones fail sooner
        if number >= 2:
            raise ArithmeticError(f"call {number}")

    with pytest.raises(ArithmeticError, match="call 2"):
        together([partial(call, number) for number in range(8)])


def test_cores_may_be_changed_while_they_compute() -> None:
    use_cores(2)
    ended = threading.Event()

    def change() -> None:
        while not ended.is_set():
            use_cores(2)
            use_cores(3)

    changing = threading.Thread(target=change)
    changing.start()
    try:
        for _ in range(300):
            assert together([partial(abs, -number) for number in range(4)]) == [0, 1, 2, 3]
    finally:
        ended.set()
        changing.join()


def test_no_more_cores_are_used_than_there_are() -> None:
    assert use_cores(64) == 4
    assert use_cores(1) == 1


def test_a_core_that_is_busy_delays_nothing() -> None:
    use_cores(2)
    end = threading.Event()
    cores._helpers.start(lambda: end.wait(10.0) and None)
    began = time.monotonic()
    done: list[int] = []
    in_shares(lambda first, end: done.extend(range(first, end)), 100, 10)
    assert time.monotonic() - began < 5.0
    assert sorted(done) == list(range(100))
    end.set()


@pytest.mark.parametrize("failing", [0, 60])
def test_an_error_is_raised_wherever_it_happens(failing: int) -> None:
    use_cores(2)

    def run(first: int, end: int) -> None:
        time.sleep(0.01)
        if first == failing:
            raise ArithmeticError(f"share {first}")

    with pytest.raises(ArithmeticError, match=f"share {failing}"):
        in_shares(run, 180, 60)


def results() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(23)
    count = 1500
    direct = {name: rng.uniform(-3.0, 3.0, count) for name in ("x", "y", "yaw", "xg", "yg", "yawg")}
    direct |= {"v": rng.uniform(0.0, 1.0, count), "w": np.zeros(count)}
    direct |= {"speedg": rng.uniform(0.0, 0.5, count), "hold": np.ones(count)}
    names = ["drive_time", "drive_turn", "dribble_time", "dribble_turn", "path_time"]
    table = feature_table(direct, load_robot(), [SOCCER.known_features[name] for name in names])
    starts = np.stack(
        [rng.uniform(-4.0, -1.0, count), *rng.uniform(-2.0, 2.0, (2, count)), 0.5 + 0.0 * direct["v"]]
    )
    return table, run_up_times(load_robot(), starts)


def answers() -> list[str]:
    """Return what refinement makes of chains with open headings, speeds and places, to the last bit."""
    robot = load_robot()
    library, refiner = SOCCER.library(robot), Refiner(robot, load_models(robot, SOCCER.known_features))
    found = []
    for index, name in itertools.product(range(2), SOCCER.chains):
        trial = random_trial(SOCCER, name, library, seed=5, index=index)
        for chain in (trial.chain, open_speeds(trial.chain), open_places(trial.chain)):
            answer = refiner.refine(trial.world, chain, placeholders=True)
            curves = [(curve.values.tobytes(), curve.totals.tobytes()) for curve in answer.curves]
            found.append(repr((answer.best, answer.before, answer.after, answer.reason, curves)))
    return found


@pytest.mark.parametrize("most", [2, 3])
def test_refinement_is_the_same_to_the_bit_on_any_number_of_cores(most: int) -> None:
    alone = answers()
    use_cores(most)
    assert answers() == alone


def test_results_are_the_same_to_the_bit_however_they_are_shared() -> None:
    alone = results()
    use_cores(3)
    for one, shared in zip(alone, results(), strict=True):
        assert one.tobytes() == shared.tobytes()
