"""The delay of states on clocks that run with real time, and on others."""

import pytest

from ator_ros.world.delay import Delay

PERIOD = 0.05


def delay_after(
    seconds: float, *, pace: float = 1.0, late: float = 0.0, jitter: float = 0.0
) -> tuple[Delay, float]:
    """Return the measured and the true delay of a clock at its `pace`.

    After 5 s each second adds `late` s of delay. Every third state is read `jitter` s later.
    """
    delay, true = Delay(), 0.0
    for tick in range(round(seconds / PERIOD)):
        observed = tick * PERIOD
        true = late * max(0.0, observed - 5.0)
        wait = jitter if tick % 3 else 0.0
        delay.update(1.7e9 + pace * observed, 50.0 + observed + true + wait)
    return delay, true


@pytest.mark.parametrize("jitter", [0.0, 0.1])
@pytest.mark.parametrize("late", [0.1, 0.3, 1.0])
def test_a_growing_delay_is_measured(late: float, jitter: float) -> None:
    delay, true = delay_after(7.0, late=late, jitter=jitter)
    assert delay.seconds == pytest.approx(true, abs=0.2 + 0.1 * late)
    assert delay.seconds >= 0.5 * true


@pytest.mark.parametrize("pace", [1.0, 0.9999])
def test_clocks_that_drift_apart_and_late_messages_are_no_delay(pace: float) -> None:
    delay, _ = delay_after(600.0, pace=pace, jitter=0.15)
    assert delay.seconds < 0.02


@pytest.mark.parametrize("pace", [0.2, 0.8, 1.2, 5.0])
def test_simulations_that_are_slower_or_faster_than_real_time_have_no_known_delay(
    pace: float,
) -> None:
    delay, _ = delay_after(20.0, pace=pace, jitter=0.1)
    assert delay.seconds == 0.0


def test_a_pause_and_a_restart_are_no_delay() -> None:
    delay, _ = delay_after(5.0)
    delay.update(1.7e9 + 5.05, 50.0 + 8.0)  # a simulation that was paused for 3 s
    assert delay.seconds == 0.0
    delay, true = delay_after(8.0, late=0.3)
    assert delay.seconds == pytest.approx(true, abs=0.1)
    delay.restart()
    assert delay.seconds == 0.0


def stepped(seconds: float, late: float, *, period: float = PERIOD, since: float = 5.0) -> Delay:
    """Return the delay of a clock whose states come `late` s later from the time `since` on."""
    delay = Delay()
    for tick in range(round(seconds / period) + 1):
        time = tick * period
        delay.update(time, time + (late if time >= since - 1e-9 else 0.0))
    return delay


def test_the_delay_is_known_after_three_seconds_in_real_time() -> None:
    assert not stepped(2.9, 0.0).is_known
    assert stepped(3.2, 0.0).is_known


@pytest.mark.parametrize(
    ("pace", "is_known"), [(0.995, True), (1.005, True), (0.98, False), (1.02, False)]
)
def test_a_clock_may_differ_by_one_percent(pace: float, is_known: bool) -> None:
    assert delay_after(20.0, pace=pace)[0].is_known is is_known


@pytest.mark.parametrize("period", [0.05, 0.4])
def test_a_delay_is_measured_once_three_states_in_a_row_are_late(period: float) -> None:
    for late_states, measured in ((1, 0.0), (2, 0.0), (3, 0.3), (4, 0.3)):
        since = 13 * 0.4
        delay = stepped(since + (late_states - 1) * period, 0.3, period=period, since=since)
        assert delay.seconds == pytest.approx(measured, abs=1e-6)


def test_a_delay_is_usual_after_a_minute() -> None:
    assert stepped(60.0, 0.4).seconds == pytest.approx(0.4, abs=1e-6)
    assert stepped(67.0, 0.4).seconds == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("gap", "is_known"), [(0.9, True), (1.2, False)])
def test_a_second_without_states_may_be_a_pause(gap: float, is_known: bool) -> None:
    delay = stepped(4.0, 0.0)
    delay.update(4.0 + gap, 4.0 + gap)
    assert delay.is_known is is_known
