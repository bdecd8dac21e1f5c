"""The pages "Life of a tick" and "Life of a request" name the functions that are called, in order.

A step of these pages names functions as `Class.method` in `folder/file.py`.
"""

import contextlib
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest
from chain_client import ChainClient, call
from conftest import Host
from moving_base import MovingBase
from refinement_requests import refine, request_of_the_paper
from ros_client import Client

import ator_ros
from ator_ros.geometry import Pose

CLIENT = {"silent": True}
DOCS = Path(__file__).resolve().parents[2] / "docs"
PACKAGE = f"{Path(ator_ros.__file__).resolve().parent}/"
FUNCTION = re.compile(r"`([\w.]+)`\s+in\s+`([\w/]+\.py)`")
LEAST = 15
"""Functions that each page names at least."""


def functions(page: str) -> list[str]:
    """Return the functions that a page names, in order, as FILE: NAME."""
    found = FUNCTION.findall((DOCS / page).read_text(encoding="utf-8"))
    return [f"{file}: {name}" for name, file in found]


class Calls:
    """The functions of the package that are called within each call of one of them, in order."""

    def __init__(self, outermost: str) -> None:
        self._outermost = outermost
        self._is_within = False
        self.found: list[list[str]] = []

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """Take an event of a profiled thread."""
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(PACKAGE):
            return
        name = f"{code.co_filename.removeprefix(PACKAGE)}: {code.co_qualname}"
        if name == self._outermost:
            self._is_within = event == "call"
            if self._is_within:
                self.found.append([])
        if self._is_within and event == "call":
            self.found[-1].append(name)

    def missing(self, page: list[str]) -> list[str]:
        """Return the functions of a page that no call reaches in order: the fewest of all calls."""
        return min(
            (_missing(page, iter(calls)) for calls in list(self.found)), key=len, default=page
        )


def _missing(page: list[str], calls: Iterator[str]) -> list[str]:
    return next((page[number:] for number, name in enumerate(page) if name not in calls), [])


@pytest.fixture
def traced() -> Iterator[Callable[[str], Calls]]:
    """Yield a function that records calls in threads which start later."""

    def trace(outermost: str) -> Calls:
        calls = Calls(outermost)
        threading.setprofile(calls)
        return calls

    yield trace
    threading.setprofile(None)


def test_a_tick_calls_the_functions_of_its_page_in_order(
    host: Host, client: Client, traced: Callable[[str], Calls]
) -> None:
    page = functions("life_of_a_tick.md")
    calls = traced(page[0])
    host("executor", odom_timeout=10.0)
    base = MovingBase(client)
    base.set_pace(0.2)  # tracing makes ticks slow
    ChainClient(client, None).send([call("goToPose", Pose(1.0, 0.5, 0.0))])
    with contextlib.suppress(AssertionError):  # the comparison shows what is missing
        client.eventually(lambda: not calls.missing(page), "a tick as on the page")
    assert calls.missing(page) == []
    assert len(page) >= LEAST


def test_a_request_calls_the_functions_of_its_page_in_order(
    host: Host, client: Client, traced: Callable[[str], Calls]
) -> None:
    page = functions("life_of_a_request.md")
    calls = traced(page[0])
    host("refinement", deadline=20.0)
    assert refine(client, request_of_the_paper()).accepted
    assert calls.missing(page) == []
    assert len(page) >= LEAST
