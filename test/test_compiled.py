"""Compiled functions."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

WRAP = "from ator_ros.performance.derived import wrapped; print(wrapped(7.0))"


@pytest.mark.long
def test_functions_run_without_a_writable_cache_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    nowhere = str(tmp_path / "file" / "folder")
    environment = {**os.environ, "NUMBA_CACHE_DIR": nowhere, "HOME": nowhere, "XDG_CACHE_HOME": nowhere}
    done = subprocess.run([sys.executable, "-c", WRAP], env=environment, capture_output=True, check=True)
    assert float(done.stdout) == pytest.approx(7.0 - 2.0 * np.pi)
