"""A learning round runs in a process of low priority."""

from __future__ import annotations

import subprocess
import sys

from ator_ros.learning.process import NICE

PROGRAM = """
import os
from ator_ros.learning.process import lower_priority
lower_priority()
print(os.nice(0))
"""


def test_a_round_runs_at_a_low_priority() -> None:
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, check=True, capture_output=True, text=True, start_new_session=True)
    assert int(done.stdout) >= NICE
