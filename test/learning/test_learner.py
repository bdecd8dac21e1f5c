"""The schedule of learning rounds, without losing records."""

from pathlib import Path
from typing import Any

import pytest
from stored import INFO, episodes

from ator_ros.experience.store import RecordStore, read_records
from ator_ros.experience.table import Episode
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


def made(folder: Path, rounds: list[FakeRound], *, batch: int = 10) -> Learner:
    def begin() -> FakeRound:
        rounds.append(FakeRound())
        return rounds[-1]

    return Learner(folder, INFO, begin, start="", batch=batch)


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


def test_more_records_are_awaited_once_there_are_many(
    tmp_path: Path, rounds: list[FakeRound]
) -> None:
    """A round is due after 2 % of the records."""
    learner = made(tmp_path, rounds, batch=1)
    take(learner, 100)
    learner.work(0.0)
    rounds[0].done = True
    learner.work(1.0)
    for count in (1, 2, 3):
        take(learner, 1)
        learner.work(2.0)
        assert (len(rounds), learner.new) == (1 if count < 3 else 2, count)


def test_a_round_may_take_half_an_hour(learner: Learner, rounds: list[FakeRound]) -> None:
    learner.learn_now()
    learner.work(100.0)
    assert learner.work(1899.0) is None
    assert not rounds[0].killed
    assert "learning failed: it took longer than 1800 s" in (learner.work(1901.0) or "")
    assert rounds[0].killed


def test_no_round_begins_without_a_map(learner: Learner, rounds: list[FakeRound]) -> None:
    take(learner, 10)
    learner.work(0.0, may_begin=False)
    assert not rounds
    assert learner.diagnostics()["learning"] == "waiting for records"
    learner.work(1.0)
    assert learner.diagnostics()["learning"] == "under way"


def test_a_finished_round_is_summarized(learner: Learner, rounds: list[FakeRound]) -> None:
    learner.learn_now()
    learner.work(0.0)
    kept = {"episodes": 30, "kind": "", "reason": "no better"}
    switched = {"episodes": 30, "kind": "rate", "reason": "the rate: from 1 to 0"}
    rounds[0].returned = {
        "made": "",
        "actions": {"s/a": kept, "s/a/success": switched, "s/a/heading": kept},
    }
    rounds[0].done = True
    assert learner.work(1.0) == "s/a: no better; s/a/success: the rate: from 1 to 0"
    values = learner.diagnostics()
    assert values["s/a: episodes"] == 30
    assert values["s/a: not switched"] == "no better"
    assert values["s/a/success: switched"] == "the rate: from 1 to 0"
    assert (values["set"], values["last switch"]) == ("that of the start", "never")


def test_a_result_that_does_not_fit_is_a_failure(learner: Learner, rounds: list[FakeRound]) -> None:
    take(learner, 12)
    learner.work(0.0)
    rounds[0].returned, rounds[0].done = {"made": 5}, True
    assert (learner.work(1.0) or "").startswith("learning failed: made: ")
    assert learner.new == 0


def test_taken_records_and_chains_are_counted(learner: Learner) -> None:
    take(learner, 3)
    learner.take_chain(gains.ChainGain(True, 0.5, 0.1))
    learner.work(0.0)
    values = learner.diagnostics()
    assert (values["records taken"], values["records stored"]) == (4, 3)
    assert (values["records left out"], values["records lost"]) == (0, 0)
    assert values["records since the last round"] == 3
    assert (values["frozen"], learner.problem) == (False, "")


def test_many_records_are_written_together(
    tmp_path: Path, learner: Learner, monkeypatch: pytest.MonkeyPatch
) -> None:
    appended: list[tuple[str, int]] = []
    append = RecordStore.append

    def counted(store: RecordStore, action_set: str, *taken: Episode) -> None:
        appended.append((action_set, len(taken)))
        append(store, action_set, *taken)

    monkeypatch.setattr(RecordStore, "append", counted)
    for action_set, count in (("default", 60), ("bezier", 30), ("default", 2)):
        for episode in episodes(count):
            learner.take(action_set, episode)
        learner.take_chain(gains.ChainGain(True, 0.5, 0.1))
    learner.close()
    assert appended == [("default", 60), ("bezier", 30), ("default", 2)]
    assert len(read_records(tmp_path / RECORDS, "default")) == 62
    assert len(gains.read_gains(tmp_path, learner.gains.models).chains) == 3
    assert (learner.stored, learner.lost) == (92, 0)
