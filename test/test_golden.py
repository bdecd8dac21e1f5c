"""What the product decides is as recorded in golden/; scripts/golden.py writes it."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from scripts.golden import PARTS, differences

GOLDEN = Path(__file__).parent / "golden"
FEW = {"refined": 5, "executed": 1, "planned": 5}
"""How many entries of each kind of part `make test` compares."""


def recorded(part: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads((GOLDEN / f"{part}.json").read_text(encoding="utf-8"))
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
