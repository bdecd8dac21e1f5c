"""Without numba, which rosdep can't install everywhere, the same code gives the same numbers."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

from ator_ros import compiled
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.performance.compiled_geometry import wrapped
from ator_ros.performance.features import feature_table
from ator_ros.robot.description import load_robot

WITHOUT_NUMBA = """
import sys
sys.modules["numba"] = None
from ator_ros import compiled
assert not compiled.compiles()
import numpy as np
from test_compiled import table
np.save(sys.argv[1], table())
"""


def table() -> np.ndarray:
    """Return the ideal times of 40 random situations, half of them up to a ball."""
    rng = np.random.default_rng(11)
    direct = {name: rng.uniform(-3.0, 3.0, 40) for name in ("x", "y", "yaw", "xg", "yg", "yawg")}
    direct |= {"v": rng.uniform(0.0, 1.0, 40), "w": rng.uniform(-1.0, 1.0, 40)}
    direct |= {"speedg": rng.uniform(0.0, 0.5, 40), "hold": np.arange(40.0) % 2}
    names = ["drive_time", "drive_turn", "dribble_time", "turn_drive_turn"]
    return feature_table(direct, load_robot(), [SOCCER.known_features[name] for name in names])


def test_results_are_the_same_without_numba(tmp_path) -> None:
    assert compiled.compiles()
    file = tmp_path / "table.npy"
    command = [sys.executable, "-c", WITHOUT_NUMBA, str(file)]
    subprocess.run(command, check=True, env={"PYTHONPATH": ":".join(sys.path), "PATH": ""})
    assert np.load(file) == pytest.approx(table(), abs=1e-12)


def test_a_compiled_function_is_found_by_its_name_in_another_process() -> None:
    assert pickle.loads(pickle.dumps(wrapped)) is wrapped  # noqa: S301
    assert copy.deepcopy(wrapped) is wrapped
