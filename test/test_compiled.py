"""Machine code is kept while the code stays the same, and removed when it changes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ator_ros.compiled import code_digest

SOURCE = '''"""A module."""

LIMIT = 2.0  # m
"""Greatest distance."""


def double(x: float) -> float:
    """Return twice x."""
    return 2.0 * x
'''


def digest(folder: Path, text: str) -> str:
    file = folder / "module.py"
    file.write_text(text, encoding="utf-8")
    return code_digest([file])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"""A module."""', '"""Another text.\n\nOf three lines.\n"""'),
        ('"""Greatest distance."""', '"""Greatest distance in m."""'),
        ("  # m", ""),
        ("2.0 * x", "(\n        2.0\n        * x\n    )"),
    ],
)
def test_texts_and_layout_are_not_code(tmp_path: Path, old: str, new: str) -> None:
    assert digest(tmp_path, SOURCE.replace(old, new)) == digest(tmp_path, SOURCE)


@pytest.mark.parametrize(("old", "new"), [("2.0  #", "3.0  #"), ("2.0 * x", "x * 2.0")])
def test_numbers_and_operations_are_code(tmp_path: Path, old: str, new: str) -> None:
    assert digest(tmp_path, SOURCE.replace(old, new)) != digest(tmp_path, SOURCE)


def test_a_docstring_compiles_nothing_again_and_new_code_replaces_the_former(
    tmp_path: Path,
) -> None:
    package = tmp_path / "ator_ros"
    sources = Path(__file__).resolve().parents[1] / "ator_ros"
    shutil.copytree(sources, package, ignore=shutil.ignore_patterns("__pycache__", "nodes", "view"))
    durations = package / "motion" / "durations.py"
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

    first = machine_code()
    assert first
    text = durations.read_text(encoding="utf-8")
    durations.write_text(f'"""A longer text.\n\n{text[3:]}', encoding="utf-8")
    assert machine_code() == first
    durations.write_text(f"{text}\n\n_UNUSED = 1.0\n", encoding="utf-8")
    assert not machine_code().keys() & first.keys()
