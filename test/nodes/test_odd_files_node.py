"""Every node against odd files and names: it ends with one line, or reports the file and keeps running."""

from __future__ import annotations

import gc
import importlib
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from odd_files import odd_files

from ator_ros.nodes.network import PROFILES
from ator_ros.resources import resource_path

NODES = ("executor", "refinement", "simulation", "learning", "goal_pose")
FEW = ("json of another kind", "a zip", "yaml tab")
NO_PARAMETERS = ("empty", "json null")
"""YAML files without content: parameter files in which everything is commented out."""
_PATIENCE = 1.0  # s after which a node that keeps running is stopped; it is stopped once it has started


@dataclass(frozen=True)
class End:
    """How a node ended; code 0 means that it ran until it was stopped."""

    code: int
    said: str

    def fault(self, *, ends: bool) -> str | None:
        """Return what is wrong with the end; None if nothing. `ends`: whether it must end by itself."""
        lines = self.said.splitlines()
        if ends == (self.code == 0):
            return f"exit code {self.code}: {self.said[:500]}"
        if "Traceback" in self.said or "\x1b" in self.said:
            return f"unfit for a terminal: {self.said[:500]}"
        if max(map(len, lines), default=0) > 1500 or (ends and not 1 <= len(lines) <= 3):
            return f"{len(lines)} lines, {len(self.said)} characters: {self.said[:500]}"
        return None


Run = Callable[..., End]


