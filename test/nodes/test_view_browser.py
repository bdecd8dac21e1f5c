"""The view's page in a headless Chromium, with the nodes that the view starts."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from view.chromium import Chromium, need_browser

pytestmark = [pytest.mark.node, pytest.mark.long]


@pytest.fixture(autouse=True)
def browser_is_there(request: pytest.FixtureRequest) -> None:
    need_browser(request)


@pytest.fixture
def view() -> Iterator[str]:
    """Yield the page's address."""
    command = [str(Path(get_package_prefix("ator_ros"), "lib", "ator_ros", "view")), "--port", "18231"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ})
    assert process.stdout is not None
    try:
        process.stdout.readline()
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address
        yield address[0]
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0


def test_the_page_runs_a_race(view: str, tmp_path: Path) -> None:
    profile = tmp_path / "profile"
    profile.mkdir()
    with Chromium(profile, view) as browser:
        browser.until(lambda: "Race" in browser.text() and "best, predicted" in browser.text(), "the panel")
        browser.press("Race")
        verdict = r"naive (\d+\.\d\d) s, refined (\d+\.\d\d) s: gain"
        browser.until(lambda: re.search(verdict, browser.text()), "two times")
        times = re.search(verdict, browser.text())
        assert times is not None
        assert 0.0 < float(times[2]) < float(times[1])

        browser.click("History")
        browser.until(lambda: "2 chains, 1 of them refined" in browser.text(), "the history")
        gain = re.search(r"same start: \+(\d+\.\d\d) s, mean of 1", browser.text())
        assert gain is not None
        assert float(gain[1]) == pytest.approx(float(times[1]) - float(times[2]), abs=0.011)
