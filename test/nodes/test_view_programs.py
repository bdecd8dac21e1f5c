"""The programs beside the tests that measure the view and make its picture."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from documentation import ROOT
from view.chromium import need_browser

pytestmark = [pytest.mark.node, pytest.mark.long]


def run(*words: str) -> str:
    command = ["scripts/run", "python", *words]
    return subprocess.run(
        command, cwd=ROOT, check=True, timeout=900, stdout=subprocess.PIPE, text=True
    ).stdout


def test_a_drag_is_followed_and_the_page_takes_little_of_a_core() -> None:
    told = run("test/nodes/measure_view.py", "--seconds", "5")
    followed = re.search(r"followed (\d+\.\d) times/s", told)
    assert followed
    assert float(followed[1]) > 2.0  # also where other tests run; docs/view.md has what it is otherwise


def test_a_view_does_not_slow_the_nodes() -> None:
    told = run("test/nodes/measure_nodes.py", "--seconds", "3", "--chains", "1", "--records", "500")
    found = re.findall(r"^(.+?) *: (\d+\.\d) ms, 99 % .*; 99 % of .*: \d+\.\d$", told, re.MULTILINE)
    assert [name for name, _ in found][-2:] == ["while it learns", "without again"]
    alone, seen, again, *_ = (float(middle) for _, middle in found)
    assert seen < 2.0 * max(alone, again)  # 1.0 on an idle machine, docs/view.md


def test_a_picture_of_a_race_is_made(request: pytest.FixtureRequest, tmp_path: Path) -> None:
    need_browser(request)
    run("test/nodes/picture_view.py", str(tmp_path / "view.png"))
    assert (tmp_path / "view.png").read_bytes().startswith(b"\x89PNG")
