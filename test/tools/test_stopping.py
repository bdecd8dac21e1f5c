"""Signals and errors during a command."""

from __future__ import annotations

import os
import signal
import time

import pytest

from ator_ros.tools.command_line import INTERRUPTED, guarded


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_stop_a_command_like_ctrl_c(
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
