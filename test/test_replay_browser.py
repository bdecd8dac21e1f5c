"""A recording, played by the installed `view` in a headless Chromium."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="needs viser: docs/install.md")

from chain_recording import write_recording, x_at
from chromium import Chromium, need_browser
from free_port import free_port
from view_camera import canvas_of, red_around, seen_at

from ator_ros.domains.soccer.domain import SOCCER

pytestmark = pytest.mark.long
ROBOT = SOCCER.robot()


@pytest.fixture(autouse=True)
def browser_is_there(request: pytest.FixtureRequest) -> None:
    need_browser(request)


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """Yield the address of the page of a recording."""
    recording = write_recording(tmp_path / "bag")
    command = [sys.executable, "-m", "ator_ros.tools.view", str(recording), "--port", str(free_port())]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found
        yield found[0]
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0


def seconds_of(browser: Chromium) -> float:
    found = re.search(r"(\d+\.\d\d) s of 8\.00 s", browser.text())
    assert found
    return float(found[1])


def test_a_recording_is_played_in_the_browser(address: str, tmp_path: Path) -> None:
    profile = tmp_path / "profile"
    profile.mkdir()
    with Chromium(profile, address) as browser:
        browser.until(lambda: "Chain 1 of 1, refined" in browser.text(), "the chain")
        browser.until(lambda: "8.00 s of 8.00 s (paused)" in browser.text(), "the end")
        assert re.search(r"difference\s+-0\.20\s+0\.50\s+0\.30", browser.text())
        assert "gains {0.50} s (succeeded)" in browser.text()
        canvas = canvas_of(browser)
        begin, end = (seen_at(ROBOT, (x_at(stamp), 0.0, 0.1), canvas) for stamp in (0.0, 8.0))
        browser.until(lambda: red_around(browser.picture(), end) > 0.02, "the robot at the end")
        assert red_around(browser.picture(), begin) == 0.0

        browser.press("back")
        browser.until(lambda: seconds_of(browser) == 0.0, "the begin")
        browser.until(lambda: "1 is to come" in browser.text(), "no chain yet")
        browser.until(lambda: red_around(browser.picture(), begin) > 0.02, "the robot at the begin")

        browser.press("next")
        browser.until(lambda: seconds_of(browser) == 1.0, "the begin of the chain")
        slide(browser, 0.5)
        browser.until(lambda: 3.0 < seconds_of(browser) < 5.0, "the time of the slider")
        browser.press("play")
        browser.press("pause")
        browser.until(lambda: "(paused)" in browser.text(), "a pause")
        browser.click("History")
        browser.until(lambda: "1 chains, 1 of them refined" in browser.text(), "the history")


def slide(browser: Chromium, share: float) -> None:
    """Drag the slider's thumb to a share of its length."""
    box = "(() => {const r = document.querySelector('.mantine-Slider-trackContainer, .mantine-Slider-track')"
    left, top, width, height = browser.script(
        f"{box}.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]}})()"
    )
    middle = top + height / 2.0
    browser.drag((left + 0.1 * width, middle), (left + share * width, middle))
