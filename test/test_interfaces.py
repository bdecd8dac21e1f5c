"""Every field of the interfaces is documented."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "ator_interfaces"
FILES = sorted(file for kind in ("msg", "srv", "action") for file in FOLDER.glob(f"*/*.{kind}"))
UNITLESS = {"string", "bool", "uint8", "uint32", "string[]"}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_every_field_has_a_comment_and_numbers_have_a_unit(file: Path) -> None:
    above = ""
    for line in file.read_text(encoding="utf-8").splitlines():
        assert len(line) <= 100
        if line.startswith(" "):  # a comment goes on
            continue
        if line.startswith("#"):
            above += line
            continue
        if line.strip() in ("", "---"):
            above = ""
            continue
        field, _, comment = line.partition("#")
        assert comment.strip() or above, f"{file.name}: no comment on: {line}"
        if field.split()[0] not in UNITLESS and "float64" in field:
            unit = re.search(r"\b(m|s|rad|m/s|rad/s|unit|probability)\b", comment + above)
            assert unit, f"{file.name}: no unit for: {line}"
        above = ""
