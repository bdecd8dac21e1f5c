"""Checks of what ROS needs from the machine: its own errors are long, or kill the process."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 (a file system, not a temporary file)
SHARED_MEMORY_NEEDED = 1_000_000
"""Bytes that a node's Fast DDS wants for its messages; where none are left a bus error kills the process."""
_NO_LOG_FILES = "--disable-external-lib-logs"


class MachineError(RuntimeError):
    """ROS cannot run here; the message is one line that says what to do."""


def check_machine(environment: Mapping[str, str], words: Sequence[str]) -> None:
    """Check that ROS can write its logs and Fast DDS its messages. Call this before ``rclpy.init``.

    Parameters
    ----------
    environment : mapping
        ``os.environ``.
    words : sequence of str
        The command line.

    Raises
    ------
    MachineError
        The folder of the logs is not writable, or shared memory is full.
    """
    if _NO_LOG_FILES not in words:
        _check_log_folder(log_folder(environment))
    if environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps"):
        check_shared_memory(SHARED_MEMORY)


def log_folder(environment: Mapping[str, str]) -> Path:
    """Return the folder that ROS writes its log files to.

    Raises
    ------
    MachineError
        No variable names one.
    """
    if chosen := environment.get("ROS_LOG_DIR"):
        return Path(chosen).expanduser()
    if home := environment.get("ROS_HOME"):
        return Path(home).expanduser() / "log"
    if home := environment.get("HOME"):
        return Path(home) / ".ros" / "log"
    raise MachineError("HOME is not set, where ROS keeps its log files: set HOME or ROS_LOG_DIR")


def _check_log_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # An empty file can be made on a full disk.
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(bytes(1000))
    except OSError as error:
        raise MachineError(
            f"ROS cannot keep its log files in {folder} ({os.strerror(error.errno or 0)}): "
            "free that disk, or set ROS_LOG_DIR"
        ) from error


def check_shared_memory(folder: Path) -> None:
    """Raise MachineError if shared memory is full."""
    if not folder.is_dir():
        return  # Fast DDS does without
    state = os.statvfs(folder)
    free = state.f_bavail * state.f_frsize
    if free < SHARED_MEMORY_NEEDED:
        raise MachineError(
            f"{folder} is full ({free // 1000} kB free, Fast DDS needs {SHARED_MEMORY_NEEDED // 1000} kB): "
            f"delete {folder}/fastrtps_* of nodes that have ended, or give it more memory"
        )
