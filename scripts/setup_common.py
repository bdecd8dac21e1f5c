"""Shared by the steps of setup_workspace.py. Needs only the standard library."""

from __future__ import annotations

import fcntl
import hashlib
import os
import signal
import time
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MARK = {"ATOR_ROS_SETUP": str(ROOT)}
"""Environment variable of programs that set-up starts; the next set-up kills those left over."""


class SetupError(Exception):
    """Set-up failed; the message is one line with what to do."""


def say(text: str) -> None:
    """Print a message; set-up is silent when there is nothing to do."""
    print(f"setup: {text}", flush=True)


def digest(files: Iterable[Path], *extra: str) -> str:
    """Return a digest of names and contents of `files` (below ROOT), and of `extra` words."""
    total = hashlib.sha256("\n".join(extra).encode())
    for file in sorted(files):
        total.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return total.hexdigest()


def write_atomically(file: Path, text: str) -> None:
    """Write a temporary file and rename it."""
    temporary = file.with_name(file.name + ".new")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, file)


def end_leftovers() -> None:
    """Kill programs that an earlier set-up of this checkout has started.

    If a set-up is killed, its pip or make keeps running and would write the same files as this
    set-up.
    """
    mark = "".join(f"{name}={value}\0" for name, value in MARK.items()).encode()
    for _ in range(100):
        left = []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                if mark in (process / "environ").read_bytes() and int(process.name) != os.getpid():
                    os.kill(int(process.name), signal.SIGKILL)
                    left.append(process)
            except OSError:  # the process is another user's, or has ended
                continue
        if not left:
            return
        time.sleep(0.05)


def take_turns(lock: int) -> None:
    """Wait until no other process sets up this checkout."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        say("waiting for another set-up of this checkout")
        fcntl.flock(lock, fcntl.LOCK_EX)
