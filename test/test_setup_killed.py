"""`make setup`, killed at any moment: the next call ends what was left at work, and succeeds."""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
MADE = (
    ".git",
    ".venv",
    ".venv-*",
    "build",
    "install",
    "log",
    "out",
    "__pycache__",
    ".*_cache",
    ".hypothesis",
)
BUILDS = [
    ("colcon", signal.SIGTERM),
    ("cmake", signal.SIGKILL),
    ("cc1", signal.SIGKILL),
    ("make", signal.SIGTERM),
    ("setup_workspace.py", signal.SIGKILL),
    ("colcon", signal.SIGKILL),
    ("setup_workspace.py", signal.SIGTERM),
]
ENVIRONMENT = [
    ("-m venv", signal.SIGKILL),
    ("-m pip", signal.SIGTERM),
    ("setup_workspace.py", signal.SIGKILL),
    ("-m pip", signal.SIGKILL),
]
PATIENCE = 1200.0  # s; what takes 10 s on an idle machine took 9 minutes on a busy one


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a copy of this checkout that is set up as far as its virtual environment."""
    copy = tmp_path / "checkout"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*MADE))
    shutil.copytree(ROOT / ".venv", copy / ".venv", symlinks=True, copy_function=os.link)
    stamp = copy / ".venv" / "stamp.json"
    found = json.loads(stamp.read_text(encoding="utf-8"))
    stamp.unlink()  # it is a link to ours
    stamp.write_text(json.dumps({**found, "root": str(copy)}), encoding="utf-8")
    return copy


def started(checkout: Path) -> subprocess.Popen[bytes]:
    log = (checkout / "setup.log").open("ab")
    own = {name: value for name, value in os.environ.items() if name in ("HOME", "LANG")}
    own["PATH"] = os.pathsep.join(p for p in os.environ["PATH"].split(os.pathsep) if str(ROOT) not in p)
    own |= {
        name: value for name, value in os.environ.items() if name.startswith(("PIP_", "SSL_", "CC", "CXX"))
    }
    with log:
        return subprocess.Popen(["make", "setup"], cwd=checkout, env=own, stdout=log, stderr=log)


def processes(checkout: Path, word: str) -> list[int]:
    """Find the programs with `word` in their command line that a set-up of `checkout` has started."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            command = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            environment = (process / "environ").read_bytes()
            marked = f"ATOR_ROS_SETUP={checkout}\0".encode() in environment
            here = (process / "cwd").readlink() == checkout
            if word in command and (marked or (word == "setup_workspace.py" and here)):
                found.append(int(process.name))
    return found


def kill_when_there(checkout: Path, word: str, number: signal.Signals) -> None:
    setup = started(checkout)
    deadline = time.monotonic() + PATIENCE
    while not (found := processes(checkout, word)):
        assert setup.poll() is None, (checkout / "setup.log").read_text(encoding="utf-8")[-2000:]
        assert time.monotonic() < deadline
        time.sleep(0.01)
    if word == "setup_workspace.py":
        time.sleep(1.0)  # it has begun something
    # Also those that come after: a set-up goes on without a compiler that only checked what there is.
    while setup.poll() is None and time.monotonic() < deadline:
        for process in found:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, number)
        time.sleep(0.01)
        found = processes(checkout, word)
    assert setup.wait(1.0) != 0


@pytest.mark.long
@pytest.mark.parametrize("moments", [BUILDS, ENVIRONMENT], ids=["builds", "environment"])
def test_a_killed_set_up_works_when_repeated(
    checkout: Path, moments: list[tuple[str, signal.Signals]]
) -> None:
    if moments is ENVIRONMENT:
        (checkout / ".venv" / "stamp.json").unlink()
    for word, number in moments:
        kill_when_there(checkout, word, number)
    setup = started(checkout)
    assert setup.wait(2 * PATIENCE) == 0, (checkout / "setup.log").read_text(encoding="utf-8")[-5000:]
    assert processes(checkout, "") == []
    command = [str(checkout / "scripts" / "run"), "install/lib/ator_ros/train", "--help"]
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    imports = "import ator_interfaces.srv, ator_ros; ator_interfaces.srv.RefineSubgoal.Request()"
    command = [str(checkout / "scripts" / "run"), "python", "-c", imports]
    subprocess.run(command, cwd=checkout, check=True)


@pytest.fixture
def common() -> ModuleType:
    """Return the module scripts/setup_common.py."""
    spec = importlib.util.spec_from_file_location("setup_common", ROOT / "scripts" / "setup_common.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_a_killed_set_up_left_at_work_is_ended(
    common: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(common.MARK, "ATOR_ROS_SETUP", str(tmp_path))
    sleep = [sys.executable, "-c", "import subprocess; subprocess.run(['sleep', '60'])"]
    left = subprocess.Popen(sleep, env={**os.environ, **common.MARK})
    other = subprocess.Popen(["sleep", "60"], env={**os.environ, "ATOR_ROS_SETUP": f"{tmp_path}-other"})
    try:
        time.sleep(0.5)
        common.end_leftovers()
        assert left.wait(5.0) == -signal.SIGKILL
        assert other.poll() is None
        assert processes(tmp_path, "sleep") == []
    finally:
        for process in (left, other):
            process.kill()
            process.wait()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_set_up_that_only_waits_ends_nothing_of_the_other(number: signal.Signals, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    lock = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)  # the other holds it, and has this at work
    other = subprocess.Popen(["sleep", "60"], env={**os.environ, "ATOR_ROS_SETUP": str(tmp_path)})
    command = [sys.executable, str(tmp_path / "scripts" / "setup_workspace.py")]
    waiting = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert waiting.stdout is not None
        assert "waiting for another set-up" in waiting.stdout.readline()
        time.sleep(0.2)
        waiting.send_signal(number)
        assert "interrupted while it waited" in waiting.communicate(timeout=20.0)[1]
        assert waiting.returncode == 130
        assert other.poll() is None
    finally:
        os.close(lock)
        for process in (waiting, other):
            process.kill()
            process.wait()


def test_every_package_is_locked_with_hashes() -> None:
    lines = (ROOT / "requirements" / "constraints.txt").read_text(encoding="utf-8").splitlines()[1:]
    pins = [line for line in lines if not line.startswith("    --hash=sha256:")]
    assert all("==" in pin and pin.endswith(" \\") for pin in pins)
    assert "://" not in "".join(line for line in lines)
    locked = {pin.split("==")[0]: pin.split("==")[1].split()[0] for pin in pins}
    for name in ("ros", "build", "runtime", "offline", "view", "test", "lint"):
        for line in (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").splitlines():
            if "==" in line and not line.startswith("#"):
                package, version = line.strip().split("==")
                assert locked[package.split("[")[0].lower()] == version
