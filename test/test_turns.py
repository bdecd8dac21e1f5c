"""Turns among requests, and the pace of refusals, with a clock of their own."""

from __future__ import annotations

import functools

import pytest

from ator_ros.nodes.pacing import Outbox, Pace
from ator_ros.nodes.turns import TURN, Turns
from ator_ros.refinement.slices import Slices

SLICE = 0.0015


class Clock:
    """Advances by what work takes."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def work(self, slices: int, closing: int = 0, length: float = SLICE) -> Slices[bool]:
        """Take `slices` slices, or `closing` more once time is up; give whether all were done."""
        for _ in range(slices):
            late = yield
            if late:
                for _ in range(closing):
                    self.now += length
                    yield
                return False
            self.now += length
        return True


@pytest.fixture
def clock() -> Clock:
    return Clock()


def turns(clock: Clock, deadline: float = 0.05, most: int = 32) -> Turns:
    return Turns(clock, deadline=deadline, most=most)


def test_work_without_competition_is_done_at_its_deadline(clock: Clock) -> None:
    one, results = turns(clock), []
    one.add(clock.work(10_000, closing=3), results.append, size=32)
    while one:
        one.work()
    assert results == [False]
    assert 0.05 <= clock.now <= 0.05 + 5 * SLICE


def test_work_that_fails_is_gone_and_the_others_go_on(clock: Clock) -> None:
    def failing() -> Slices[bool]:
        yield
        raise ZeroDivisionError

    two, results = turns(clock), []
    two.add(clock.work(10), results.append, size=2)
    two.add(failing(), results.append, size=1)
    with pytest.raises(ZeroDivisionError):
        two.work()
    while two:
        two.work()
    assert results == [True]


@pytest.mark.parametrize("long", [1, 4, 30])
@pytest.mark.parametrize("ahead", [0, 1, 7, 20, 60])
def test_a_short_request_is_hardly_delayed_by_long_ones(clock: Clock, long: int, ahead: int) -> None:
    some, ended = turns(clock), []
    for _ in range(long):
        some.add(clock.work(10_000, closing=5), lambda _: None, size=32)
    for _ in range(ahead):
        if some:
            some.work()
    came = clock.now
    some.add(clock.work(9, length=0.0005), lambda result: ended.append((result, clock.now)), size=2)
    while not ended:
        some.work()
    assert ended[0][0]
    # One turn that was under way; then every fourth turn is that of the oldest, whose time is up.
    assert ended[0][1] - came <= 9 * 0.0005 + 3 * (TURN + SLICE)


def test_long_requests_are_answered_though_short_ones_never_end(clock: Clock) -> None:
    some, ended = turns(clock), []
    some.add(clock.work(10_000, closing=5), lambda _: ended.append(clock.now), size=32)
    while not ended:
        some.add(clock.work(2), lambda _: None, size=2)
        some.work()
        assert clock.now < 0.3


def test_too_many_are_refused_and_places_become_free(clock: Clock) -> None:
    two = turns(clock, most=2)
    added = [two.add(clock.work(1), lambda _: None, size=1) for _ in range(3)]
    assert added == [True, True, False]
    assert len(two) == 2
    two.work()
    assert two.add(clock.work(1), lambda _: None, size=1)


def test_a_pace_allows_some_at_once_and_then_a_steady_rate(clock: Clock) -> None:
    pace = Pace(clock, rate=100.0, at_once=5)
    assert [pace.allows() for _ in range(6)] == [True] * 5 + [False]
    allowed = 0
    for _ in range(1000):
        clock.now += 0.001
        allowed += pace.allows()
    assert 99 <= allowed <= 101


def test_what_waits_leaves_at_the_pace_and_urgent_messages_first() -> None:
    clock = Clock()
    sent: list[str] = []
    outbox = Outbox(Pace(clock, rate=100.0, at_once=1), Pace(clock, rate=200.0, at_once=1), most=10)
    for name in ("busy 1", "answer 1", "busy 2", "answer 2", "busy 3"):
        outbox.add(functools.partial(sent.append, name), urgent=name.startswith("answer"))
    outbox.work()
    assert sent == ["answer 1", "busy 1"]
    clock.now += 0.0051
    outbox.work()
    assert sent[2:] == ["busy 2"]
    clock.now += 0.0051
    outbox.work()
    assert (sent[3:], len(outbox)) == (["answer 2", "busy 3"], 0)


def test_more_than_may_wait_leaves_at_once() -> None:
    sent: list[int] = []
    slow = Pace(Clock(), rate=1.0, at_once=1)
    outbox = Outbox(slow, slow, most=3)
    for number in range(10):
        outbox.add(functools.partial(sent.append, number), urgent=False)
    outbox.work()
    assert sent == list(range(8))  # one of the three that may wait is due
