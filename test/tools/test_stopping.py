"""Work that is stopped: what was finished is kept."""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ator_ros.evaluation import running
from ator_ros.evaluation.report import write_report
from ator_ros.evaluation.running import PARTIAL, PartialResults, run_situations
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.tools import evaluate
from ator_ros.tools.command_line import INTERRUPTED, guarded


@pytest.fixture
def limit_files() -> Iterator[Callable[[int], None]]:
    """Yield a function that sets how large files may become in bytes, which needs no rights."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


def outcome(task: tuple[Settings, int]) -> Record:
    """Return what is kept of a situation, without executing it."""
    return {"index": task[1], "policies": {"naive": {"duration": 1.5}}, "note": "x" * 3000}


def at_once(function: Any, tasks: Iterable[Any], **options: Any) -> Iterator[Record]:
    return map(outcome, tasks)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_stop_a_command_as_ctrl_c_does(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(number)

    def work() -> int:
        os.kill(os.getpid(), number)
        time.sleep(5.0)
        return 0

    assert guarded("tool", work, interrupted="what was done is kept") == INTERRUPTED
    assert capsys.readouterr().err == "tool: interrupted; what was done is kept\n"
    assert signal.getsignal(number) is before


def test_an_error_of_several_lines_is_reported_in_one(capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> int:
        raise OSError("expected a file\n  got none\n\n  start again")

    assert guarded("tool", work) == 1
    assert capsys.readouterr().err == "tool: expected a file; got none; start again\n"


def test_a_write_that_fails_loses_no_situation(
    limit_files: Callable[[int], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(seed=1)

    def limiting(*args: Any, **options: Any) -> Iterator[Record]:
        for record in at_once(*args, **options):
            if record["index"] == 2:
                limit_files((tmp_path / PARTIAL).stat().st_size + 1000)
            yield record

    monkeypatch.setattr(running, "run_tasks", limiting)
    with pytest.raises(OSError, match="File too large"):
        run_situations(settings, situations=5, folder=tmp_path)
    limit_files(resource.RLIM_INFINITY)
    monkeypatch.setattr(running, "run_tasks", at_once)
    kept = PartialResults(tmp_path, settings, settings.source.digest(settings.policies, settings.chain))
    assert list(kept.records) == [0, 1]
    records = run_situations(settings, situations=5, folder=tmp_path)
    assert records == [outcome((settings, index)) for index in range(5)]


def test_two_evaluations_do_not_share_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first takes away the partial results at its very end, to which the other one would append."""
    words = ["--situations", "2", "--seed", "1", "--policies", "naive", "--oracle", "0", "--jobs", "1"]
    codes = []

    def report(*args: Any) -> Path:
        codes.append(evaluate.main([*words, "--out", str(tmp_path)]))
        return write_report(*args)

    monkeypatch.setattr(evaluate, "write_report", report)
    assert evaluate.main([*words, "--out", str(tmp_path)]) == 0
    assert codes == [1]
    assert "another command is writing there" in capsys.readouterr().err
