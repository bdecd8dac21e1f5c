"""Make the picture of the view in the documentation: the second half of a race, in a headless Chromium.

By hand: ``scripts/run python test/nodes/picture_view.py docs/view.png``; look at it before it is committed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from chromium import Chromium
from measure_view import own_view

_UNDER_WAY = 7.0
"""Real s after which the refined chain is half driven."""


def main() -> None:
    """Drive a race and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--wait", type=float, default=_UNDER_WAY, help="s after the refined chain's begin")
    options = parser.parse_args()
    with (
        own_view() as (_, port, _),
        tempfile.TemporaryDirectory() as profile,
        Chromium(Path(profile), f"http://127.0.0.1:{port}") as browser,
    ):
        browser.until(lambda: "best, predicted" in browser.text(), "the panel")
        browser.press("Race")
        browser.until(lambda: "refined, driven" in browser.text(), "the second chain")
        time.sleep(options.wait)
        options.picture.write_bytes(browser.picture())


if __name__ == "__main__":
    main()
