"""Every command line against odd files: it ends with a message of at most three lines, and writes nothing."""

from __future__ import annotations

import contextlib
import importlib
import os
import shutil
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import pytest
from experience_rows import made_up_experience
from odd_files import odd_files
from selection import few

from ator_ros.experience.table import Experience, write_experience
from ator_ros.resources import resource_path

# Where a command line takes a file: the words, with ODD for it, and the suffix by which it is known.
ANYWHERE = {
    "train": (["train", "ODD", "--models", "out"], ".parquet"),
    "train recording": (["train", "ODD", "--models", "out"], ".mcap"),
    "train --rules": (["train", "--rules", "ODD"], ".json"),
    "gate --episodes": (["gate", "--episodes", "ODD", "--models", "models", "--work", "out"], ".parquet"),
    "collect --robot": (["collect", "--robot", "ODD", "--episodes", "1", "--out", "out.parquet"], ".yaml"),
    "evaluate --robot": (["evaluate", "--robot", "ODD", "--out", "out"], ".yaml"),
    "calibrate --robot": (["calibrate", "--robot", "ODD", "--out", "out"], ".yaml"),
    "study --robot": (["study", "--robot", "ODD", "--out", "out"], ".yaml"),
    "view --robot": (["view", "--robot", "ODD"], ".yaml"),
    "collect --domain": (["collect", "--domain", "ODD", "--episodes", "1", "--out", "out.parquet"], ".yaml"),
    "plan --domain": (["plan", "--domain", "ODD"], ".yaml"),
    "demo --domain": (["demo", "--domain", "ODD", "--out", "out"], ".yaml"),
}
# The odd file lies in a folder that the command reads, under the name that it looks for.
INSIDE = {
    "a model for evaluate": (["evaluate", "--models", "FOLDER", "--out", "out"], "goToPose.json"),
    "a calibration for evaluate": (["evaluate", "--models", "FOLDER", "--out", "out"], "calibration.json"),
    "a gate for plan": (
        ["plan", "ball_in_goal", "--object", "ball", "1", "0", "--models", "FOLDER"],
        "gate.json",
    ),
    "an evaluation for calibrate_predictions": (["calibrate_predictions", "FOLDER"], "evaluation.json"),
    "settings for study": (["study", "--out", "FOLDER"], "settings.json"),
    "a recording for train": (["train", "FOLDER", "--models", "out"], "metadata.yaml"),
    "a store for train": (["train", "FOLDER", "--models", "out"], "store.json"),
}


def run(words: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Run a command line in this process; return its exit code and what it printed to stderr."""
    tool = importlib.import_module(f"ator_ros.tools.{words[0]}")
    capsys.readouterr()
    with warnings.catch_warnings():
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
        code, output = run(words, capsys)
    except Exception as error:
        return f"{odd.name!r}: {type(error).__name__}: {str(error)[:300]}"
    took = time.monotonic() - began
    lines = [line for line in output.splitlines() if not line.startswith(("usage: ", " "))]
    if code == 0:
        return f"{odd.name!r}: exit code 0: {output[:300]}"
    if not 1 <= len(lines) <= 3 or "Traceback" in output or (not output.isprintable() and "\x1b" in output):
        return f"{odd.name!r}: {len(lines)} lines: {output[:500]}"
    if len(output) > 1500:
        return f"{odd.name!r}: {len(output)} characters: {output[:500]}"
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


QUICK = ("train", "train recording", "collect --robot", "collect --domain", "a gate for plan")
"""Commands that are tried each time, one for each kind of file."""


@pytest.mark.parametrize("name", few(ANYWHERE, *QUICK))
def test_an_odd_file_ends_a_command_with_a_short_message(
    name: str, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, suffix = ANYWHERE[name]
    found = []
    for odd in odd_files(tmp_path / "odd", suffix):
        own = [word.replace("ODD", str(odd)) for word in words]
        found.append(faults(own, odd, place, capsys))
    assert not [fault for fault in found if fault]


@pytest.mark.parametrize("name", few(INSIDE, *QUICK))
def test_an_odd_file_in_a_folder_ends_a_command_with_a_short_message(
    name: str, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, wanted = INSIDE[name]
    found = []
    files = odd_files(tmp_path / "odd", Path(wanted).suffix, lambda each: each != "a gate")
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
