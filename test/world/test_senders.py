"""Two senders of one topic or transform, by positions that jump to and fro."""

from collections.abc import Callable

import numpy as np
import pytest

from ator_ros.world.senders import LEAST_IN_ODOMETRY, PoseSenderCheck, SenderCheck


def senders(
    distance: float,
    *,
    is_shared: Callable[[], bool] | None = lambda: True,
    every: float = 2,
    speed: float = 0.8,
    noise: float = 0.0,
    uneven: float = 0.0,
    jump_every: int = 10**9,
) -> float:
    """Return the distance after 3 s at 40 Hz; one message in `every` is `distance` m off.

    `every` below 1 is the probability of such a message.

    A corrected position jumps by 0.3 m after `jump_every` messages.
    """
    rng, check, found, corrected = np.random.default_rng(2), SenderCheck(is_shared), 0.0, 0.0
    for tick in range(120):
        time = 0.025 * tick + (uneven if tick % 2 else 0.0)
        corrected += rng.choice([-0.3, 0.3]) if tick % jump_every == jump_every - 1 else 0.0
        x, y = rng.normal(scale=noise, size=2) if noise else (0.0, 0.0)
        is_off = rng.random() < every if every < 1 else tick % every == 0
        off = distance if is_off else 0.0
        found = check.distance(time, 7e5 + speed * time + x + corrected, y + off)
    return found


@pytest.mark.parametrize("distance", [0.05, 0.4, 30.0])
@pytest.mark.parametrize("every", [2, 3, 5])
@pytest.mark.parametrize("uneven", [0.0, 0.015])
def test_two_senders_are_recognized(distance: float, every: int, uneven: float) -> None:
    found = senders(distance, every=every, uneven=uneven)
    assert found == pytest.approx(distance, rel=0.3)
    in_tf = senders(distance, every=every, uneven=uneven, is_shared=None)
    assert in_tf == (0.0 if distance == 0.05 else found)


@pytest.mark.parametrize("cell", [0.03, 0.05])
@pytest.mark.parametrize("every", [0.5, 0.2, 2])
@pytest.mark.parametrize("is_shared", [None, lambda: False])
def test_one_sender_whose_positions_are_rounded_is_one(
    cell: float, every: float, is_shared: Callable[[], bool] | None
) -> None:
    for speed in (0.0, 0.8):
        assert senders(cell, every=every, speed=speed, is_shared=is_shared) == 0.0


@pytest.mark.parametrize(
    "alone",
    [
        {"noise": 0.003},
        {"noise": 0.1},
        {"uneven": 0.015, "speed": 2.0},
        {"jump_every": 7},
        {"jump_every": 2, "noise": 0.05},
    ],
)
def test_one_sender_with_noise_or_corrections_is_one(alone: dict[str, float]) -> None:
    assert senders(0.0, **alone) == 0.0


def jumping(check: SenderCheck, count: int, distance: float, *, start: float = 0.0) -> float:
    """Send `count` positions at 40 Hz, every second `distance` m off; return what is found."""
    found = 0.0
    for tick in range(count):
        found = check.distance(start + 0.025 * tick, distance * (tick % 2), 0.0)
    return found


def test_eight_jumps_are_needed() -> None:
    # the first jump is seen with the fifth position
    assert jumping(SenderCheck(lambda: True), 11, 0.4) == 0.0
    assert jumping(SenderCheck(lambda: True), 12, 0.4) == pytest.approx(0.4)


@pytest.mark.parametrize(("distance", "is_found"), [(0.019, False), (0.021, True)])
def test_two_centimeters_are_needed_on_a_topic(distance: float, is_found: bool) -> None:
    assert (jumping(SenderCheck(lambda: True), 40, distance) > 0.0) is is_found


@pytest.mark.parametrize(("distance", "is_found"), [(0.19, False), (0.21, True)])
def test_twenty_are_needed_in_tf(distance: float, is_found: bool) -> None:
    assert (jumping(SenderCheck(), 40, distance) > 0.0) is is_found
    in_odometry = SenderCheck(least=LEAST_IN_ODOMETRY)
    assert jumping(in_odometry, 40, distance) == pytest.approx(distance)


@pytest.mark.parametrize(("pause", "is_found"), [(1.3, True), (1.7, False)])
def test_senders_are_forgotten_a_second_and_a_half_after_the_last_jump(
    pause: float, is_found: bool
) -> None:
    check = SenderCheck(lambda: True)
    jumping(check, 41, 0.4)  # until 1 s
    found = jumping(check, round(pause / 0.025), 0.0, start=1.025)
    assert (found > 0.0) is is_found


def test_jumps_of_different_sizes_are_of_one_sender() -> None:
    for ratio, is_found in ((1.2, True), (2.0, False)):
        check = SenderCheck(lambda: True)
        found = 0.0
        for tick in range(60):
            size = 0.4 * (ratio if tick // 2 % 2 else 1.0)
            found = max(found, check.distance(0.025 * tick, size * (tick % 2), 0.0))
        assert (found > 0.0) is is_found


@pytest.mark.parametrize("angle", [0.3, 1.5, 3.1])
def test_poses_may_differ_in_their_heading_only(angle: float) -> None:
    check = PoseSenderCheck(lambda: True)
    found = ""
    for tick in range(40):
        found = check.difference(0.025 * tick, 0.0, 0.0, 1.0 + angle * (tick % 2))
    assert found == f"{angle:.2f} rad"


def test_a_difference_of_positions_comes_first() -> None:
    check = PoseSenderCheck(lambda: True)
    for tick in range(40):
        off = tick % 2
        found = check.difference(0.025 * tick, 0.0, 0.3 * off, 0.4 * off)
    assert found == "0.30 m"
    assert PoseSenderCheck().difference(0.0, 1.0, 2.0, 3.0) == ""


def test_stamps_that_stand_still_are_no_error() -> None:
    check = SenderCheck(lambda: True)
    found = [check.distance(1.0, 0.4 * (tick % 2), 0.0) for tick in range(40)]
    assert found[-1] == pytest.approx(0.4)
