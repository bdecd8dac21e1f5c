"""Parallel work where joblib starts no workers, as on one core."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import os, signal, time
from ator_ros.experience.parallel import run_tasks

before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
results = list(run_tasks(abs, [-1, -2], jobs=-1))
time.sleep(0.5)
assert results == [1, 2]
assert before == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
"""


def test_one_core_leaves_the_signals_alone_and_ends_well() -> None:
    environment = {**os.environ, "LOKY_MAX_CPU_COUNT": "1"}
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
