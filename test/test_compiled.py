"""Machine code is kept while the code stays the same, and removed when it changes."""

import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ator_ros.compiled import code_digest

SOURCE = '''"""A module."""

import math

LIMIT = 2.0  # m
"""Greatest distance."""
TABLE = [1.0]
UNIT = 1.0


def half(x: float) -> float:
    """Return half of x."""
    return UNIT * x / 2.0


def root(x: float) -> float:
    """Return the root of half of x."""
    return math.sqrt(min(half(x), LIMIT))


def other(x: float) -> float:
    """Return x."""
    return 1.0 * x


TABLE[0] = 3.0
'''
NUMBERS = itertools.count()


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)


def digest(folder: Path, text: str) -> str:
    module = f"compiled_{next(NUMBERS)}"
    (folder / f"{module}.py").write_text(text, encoding="utf-8")
    return code_digest(module, "root")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"""A module."""', '"""Another text.\n\nOf three lines.\n"""'),
        ('"""Return half of x."""', '"""Return x / 2."""'),
        ('"""Greatest distance."""', '"""Greatest distance in m."""'),
        ("  # m", ""),
        ("UNIT * x / 2.0", "(\n        UNIT\n        * x / 2.0\n    )"),
        ("1.0 * x", "2.0 * x"),
        ("def other", "def another"),
    ],
)
def test_texts_layout_and_other_functions_keep_machine_code(
    tmp_path: Path, old: str, new: str
) -> None:
    assert digest(tmp_path, SOURCE.replace(old, new)) == digest(tmp_path, SOURCE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("min(half(x)", "min(half(2.0 * x)"),
        ("x / 2.0", "2.0 / x"),
        ("LIMIT = 2.0", "LIMIT = 3.0"),
        ("UNIT = 1.0", "UNIT = 2.0"),
        ("UNIT = 1.0", "from math import pi as UNIT"),
        ("import math", "import cmath as math"),
        ("TABLE[0] = 3.0", "TABLE[0] = 2.0"),
    ],
)
def test_what_a_function_refers_to_invalidates_machine_code(
    tmp_path: Path, old: str, new: str
) -> None:
    assert digest(tmp_path, SOURCE.replace(old, new)) != digest(tmp_path, SOURCE)


def test_machine_code_is_replaced_when_a_called_module_changes_and_only_then(
    tmp_path: Path,
) -> None:
    package = tmp_path / "ator_ros"
    sources = Path(__file__).resolve().parents[1] / "ator_ros"
    shutil.copytree(sources, package, ignore=shutil.ignore_patterns("__pycache__", "nodes", "view"))
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")
    } | {"PYTHONPATH": str(tmp_path)}
    call = (
        "import numpy; from ator_ros.bases.differential.turns import write_headings; "
        "write_headings(1.0, 1.0, 1.0, numpy.zeros((2, 16)))"
    )

    def machine_code() -> dict[Path, int]:
        command = [sys.executable, "-c", call]
        subprocess.run(command, env=environment, cwd=tmp_path, check=True, capture_output=True)
        return {file: file.stat().st_mtime_ns for file in package.rglob("*.nbc")}

    durations = package / "bases" / "differential" / "durations.py"
    text = durations.read_text(encoding="utf-8")
    called = text.index("def turn_parts")
    first = machine_code()
    assert first
    durations.write_text(f'"""A longer text.\n\n{text[3:]}\n\n_UNUSED = 1.0\n', encoding="utf-8")
    assert machine_code() == first
    changed = text[:called] + text[called:].replace("return ", "return 1.0 * ", 1)
    assert changed != text
    durations.write_text(changed, encoding="utf-8")
    second = machine_code()
    assert len(second) == len(first)
    assert not second.keys() & first.keys()
