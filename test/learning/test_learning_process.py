"""A round of learning runs in a process that gives way to everything else."""

from __future__ import annotations

import subprocess
import sys

from ator_ros.learning.process import NICE

_TELL = "import os; from ator_ros.learning.process import _give_way; _give_way(); print(os.nice(0))"


def _told(more: str = "") -> str:
    command = [sys.executable, "-c", _TELL + more]
    return subprocess.run(command, check=True, capture_output=True, text=True, start_new_session=True).stdout


def test_it_is_nice() -> None:
    assert int(_told()) >= NICE
