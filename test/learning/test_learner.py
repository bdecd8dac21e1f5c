"""The schedule of learning rounds, without losing records."""

from pathlib import Path
from typing import Any

import pytest
from stored import INFO, episodes

from ator_ros.experience.store import RecordStore, read_records
from ator_ros.learning import gains
from ator_ros.learning.learner import Learner
from ator_ros.learning.sets import RECORDS

NOTHING = {"made": "", "actions": {}}


class FakeRound:
    """Replaces `RoundProcess`; the test ends it."""

    def __init__(self) -> None:
        self.done, self.killed = False, False
        self.returned: dict[str, Any] = NOTHING

    def result(self) -> dict[str, Any]:
        return self.returned

    def kill(self) -> None:
        self.killed = True


@pytest.fixture
def rounds() -> list[FakeRound]:
    return []


@pytest.fixture
def learner(tmp_path: Path, rounds: list[FakeRound]) -> Learner:
    return made(tmp_path, rounds)


def made(folder: Path, rounds: list[FakeRound]) -> Learner:
    def begin() -> FakeRound:
        rounds.append(FakeRound())
        return rounds[-1]

    return Learner(folder, INFO, begin, start="", batch=10)


def take(learner: Learner, count: int) -> None:
    for episode in episodes(count):
        learner.take("default", episode)


def test_a_round_begins_after_a_batch_and_only_one_at_a_time(
    learner: Learner, rounds: list[FakeRound]
) -> None:
    take(learner, 9)
    learner.work(0.0)
    assert not rounds
    take(learner, 20)
    learner.work(1.0)
    learner.work(2.0)
    assert len(rounds) == 1
    rounds[0].done = True
    learner.work(3.0)
    learner.work(4.0)
    assert len(rounds) == 1  # no new records
    take(learner, 10)
    learner.work(5.0)
    assert len(rounds) == 2


def test_it_resumes_after_a_restart(
    tmp_path: Path, rounds: list[FakeRound], learner: Learner
) -> None:
    take(learner, 15)
    learner.work(0.0)
    rounds[0].done = True
    learner.work(1.0)
    take(learner, 4)
    learner.close()
    assert made(tmp_path, rounds).new == 4


def test_a_round_that_fails_or_hangs_is_reported(learner: Learner, rounds: list[FakeRound]) -> None:
    take(learner, 10)
    learner.work(0.0)
    rounds[0].returned, rounds[0].done = {"failed": "no memory"}, True
    assert learner.work(1.0) == "learning failed: no memory"
    learner.learn_now()
    learner.work(2.0)
    assert "took longer" in (learner.work(2000.0) or "")
    assert rounds[1].killed


def test_a_set_that_cannot_be_published_is_no_switch(
    learner: Learner, rounds: list[FakeRound]
) -> None:
    take(learner, 10)
    learner.work(0.0)
    verdict = {"episodes": 10, "kind": "scaled", "reason": "scaled: error from 2 to 1 s"}
    rounds[0].returned = {"made": "no such set", "actions": {"default/goToPose": verdict}}
    rounds[0].done = True
    assert "could not be published" in (learner.work(1.0) or "")
    assert learner.diagnostics()["default/goToPose: not switched"] == verdict["reason"]


@pytest.mark.parametrize(("chains", "records"), [(2, 0), (1, 5)])
def test_records_wait_while_the_disk_is_full(
    tmp_path: Path, learner: Learner, monkeypatch: pytest.MonkeyPatch, chains: int, records: int
) -> None:
    take(learner, 3)

    def full(*_: object, **__: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RecordStore, "append", full)
    monkeypatch.setattr(gains, "save", full)
    for _ in range(chains):
        learner.take_chain(gains.ChainGain(True, 0.5, 0.1))
    take(learner, records)
    learner.work(5.0)
    assert "expected a folder that can be written: No space left" in learner.problem
    monkeypatch.undo()
    learner.work(10.0)
    assert (learner.problem, learner.fault) == ("", "")
    learner.close()
    assert learner.lost == 0
    assert len(read_records(tmp_path / RECORDS, "default")) == 3 + records
    assert len(gains.read_gains(tmp_path, learner.gains.models).chains) == chains


def test_freezing_ends_a_round_and_persists(
    tmp_path: Path, learner: Learner, rounds: list[FakeRound]
) -> None:
    take(learner, 10)
    learner.work(0.0)
    learner.freeze(True)
    assert rounds[0].killed
    learner.close()
    again = made(tmp_path, rounds)
    again.work(1.0)
    assert again.learn_now() == "learning is frozen"
    assert len(rounds) == 1
    again.freeze(False)
    again.work(2.0)
    assert len(rounds) == 2