@pytest.fixture
def run(domain: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Iterator[Run]:
    """Return a function that runs an executable's `main` in this process, and stops it where it starts."""
    signals = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv("RCUTILS_COLORIZED_OUTPUT", "0")
    monkeypatch.setenv(PROFILES, "")  # the node sets it; after the test it is as before

    def run(name: str, *words: str) -> End:
        place = "examples" if name == "drive_to_server" else "nodes"
        node = importlib.import_module(f"ator_ros.{place}.{name}")
        capfd.readouterr()
        stop = threading.Timer(_PATIENCE, os.kill, (os.getpid(), signal.SIGTERM))
        stop.start()
        code: Any = 0
        try:
            node.main([name, "--ros-args", *words])
        except SystemExit as ended:
            code = ended.code
        finally:
            stop.cancel()
            stop.join()
            gc.unfreeze()
            gc.collect()  # a node that was not made leaves its handles
        said = "".join(capfd.readouterr())
        return End(1, f"{said}{code}") if isinstance(code, str) else End(code, said)

    yield run
    for number, handler in signals.items():
        signal.signal(number, handler)


def few_or_all(everything: bool) -> Callable[[str], bool]:
    return lambda name: everything or name in FEW


def as_words(parameter: str, file: Path) -> list[str]:
    """Return ROS arguments that name a file."""
    if parameter == "--params-file":
        return [parameter, str(file)]
    value = f"['{file}']" if parameter == "descriptions" else f"'{file}'"
    return ["-p", f"{parameter}:={value}"]


UNUSABLE = {
    **{f"{node} {parameter}": (node, parameter) for node in NODES for parameter in ("robot", "domain")},
    **{f"{node} --params-file": (node, "--params-file") for node in NODES},
    "simulation descriptions": ("simulation", "descriptions"),
    "learning learned": ("learning", "learned"),
}
"""Node and parameter whose value is an odd file, with which the node cannot run."""
BESIDE = {
    "executor models": ("executor", "models"),
    "refinement models": ("refinement", "models"),
    "learning models": ("learning", "models"),
    "executor learned": ("executor", "learned"),
    "refinement learned": ("refinement", "learned"),
}
"""The same where a file is left out and reported, and the node keeps running."""
INSIDE = {
    "executor model": ("executor", "models", "goToPose.json"),
    "executor calibration": ("executor", "models", "calibration.json"),
    "refinement model": ("refinement", "models", "goToPose.json"),
    "refinement gate": ("refinement", "models", "gate.json"),
    "refinement calibration": ("refinement", "models", "calibration.json"),
    "refinement learned set": ("refinement", "learned", "current"),
    "refinement learned manifest": ("refinement", "learned", "current/manifest.json"),
    "learning model": ("learning", "models", "goToPose.json"),
    "learning sets": ("learning", "learned", "sets"),
}
"""Node, its folder, and the name of the odd file in it."""
INSIDE_UNUSABLE = {
    "learning store": ("learning", "learned", "records/store.json"),
    "learning records": ("learning", "learned", "records"),
}
QUICK = (
    "executor robot",
    "refinement domain",
    "goal_pose --params-file",
    "learning learned",
    "refinement gate",
)


def few_and_all(*tables: dict[str, Any]) -> list[Any]:
    """Return name and extent of each test: few files for quick ones, all for all."""
    names = [name for table in tables for name in table]
    few = [pytest.param(name, False, id=f"{name}, few") for name in names if name in QUICK]
    return few + [pytest.param(name, True, id=name, marks=pytest.mark.long) for name in names]


def usable(parameter: str, file: Path) -> bool:
    """Return whether a node can use an odd file."""
    if parameter == "--params-file":
        return file.stem in NO_PARAMETERS
    if parameter == "learned":  # the folder is made
        return len(file.name) < 255 and (file.is_dir() or not os.path.lexists(file))
    return False


@pytest.mark.parametrize(("name", "everything"), few_and_all(UNUSABLE, BESIDE))
def test_an_odd_file_ends_a_node_or_is_reported(
    name: str, everything: bool, tmp_path: Path, run: Run
) -> None:
    node, parameter = (UNUSABLE | BESIDE)[name]
    found = []
    for file in odd_files(tmp_path / "odd", ".yaml", few_or_all(everything)):
        words = as_words(parameter, file)
        if "\x1b" in file.name and parameter != "--params-file":
            continue  # rcl takes no such text
        ends = name in UNUSABLE and not usable(parameter, file)
        if fault := run(node, *words).fault(ends=ends):
            found.append(f"{file.name!r}: {fault}")
    assert not found


@pytest.mark.parametrize(("name", "everything"), few_and_all(INSIDE, INSIDE_UNUSABLE))
def test_an_odd_file_in_a_folder_ends_a_node_or_is_reported(
    name: str, everything: bool, tmp_path: Path, run: Run
) -> None:
    node, parameter, inside = (INSIDE | INSIDE_UNUSABLE)[name]
    found = []
    for number, odd in enumerate(odd_files(tmp_path / "odd", ".json", few_or_all(everything))):
        folder = tmp_path / f"folder {number}"
        if not os.path.lexists(odd) or (inside == "gate.json" and odd.stem == "a gate"):
            continue
        if parameter == "models":
            shutil.copytree(resource_path("models"), folder, ignore=shutil.ignore_patterns("tour"))
        (folder / inside).parent.mkdir(parents=True, exist_ok=True)
        (folder / inside).unlink(missing_ok=True)
        odd.rename(folder / inside)
        replaced = name == "learning store" and odd.stem in ("dangling", "loop")
        replaced = replaced or (name == "learning records" and odd.stem == "folder")
        ends = name in INSIDE_UNUSABLE and not replaced
        end = run(node, *as_words(parameter, folder))
        if fault := end.fault(ends=ends):
            found.append(f"{odd.name!r}: {fault}")
        elif not ends and inside.endswith(".json") and "WARN" not in end.said:
            found.append(f"{odd.name!r}: not reported: {end.said[:500]}")
    assert not found


NAMES = (
    ("executor", "frame", "odd frame"),
    ("executor", "frame", "x" * 5000),
    ("executor", "frame", "''"),
    ("executor", "robot_frame", "/"),
    ("executor", "robot_from", "gps"),
    ("simulation", "robots", "['a b']"),
    ("simulation", "robots", "[a, a]"),
    ("simulation", "robots", f"['{'x' * 5000}']"),
    ("simulation", "frame", "''"),
    ("refinement", "frame", "''"),
    ("learning", "records", "['']"),
    ("learning", "records", f"['{'x' * 5000}']"),
    ("learning", "records", "['a//b']"),
    ("goal_pose", "frame", "''"),
    ("drive_to_server", "v", "fast"),
    ("drive_to_server", "v", "-1.0"),
    ("drive_to_server", "v", ".nan"),
    ("drive_to_server", "time_limit", "5"),
)


@pytest.mark.parametrize(("node", "parameter", "value"), NAMES)
def test_an_odd_name_ends_a_node_with_one_line(node: str, parameter: str, value: str, run: Run) -> None:
    end = run(node, "-p", f"{parameter}:={value}")
    assert end.fault(ends=True) is None


def test_a_pipe_as_lock_ends_learning(tmp_path: Path, run: Run) -> None:
    os.mkfifo(tmp_path / "lock")
    assert run("learning", "-p", f"learned:={tmp_path}").fault(ends=True) is None
