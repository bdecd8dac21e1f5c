"""Render the view's picture of the documentation: the last step of a race, in a headless Chromium.

Run by hand: ``scripts/run python test/nodes/picture_view.py docs/view.png``; check before committing.
"""

from __future__ import annotations

import argparse
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from free_port import free_port
from view.chromium import Chromium

_UNDER_WAY = r"refined, driven\s+\d+\.\d"
"""In the table of times: the first step of the refined chain has ended."""
_SETTLED = 3.0


@contextmanager
def own_view() -> Iterator[int]:
    """Start a view; yield its port."""
    port = free_port()
    command = [sys.executable, "-m", "ator_ros.tools.view", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        while "http" not in process.stdout.readline():
            assert process.poll() is None
        yield port
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0


def main() -> None:
    """Execute a race and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("picture", type=Path)
    options = parser.parse_args()
    with (
        own_view() as port,
        tempfile.TemporaryDirectory() as profile,
        Chromium(Path(profile), f"http://127.0.0.1:{port}") as browser,
    ):
        browser.until(lambda: "best, predicted" in browser.text(), "the panel")
        browser.press("Race")
        browser.until(lambda: re.search(_UNDER_WAY, browser.text()), "the refined chain's second step")
        browser.press("pause")
        browser.script(
            "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click())"
        )
        time.sleep(_SETTLED)
        options.picture.write_bytes(browser.picture())


if __name__ == "__main__":
    main()
