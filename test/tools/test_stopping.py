"""Work that is stopped: what was finished is kept."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from ator_ros.evaluation.report import write_report
from ator_ros.tools import evaluate
from ator_ros.tools.command_line import INTERRUPTED, guarded


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
