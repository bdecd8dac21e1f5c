"""How often the executor looks after its deadlines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from ator_ros.execution.phases import WATCH_PERIOD
from ator_ros.nodes.watchdog import Watchdog


class FakeTimer:
    """A timer that counts how often it is begun anew."""

    def __init__(self, period: float) -> None:
        self.timer_period_ns = round(1e9 * period)
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1


def test_goals_that_come_one_after_the_other_do_not_begin_its_period_anew() -> None:
    made: list[FakeTimer] = []

    def create_timer(period: float, *_: Any, **__: Any) -> FakeTimer:
        made.append(FakeTimer(period))
        return made[-1]

    watchdog: Any = Watchdog(SimpleNamespace(create_timer=create_timer), lambda: None)
    for _ in range(100):
        watchdog.watch(closely=True)
    (timer,) = made
    assert timer.resets == 1
    assert timer.timer_period_ns == round(1e9 * WATCH_PERIOD)
    watchdog.watch(closely=False)
    assert timer.resets == 2
    assert timer.timer_period_ns == round(1e9)
