"""Every command line against odd files: it ends with a message of at most three lines, and writes nothing."""

from __future__ import annotations

import contextlib
import importlib
import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest
from experience_rows import made_up_experience
from odd_files import odd_files

from ator_ros.experience.table import Experience, write_experience
from ator_ros.resources import resource_path
from ator_ros.tools.guard import stopped_by_signals

# Where a command line takes a file: the words, with ODD for it, and the suffix by which it is known.
TABLES = {
    "train": ["train", "ODD", "--models", "out"],
    "train --fresh": ["train", "good.parquet", "--fresh", "ODD", "--models", "out"],
    "evaluate --experience": ["evaluate", "--experience", "ODD", "--out", "out"],
    "gate --experience": ["gate", "--experience", "ODD", "--models", "models", "--work", "out"],
    "gate --episodes": ["gate", "--episodes", "ODD", "--models", "models", "--work", "out"],
}
RECORDINGS = {
    "train recording": ["train", "ODD", "--models", "out"],
}
ROBOTS = {
    "collect --robot": ["collect", "--robot", "ODD", "--episodes", "1", "--out", "out.parquet"],
    "train --robot": ["train", "good.parquet", "--robot", "ODD", "--models", "out"],
    "gate --robot": ["gate", "--robot", "ODD", "--models", "models", "--work", "out"],
    "evaluate --robot": ["evaluate", "--robot", "ODD", "--out", "out"],
    "calibrate --robot": ["calibrate", "--robot", "ODD", "--out", "out"],
    "study --robot": ["study", "--robot", "ODD", "--out", "out"],
    "plan --robot": ["plan", "ball_in_goal", "--robot", "ODD"],
    "view --robot": ["view", "--robot", "ODD"],
    "demo --robot": ["demo", "--robot", "ODD", "--out", "out"],
    "compare --robot": ["compare", "--robot", "ODD", "--out", "out"],
    "qualify --robot": ["qualify", "--robot", "ODD", "--out", "out"],
    "noise --robot": ["noise", "--robot", "ODD", "--out", "out"],
    "calibrate_predictions --robot": ["calibrate_predictions", "missing", "--robot", "ODD"],
}
DOMAINS = {
    "collect --domain": ["collect", "--domain", "ODD", "--episodes", "1", "--out", "out.parquet"],
    "train --domain": ["train", "good.parquet", "--domain", "ODD", "--models", "out"],
    "gate --domain": ["gate", "--domain", "ODD", "--models", "models", "--work", "out"],
    "evaluate --domain": ["evaluate", "--domain", "ODD", "--out", "out"],
    "study --domain": ["study", "--domain", "ODD", "--out", "out"],
    "plan --domain": ["plan", "--domain", "ODD"],
    "view --domain": ["view", "--domain", "ODD"],
    "demo --domain": ["demo", "--domain", "ODD", "--out", "out"],
    "compare --domain": ["compare", "--domain", "ODD", "--out", "out"],
    "qualify --domain": ["qualify", "--domain", "ODD", "--out", "out"],
    "noise --domain": ["noise", "--domain", "ODD", "--out", "out"],
    "soak --domain": ["soak", "--domain", "ODD", "--out", "out"],
}
# The odd file lies in a folder that the command reads, under the name that it looks for.
INSIDE = {
    "a model for evaluate": (["evaluate", "--models", "FOLDER", "--out", "out"], "goToPose.json"),
    "a gate for evaluate": (["evaluate", "--models", "FOLDER", "--out", "out"], "gate.json"),
    "a calibration for evaluate": (["evaluate", "--models", "FOLDER", "--out", "out"], "calibration.json"),
    "a model for gate": (["gate", "--models", "FOLDER", "--work", "out"], "goToPose.json"),
    "a gate for gate": (["gate", "--models", "FOLDER", "--work", "out"], "gate.json"),
    "a model for plan": (
        ["plan", "ball_in_goal", "--object", "ball", "1", "0", "--models", "FOLDER"],
        "goToPose.json",
    ),
    "a gate for plan": (
        ["plan", "ball_in_goal", "--object", "ball", "1", "0", "--models", "FOLDER"],
        "gate.json",
    ),
    "a model for compare": (["compare", "--models", "FOLDER", "--out", "out"], "goToPose.json"),
    "a model for noise": (["noise", "--models", "FOLDER", "--out", "out"], "goToPose.json"),
    "a model for train --fresh": (
        ["train", "--fresh", "good.parquet", "--models", "FOLDER"],
        "goToPose.json",
    ),
    "a model for train --report": (["train", "--report", "out", "--models", "FOLDER"], "goToPose.json"),
    "an evaluation for calibrate_predictions": (["calibrate_predictions", "FOLDER"], "evaluation.json"),
    "an evaluation for evaluate --again": (
        ["evaluate", "--out", "FOLDER", "--again", "naive", "--policies", "naive"],
        "evaluation.json",
    ),
    "settings for study": (["study", "--out", "FOLDER"], "settings.json"),
    "a recording for train": (["train", "FOLDER", "--models", "out"], "metadata.yaml"),
    "a store for train": (["train", "FOLDER", "--models", "out"], "store.json"),
}
ANYWHERE = {
    **{name: (words, ".parquet") for name, words in TABLES.items()},
    **{name: (words, ".mcap") for name, words in RECORDINGS.items()},
    **{name: (words, ".yaml") for name, words in (ROBOTS | DOMAINS).items()},
    "train --rules": (["train", "--rules", "ODD"], ".json"),
}
FEW = ("empty", "noise", "json of another kind", "yaml tab", "a table without reason", "a zip")


