"""A headless Chromium, controlled over its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import pytest

EXECUTABLE = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
WIDTH, HEIGHT = 1280, 800
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    f"--window-size={WIDTH},{HEIGHT}",
)


def need_browser(request: pytest.FixtureRequest) -> None:
    """Without a browser, fail in `make test-long` and skip otherwise."""
    if EXECUTABLE is not None:
        return
    missing = "needs Chromium: apt install chromium"
    if request.config.getoption("markexpr") == "long":
        pytest.fail(missing)
    pytest.skip(missing)


class Chromium:
    """One tab that shows `url`, with an empty folder for its profile; a context manager."""

    def __init__(self, folder: Path, url: str, *, patience: float = 120.0) -> None:
        assert EXECUTABLE is not None
        self.patience = patience
        self._numbers = itertools.count(1)
        words = [EXECUTABLE, *_OPTIONS, f"--user-data-dir={folder}", url]
        self._process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port_file = folder / "DevToolsActivePort"
        self.until(lambda: port_file.is_file() and len(port_file.read_text().split()) == 2, "Chromium's port")
        self._connect(port_file.read_text().split()[0], url)

    def _connect(self, port: str, url: str) -> None:
        import urllib.request

        from websockets.sync.client import connect

        def tab() -> str | None:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                tabs = json.load(answer)
            found = (t["webSocketDebuggerUrl"] for t in tabs if t["type"] == "page" and url in t["url"])
            return next(found, None)

        self.until(lambda: tab() is not None, "the tab")
        self._socket = connect(str(tab()), max_size=None)

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the DevTools protocol."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=self.patience))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    def script(self, text: str) -> Any:
        """Evaluate JavaScript and return its value."""
        return self.call("Runtime.evaluate", expression=text, returnByValue=True)["result"].get("value")

    def text(self) -> str:
        """Return the text of the page."""
        return str(self.script("document.body ? document.body.innerText : ''"))

    def press(self, label: str) -> None:
        """Click the button whose text starts with `label`."""
        buttons = "[...document.querySelectorAll('button')]"
        find = f"{buttons}.find(b => b.innerText.trim().startsWith({json.dumps(label)}))"
        self.until(lambda: self.script(f"!!{find}"), f"the button {label}")
        self.script(f"{find}.click()")

    def click(self, text: str) -> None:
        """Click the element with exactly this text, such as a tab."""
        find = (
            f"(() => {{const leaf = [...document.querySelectorAll('*')].find(e => !e.childElementCount "
            f"&& e.textContent.trim() === {json.dumps(text)}); if (!leaf) return null;"
            "const r = leaf.getBoundingClientRect(); return [r.left + r.width / 2, r.top + r.height / 2]})()"
        )
        self.until(lambda: self.script(find), text)
        place = self.script(find)
        for kind, buttons in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 1)):
            self._mouse(kind, (place[0], place[1]), buttons)

    def _mouse(self, kind: str, place: tuple[float, float], buttons: int) -> None:
        self.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=place[0],
            y=place[1],
            buttons=buttons,
            button="left" if kind != "mouseMoved" or buttons else "none",
            clickCount=0 if kind == "mouseMoved" else 1,
        )

    def picture(self) -> bytes:
        """Return a screenshot as PNG data."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def until(self, happened: Callable[[], Any], what: str) -> None:
        """Wait until a condition holds."""
        end = time.monotonic() + self.patience
        while not happened():
            assert time.monotonic() < end, f"expected {what} within {self.patience:g} s"
            time.sleep(0.1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(timeout=10)
