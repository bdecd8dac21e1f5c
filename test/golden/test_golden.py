"""What the product decides is as recorded beside this file; scripts/golden.py writes it."""

import itertools
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from scripts.golden import PARTS, differences

GOLDEN = Path(__file__).parent
FEW = {"refined": 5, "executed": 1, "planned": 5}
"""How many entries of each kind of part `make test` compares."""


def recorded(part: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads(
        (GOLDEN / f"{part}.json").read_text(encoding="utf-8")
    )
    return entries


def test_all_parts_are_recorded() -> None:
    assert sorted(file.stem for file in GOLDEN.glob("*.json")) == sorted(PARTS)


@pytest.mark.parametrize("part", [part for part in PARTS if part != "trained"])
def test_the_first_decisions_are_as_recorded(part: str) -> None:
    count = FEW[part.split("_")[0]]
    found = PARTS[part][0](count)
    assert list(itertools.islice(differences(recorded(part)[:count], found), 5)) == []


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_all_decisions_are_as_recorded(part: str) -> None:
    record, count = PARTS[part]
    assert list(itertools.islice(differences(recorded(part), record(count)), 5)) == []


@pytest.mark.long
def test_the_command_writes_and_compares(tmp_path: Path) -> None:
    script = Path(__file__).parents[2] / "scripts" / "golden.py"
    for folder in ("one", "two"):
        words = [
            sys.executable,
            str(script),
            "write",
            str(tmp_path / folder),
            "planned",
            "--digits",
            "8",
        ]
        assert subprocess.run(words, check=False).returncode == 0
    words = [sys.executable, str(script), "compare", str(tmp_path / "one"), str(tmp_path / "two")]
    assert subprocess.run(words, check=False).returncode == 0
    (tmp_path / "two" / "planned.json").write_text("[]")
    assert subprocess.run(words, check=False).returncode == 1