def run(words: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Run a command line in this process; return its exit code and what it printed to stderr."""
    tool = importlib.import_module(f"ator_ros.tools.{words[0]}")
    capsys.readouterr()
    with warnings.catch_warnings(), stopped_by_signals():
        try:
            code = tool.main(list(words[1:]))
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
    return code, capsys.readouterr().err


def faults(words: Sequence[str], odd: Path, place: Path, capsys: pytest.CaptureFixture[str]) -> str | None:
    """Return what is wrong with how a command ends; None if nothing."""
    before = sorted(str(file) for file in place.rglob("*"))
    began = time.monotonic()
    try:
        code, told = run(words, capsys)
    except Exception as error:
        return f"{odd.name!r}: {type(error).__name__}: {str(error)[:300]}"
    took = time.monotonic() - began
    lines = [line for line in told.splitlines() if not line.startswith(("usage: ", " "))]
    if code == 0:
        return f"{odd.name!r}: exit code 0: {told[:300]}"
    if not 1 <= len(lines) <= 3 or "Traceback" in told or (not told.isprintable() and "\x1b" in told):
        return f"{odd.name!r}: {len(lines)} lines: {told[:500]}"
    if len(told) > 1500:
        return f"{odd.name!r}: {len(told)} characters: {told[:500]}"
    made = [file for file in place.rglob("*") if str(file) not in before and file.is_file()]
    if made:
        return f"{odd.name!r}: wrote {made}"
    return None if took < 30.0 else f"{odd.name!r}: took {took:.0f} s"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working folder with a good table and good models."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    write_experience(work / "good.parquet", Experience(made_up_experience("goToPose", episodes=30), {}))
    shutil.copytree(resource_path("models"), work / "models", ignore=shutil.ignore_patterns("tour"))
    return work


def few_or_all(everything: bool) -> Callable[[str], bool]:
    return lambda name: everything or name in FEW


QUICK = ("train", "train recording", "collect --robot", "collect --domain", "a gate for plan")
"""Commands that are tried with a few files each time, one for each kind of file."""


def few_and_all(names: Iterable[str]) -> list[Any]:
    """Return name and extent of each test: few files for quick commands, all for all."""
    few = [pytest.param(name, False, id=f"{name}, few") for name in names if name in QUICK]
    return few + [pytest.param(name, True, id=name, marks=pytest.mark.long) for name in names]


@pytest.mark.parametrize(("name", "everything"), few_and_all(ANYWHERE))
def test_an_odd_file_ends_a_command_with_a_short_message(
    name: str, everything: bool, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, suffix = ANYWHERE[name]
    found = []
    for odd in odd_files(tmp_path / "odd", suffix, few_or_all(everything)):
        own = [word.replace("ODD", str(odd)) for word in words]
        found.append(faults(own, odd, place, capsys))
    assert not [fault for fault in found if fault]


@pytest.mark.parametrize(("name", "everything"), few_and_all(INSIDE))
def test_an_odd_file_in_a_folder_ends_a_command_with_a_short_message(
    name: str, everything: bool, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, wanted = INSIDE[name]
    found = []
    fits = few_or_all(everything)
    files = odd_files(tmp_path / "odd", Path(wanted).suffix, lambda each: fits(each) and each != "a gate")
    for number, odd in enumerate(files):
        folder = place / f"folder {number}"
        shutil.copytree(place / "models", folder) if "--models" in words else folder.mkdir()
        (folder / wanted).unlink(missing_ok=True)
        if not os.path.lexists(odd):
            continue  # without the file there is nothing wrong
        odd.rename(folder / wanted)
        own = [word.replace("FOLDER", str(folder)) for word in words]
        found.append(faults(own, odd, place, capsys))
        with contextlib.suppress(OSError):
            shutil.rmtree(folder)
    assert not [fault for fault in found if fault]
