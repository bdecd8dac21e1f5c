"""A signal while a program still imports its libraries."""

import signal
import subprocess
import time
from pathlib import Path

import pytest
from process import PATIENCE, environment, executable
from selection import few

from ator_ros.start import INTERRUPTED

PROGRAMS = {
    "executor": ([], (0,)),
    "pursuit_server": ([], (0,)),
    "view": (["--port", "18080"], (INTERRUPTED, 0)),
    "collect": (["--actions", "goToPose", "--jobs", "1", "--out"], (INTERRUPTED,)),
}
"""Arguments and exit codes of each program; a file follows the option --out."""


def handles_sigterm(pid: int) -> bool:
    """Return whether a process has a handler, which Python itself does not install."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    caught = int(status.partition("SigCgt:")[2].split()[0], base=16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@pytest.mark.parametrize("number", few([signal.SIGINT, signal.SIGTERM], signal.SIGINT))
@pytest.mark.parametrize("delay", few([0.0, 0.1, 0.3, 0.7, 1.5, 2.3], 0.3, 1.5))
@pytest.mark.parametrize("program", few(list(PROGRAMS), "executor", "collect"))
def test_a_signal_ends_a_program_that_starts_with_at_most_one_line(
    program: str, delay: float, number: signal.Signals, tmp_path: Path, domain: int
) -> None:
    words, codes = PROGRAMS[program]
    files = [str(tmp_path / "table.parquet")] if "--out" in words else []
    with subprocess.Popen(
        [executable(program), *words, *files],
        stderr=subprocess.PIPE,
        text=True,
        env=environment(domain),
    ) as process:
        end = time.monotonic() + PATIENCE
        while not handles_sigterm(process.pid):
            assert time.monotonic() < end
            time.sleep(0.001)
        time.sleep(delay)
        process.send_signal(number)
        error = process.communicate(timeout=PATIENCE)[1]
    assert process.returncode in codes, error
    assert "Traceback" not in error
    assert len([line for line in error.splitlines() if "compiles code" not in line]) <= 1
