"""A round of learning runs in a process that gives way to everything else."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ator_ros.learning.process import NICE

_AUTOGROUP = Path("/proc/self/autogroup")
_TELL = "import os; from ator_ros.learning.process import _give_way; _give_way(); print(os.nice(0))"


def _told(more: str = "") -> str:
    command = [sys.executable, "-c", _TELL + more]
    return subprocess.run(command, check=True, capture_output=True, text=True, start_new_session=True).stdout


def test_it_is_nice() -> None:
    assert int(_told()) >= NICE


@pytest.mark.skipif(not _AUTOGROUP.exists(), reason="the kernel does not weigh sessions")
def test_its_session_is_nice_as_well() -> None:
    assert f"nice {NICE}" in _told(f"; print(open('{_AUTOGROUP}').read())")
