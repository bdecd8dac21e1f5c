"""Sightings of objects: velocities from positions, wrong velocities, the filter, stamps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ator_ros.world.sightings import (
    JUMP,
    ObjectTracker,
    Sightings,
    StampError,
    VelocityCheck,
    VelocityEstimate,
)
from ator_ros.world.state import ObjectState

PLACE = st.floats(-5.0, 5.0)
SPEED = st.floats(-3.0, 3.0)


@settings(max_examples=30)
@given(PLACE, PLACE, SPEED, SPEED, st.sampled_from([0.01, 0.05, 0.1]))
def test_the_velocity_of_uniform_motion_is_estimated_exactly(
    x: float, y: float, vx: float, vy: float, period: float
) -> None:
    estimate = VelocityEstimate()
    for tick in range(20):
        time = tick * period
        state = estimate.state(time, x + vx * time, y + vy * time)
    assert (state.x, state.y) == (x + vx * time, y + vy * time)
    assert (state.vx, state.vy) == pytest.approx((vx, vy), abs=1e-6)


def test_an_object_counts_as_at_rest_until_its_positions_span_a_twentieth_of_a_second() -> None:
    estimate = VelocityEstimate()
    speeds = [estimate.state(0.01 * tick, 0.01 * tick, 0.0).vx for tick in range(8)]
    assert speeds[:5] == [0.0] * 5
    assert speeds[6:] == pytest.approx([1.0] * 2)


@pytest.mark.parametrize(
    ("elapsed", "dx", "dy", "is_kept"),
    [
        (0.05, 0.95, 0.0, True),
        (0.05, 0.0, -1.05, False),
        (0.05, 0.8, 0.8, False),
        (0.29, 0.0, 0.0, True),
        (0.31, 0.0, 0.0, False),
        (-0.01, 0.0, 0.0, False),
        (0.0, 0.0, 0.0, True),
    ],
)
def test_positions_are_forgotten_after_a_jump_a_gap_or_a_reset(
    elapsed: float, dx: float, dy: float, is_kept: bool
) -> None:
    estimate = VelocityEstimate()
    for tick in range(20):
        estimate.state(0.02 * tick, 100.0 + 0.02 * tick, 50.0 - 0.04 * tick)
    state = estimate.state(0.38 + elapsed, 100.38 + dx, 49.24 + dy)
    assert ((state.vx, state.vy) != (0.0, 0.0)) is is_kept


def test_a_velocity_is_that_of_the_last_three_tenths_of_a_second() -> None:
    estimate = VelocityEstimate()
    for tick in range(60):
        time = 0.02 * tick
        state = estimate.state(time, max(0.0, time - 0.8), 0.0)
    assert state.vx == pytest.approx(1.0)


def test_a_position_with_a_repeated_stamp_is_ignored() -> None:
    estimate = VelocityEstimate()
    for tick in range(10):
        estimate.state(0.05 * tick, 0.05 * tick, 0.0)
    again = estimate.state(0.05 * 9, 0.5, 0.1)
    assert (again.x, again.y) == (0.5, 0.1)
    assert (again.vx, again.vy) == pytest.approx((1.0, 0.0), abs=1e-6)


def reported(vx: float, speed: float, *, until: float = 1.0, **noise: float) -> list[float]:
    """Return the velocities used for an object that is said to move at `vx` from 0.5 s on."""
    check = VelocityCheck("ball", noise.get("noise", 0.0), noise.get("velocity_noise", 0.0))
    used = []
    for tick in range(round(until / 0.05) + 1):
        time = 0.05 * tick
        sighting = ObjectState(speed * time, 2.0, vx if time > 0.49 else speed, 0.0)
        used.append(check.check(time, sighting)[0].vx)
    return used


@pytest.mark.parametrize("speed", [0.0, 2.0, -2.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_velocity_may_differ_by_a_push_and_a_share_of_the_speed(
    speed: float, side: float
) -> None:
    # 0.3 m/s, 1 m/s^2 for 0.2 s, and a tenth of the greater of both speeds
    for difference in (0.5, 0.8):
        given_speed = speed + side * difference
        tolerance = 0.5 + 0.1 * max(abs(speed), abs(given_speed))
        is_used = difference <= tolerance
        expected = given_speed if is_used else speed
        assert reported(given_speed, speed)[-1] == pytest.approx(expected)


def test_the_noise_of_sightings_widens_the_tolerance() -> None:
    assert reported(1.0, 0.0)[-1] == pytest.approx(0.0)
    # 4 sigmas of 0.1 m/s, and of two positions with 1.5 cm over 0.2 s: 0.42 m/s
    assert reported(0.8, 0.0, velocity_noise=0.1)[-1] == pytest.approx(0.8)
    assert reported(1.1, 0.0, velocity_noise=0.1)[-1] == pytest.approx(0.0)
    assert reported(1.0, 0.0, noise=0.015)[-1] == pytest.approx(1.0)
    assert reported(1.2, 0.0, noise=0.015)[-1] == pytest.approx(0.0)


def test_a_velocity_that_jumps_is_used_for_a_fifth_of_a_second() -> None:
    used = reported(3.0, 0.0)
    assert used[10:14] == [3.0] * 4  # from 0.5 s on
    assert used[14:] == [0.0] * 7


def test_a_warning_is_given_once_until_a_velocity_is_plausible_again() -> None:
    check = VelocityCheck("cup", 0.0, 0.0)
    warnings = []
    for tick in range(120):
        is_wrong = 20 <= tick < 40 or 60 <= tick < 80
        sighting = ObjectState(1.0, 2.0, 5.0 if is_wrong else 0.0, -4.0 if is_wrong else 0.0)
        warning = check.check(0.05 * tick, sighting)[1]
        warnings += [(tick, warning)] if warning else []
    assert [tick for tick, _ in warnings] == [24, 64]
    assert warnings[0][1] == (
        "cup.twist.twist.linear: expected about (0.00, 0.00) m/s, as its positions show, "
        "got (5.00, -4.00) m/s: not trusted"
    )


@pytest.mark.parametrize(("gap", "is_known"), [(0.9, True), (1.1, False)])
def test_sightings_before_a_second_are_forgotten(gap: float, is_known: bool) -> None:
    check = VelocityCheck("cup", 0.0, 0.0)
    for tick in range(20):
        check.check(0.05 * tick, ObjectState(0.0, 0.0, 5.0, 0.0))
    found, _ = check.check(0.95 + gap, ObjectState(0.0, 0.0, 5.0, 0.0))
    assert found.vx == (0.0 if is_known else 5.0)


# The filter


def turned(state: ObjectState, angle: float) -> ObjectState:
    c, s = math.cos(angle), math.sin(angle)
    return ObjectState(
        c * state.x - s * state.y,
        s * state.x + c * state.y,
        c * state.vx - s * state.vy,
        s * state.vx + c * state.vy,
    )


def filtered(states: list[ObjectState], period: float = 0.05) -> list[ObjectState]:
    tracker = ObjectTracker(0.015, 0.05)
    return [tracker.update(period * tick, state) for tick, state in enumerate(states)]


def noisy(speed: float, count: int = 60) -> list[ObjectState]:
    rng = np.random.default_rng(5)
    return [
        ObjectState(
            speed * 0.05 * tick + rng.normal(scale=0.015),
            rng.normal(scale=0.015),
            speed + rng.normal(scale=0.05),
            rng.normal(scale=0.05),
        )
        for tick in range(count)
    ]


def test_without_noise_nothing_is_filtered() -> None:
    tracker = ObjectTracker(0.0, 0.0)
    state = ObjectState(1.0, 2.0, 3.0, 4.0)
    assert tracker.update(0.0, ObjectState(0.0, 0.0)) == ObjectState(0.0, 0.0)
    assert tracker.update(0.01, state) is state


@pytest.mark.parametrize("angle", [0.5, 2.0])
def test_the_filter_has_no_preferred_direction(angle: float) -> None:
    straight = filtered(noisy(0.0, 30))
    rotated = filtered([turned(state, angle) for state in noisy(0.0, 30)])
    for one, other in zip(straight, rotated, strict=True):
        expected = turned(one, angle)
        assert (other.x, other.vy) == pytest.approx((expected.x, expected.vy), abs=1e-9)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_filtering_halves_the_errors_of_uniform_motion(speed: float) -> None:
    measured = noisy(speed)
    found = filtered(measured)
    places = [speed * 0.05 * tick for tick in range(60)]

    def error(states: list[ObjectState]) -> float:
        pairs = list(zip(states, places, strict=True))[20:]
        return float(np.sqrt(np.mean([(state.x - x) ** 2 + state.y**2 for state, x in pairs])))

    def speed_error(states: list[ObjectState]) -> float:
        return float(np.sqrt(np.mean([(state.vx - speed) ** 2 for state in states[20:]])))

    assert error(found) < (0.7 if speed else 0.45) * error(measured)
    assert speed_error(found) < 0.7 * speed_error(measured)


def test_a_repeated_stamp_is_ignored_unless_it_jumps() -> None:
    tracker = ObjectTracker(0.015, 0.05)
    for tick in range(20):
        state = tracker.update(0.05 * tick, ObjectState(1.0, 0.0))
    assert tracker.update(0.05 * 19, ObjectState(1.01, 0.0)) == state
    assert tracker.update(0.05 * 19, ObjectState(2.0, 0.0)).x == 2.0


@pytest.mark.parametrize(
    ("elapsed", "dx", "restarts"),
    [
        (0.05, 0.03, False),
        (0.05, 0.3, True),
        (0.95, 0.03, False),
        (1.05, 0.03, True),
        (-0.1, 0.03, True),
    ],
)
def test_the_filter_restarts_after_a_jump_a_gap_or_a_reset(
    elapsed: float, dx: float, restarts: bool
) -> None:
    tracker = ObjectTracker(0.015, 0.05)
    for tick in range(20):
        tracker.update(0.05 * tick, ObjectState(1.0, 0.0))
    found = tracker.update(0.95 + elapsed, ObjectState(1.0 + dx, 0.0))
    assert (found.x == 1.0 + dx) is restarts


def test_a_moving_object_may_be_pushed_more_than_one_at_rest() -> None:
    def follows(speed: float) -> float:
        """Return how much of a change by 0.1 m/s is followed after two sightings."""
        tracker = ObjectTracker(0.015, 0.05)
        for tick in range(40):
            tracker.update(0.05 * tick, ObjectState(speed * 0.05 * tick, 0.0, speed, 0.0))
        place = speed * 0.05 * 39
        for tick in (40, 41):
            place += (speed + 0.1) * 0.05
            found = tracker.update(0.05 * tick, ObjectState(place, 0.0, speed + 0.1, 0.0))
        return (found.vx - speed) / 0.1

    assert 0.05 < follows(0.0) < 0.5 * follows(1.0)


# Stamps


def sightings(timeout: float = 0.4) -> Sightings:
    return Sightings("cup", timeout, ObjectTracker(0.0, 0.0))


def test_the_newest_sighting_not_after_odometry_is_extrapolated() -> None:
    known = sightings()
    for time in (1.0, 1.1, 1.2):
        known.add(time, ObjectState(10.0 * time, 0.0, 1.0, -2.0), 1.0)
    found = known.at(1.15)
    assert found is not None
    assert (found.x, found.y) == pytest.approx((11.05, -0.1))
    assert known.at(1.2) == ObjectState(12.0, 0.0, 1.0, -2.0)


def test_a_newer_sighting_is_extrapolated_backward_if_it_is_the_only_one() -> None:
    known = sightings()
    known.add(1.2, ObjectState(0.0, 0.0, 1.0, 0.0), 1.0)
    known.add(1.3, ObjectState(5.0, 0.0, 1.0, 0.0), 1.0)
    found = known.at(1.0)
    assert found is not None
    assert found.x == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("time", "is_known"), [(1.39, True), (1.41, False), (0.61, True), (0.59, False)]
)
def test_a_sighting_is_used_within_the_timeout(time: float, is_known: bool) -> None:
    known = sightings(0.4)
    known.add(1.0, ObjectState(0.0, 0.0), None)
    assert (known.at(time) is not None) is is_known


def test_an_object_is_overdue_after_half_of_the_timeout() -> None:
    known = sightings(0.4)
    assert known.overdue(0.0)
    known.add(0.9, ObjectState(0.0, 0.0), 1.0)  # received when odometry was at 1 s
    assert not known.overdue(1.19)
    assert known.overdue(1.2)
    known.forget()
    assert known.overdue(1.0)
    assert known.at(1.0) is None


@pytest.mark.parametrize(
    ("offset", "pace", "is_refused"),
    [
        (0.79, 1.0, False),
        (0.81, 1.0, True),
        (0.81, 0.5, True),
        (1.59, 2.0, False),
        (1.61, 2.0, True),
        (-JUMP + 0.1, 1.0, False),
        (-JUMP - 0.1, 1.0, True),
    ],
)
def test_stamps_far_from_odometry_are_refused_after_a_second(
    offset: float, pace: float, is_refused: bool
) -> None:
    known = sightings(0.4)
    for real in (10.0, 10.5, 10.9):
        known.add(100.0 + offset, ObjectState(0.0, 0.0), 100.0, pace, real)
    if is_refused:
        side = "ahead" if offset > 0.0 else "behind"
        text = f"^cup.header.stamp: .*odometry's 100.00 s, got .* s, {abs(offset):.2f} s {side}"
        with pytest.raises(StampError, match=text):
            known.add(100.0 + offset, ObjectState(0.0, 0.0), 100.0, pace, 11.0)
        assert known.overdue(100.0)
    else:
        assert known.add(100.0 + offset, ObjectState(0.0, 0.0), 100.0, pace, 11.0) is None
        assert not known.overdue(100.0)


def test_a_plausible_stamp_in_between_starts_the_second_again() -> None:
    known = sightings(0.4)
    for real, offset in ((10.0, 5.0), (10.9, 5.0), (10.95, 0.0), (11.5, 5.0), (12.4, 5.0)):
        assert known.add(100.0 + offset, ObjectState(0.0, 0.0), 100.0, 1.0, real) is None
    with pytest.raises(StampError):
        known.add(105.0, ObjectState(0.0, 0.0), 100.0, 1.0, 12.5)
