"""Every command line with odd files: it ends with a message of at most three lines and no output."""

from __future__ import annotations

import importlib
import os
import shutil
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import pytest
from experience_rows import synthetic_experience
from odd_files import odd_files
from selection import few

from ator_ros.experience.table import Experience, write_experience
from ator_ros.resources import resource_path

# Command lines that take a file, ODD, with its suffix; or that take a folder, FOLDER, with
# the name of a file in it.
CASES = [
    ("train ODD --models out", ".parquet"),
    ("train ODD --models out", ".mcap"),
    ("train --rules ODD", ".json"),
    ("gate --episodes ODD --models models --work out", ".parquet"),
    ("collect --robot ODD --episodes 1 --out out.parquet", ".yaml"),
    ("evaluate --robot ODD --out out", ".yaml"),
    ("calibrate --robot ODD --out out", ".yaml"),
    ("study --robot ODD --out out", ".yaml"),
    ("view --robot ODD", ".yaml"),
    ("collect --domain ODD --episodes 1 --out out.parquet", ".yaml"),
    ("plan --domain ODD", ".yaml"),
    ("demo --domain ODD --out out", ".yaml"),
    ("evaluate --models FOLDER --out out", "goToPose.json"),
    ("plan ball_in_goal --object ball 1 0 --models FOLDER", "goToPose.json"),
    ("study --out FOLDER", "settings.json"),
    ("train FOLDER --models out", "metadata.yaml"),
    ("train FOLDER --models out", "store.json"),
]
QUICK = [*CASES[:2], *(case for case in CASES if case[0].startswith(("collect", "plan ball_in_goal")))]
"""Commands of the default suite, one for each kind of file."""


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
    """Return the fault in the end of a command, or None."""
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
    """Return a working folder with a valid table and valid models."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    write_experience(work / "good.parquet", Experience(synthetic_experience("goToPose", episodes=30), {}))
    shutil.copytree(resource_path("models"), work / "models", ignore=shutil.ignore_patterns("tour"))
    return work


@pytest.mark.parametrize("case", few(CASES, *QUICK), ids=lambda case: case[0])
def test_an_odd_file_ends_a_command_with_a_short_message(
    case: tuple[str, str], place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line, name = case
    in_folder, found = "FOLDER" in line, []
    suffix = Path(name).suffix if in_folder else name
    files = odd_files(tmp_path / "odd", suffix, lambda each: each != "a gate" or not in_folder)
    for number, odd in enumerate(files):
        folder = place / f"folder {number}"
        if in_folder and os.path.lexists(odd):  # a missing file is valid
            shutil.copytree(place / "models", folder) if "--models FOLDER" in line else folder.mkdir()
            (folder / name).unlink(missing_ok=True)
            odd.rename(folder / name)
        elif in_folder:
            continue
        given = {"ODD": str(odd), "FOLDER": str(folder)}
        found.append(faults([given.get(word, word) for word in line.split()], odd, place, capsys))
        shutil.rmtree(folder, ignore_errors=True)
    assert not [fault for fault in found if fault]
