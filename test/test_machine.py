"""What ROS needs of the machine: one line where it is missing, before ROS itself stumbles over it."""

from __future__ import annotations

import os
import subprocess
from collections import namedtuple
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from ator_ros.nodes import machine
from ator_ros.nodes.machine import MachineError, check_machine, check_shared_memory, log_folder
from ator_ros.nodes.parameters import Parameter, SetupError
from ator_ros.nodes.simulation_settings import parameters_for

Space = namedtuple("Space", ["f_bavail", "f_frsize"])


@pytest.mark.parametrize(
    ("environment", "folder"),
    [
        ({"HOME": "/h"}, "/h/.ros/log"),
        ({"HOME": "/h", "ROS_HOME": "/r"}, "/r/log"),
        ({"HOME": "/h", "ROS_HOME": "/r", "ROS_LOG_DIR": "/l"}, "/l"),
        ({"HOME": "/h", "ROS_HOME": "~/r"}, "/h/r/log"),
        ({"HOME": "/h", "ROS_LOG_DIR": "~/l"}, "/h/l"),
    ],
)
def test_the_log_folder_is_ros_s(
    environment: dict[str, str], folder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/h")
    assert log_folder(environment) == Path(folder)


def test_no_home_is_refused_unless_no_log_is_kept() -> None:
    with pytest.raises(MachineError, match="HOME is not set"):
        check_machine({}, [])
    check_machine({}, ["--ros-args", "--disable-external-lib-logs"])


def test_a_log_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(MachineError, match=r"log files in .*file/.ros/log \(Not a directory\)"):
        check_machine({"HOME": str(tmp_path / "file")}, [])
    check_machine({"HOME": str(tmp_path)}, [])


def test_full_shared_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_shared_memory(tmp_path / "none")
    monkeypatch.setattr(os, "statvfs", lambda _: Space(200, 4096))
    with pytest.raises(MachineError, match=r"is full \(819 kB free, Fast DDS needs 1000 kB\)"):
        check_shared_memory(tmp_path)
    monkeypatch.setattr(machine, "SHARED_MEMORY", tmp_path)
    environment = {"HOME": str(tmp_path)}
    with pytest.raises(MachineError, match="is full"):
        check_machine(environment, [])
    check_machine({**environment, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, [])


@pytest.mark.node
@pytest.mark.parametrize("full", ["home", "shared memory"])
def test_a_node_ends_with_one_line(full: str, tmp_path: Path) -> None:
    from ament_index_python.packages import get_package_prefix

    node = Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "refinement")
    environment = {**os.environ, "ROS_DOMAIN_ID": "79"}
    command = [str(node)]
    if full == "home":
        del environment["HOME"]
    else:
        fill = "mount -t tmpfs -o size=900k none /dev/shm || exit 77; exec "
        command = ["unshare", "--mount", "sh", "-c", f"{fill}{node}"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    if done.returncode == 77 or "unshare:" in done.stderr:
        pytest.skip("needs the right to mount a file system")
    assert done.returncode == 1
    assert done.stderr.startswith("refinement: ")
    assert done.stderr.count("\n") == 1
    assert {"home": "HOME is not set", "shared memory": "shm is full (9"}[full] in done.stderr


@pytest.mark.parametrize("value", [1e-12, 5e-4])
def test_a_time_that_hardly_passes_is_refused(value: float) -> None:
    factor: Parameter = next(p for p in parameters_for([]) if p.name == "real_time_factor")
    factor.read(0.0)
    factor.read(0.001)
    with pytest.raises(SetupError, match="real_time_factor: expected 0, or a number"):
        factor.read(value)
