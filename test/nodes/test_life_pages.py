"""The pages that follow a tick and a request name the files in the order in which they run."""

import itertools
import re
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType

import pytest
from chain_client import ChainClient, call
from conftest import Host
from documentation import ROOT
from moving_base import MovingBase
from ros_client import Client

from ator_interfaces.msg import ObjectState
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose

PACKAGE = ROOT / "ator_ros"
CLIENT = {"silent": True}


class Entered:
    """The files of the package whose functions are called, in order, while `recording`."""

    def __init__(self) -> None:
        self.recording = False
        self.files: list[str] = []
        self._names: dict[str, str] = {}

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if self.recording and event == "call":
            name = self._name(frame.f_code.co_filename)
            if name and name != (self.files or [""])[-1]:
                self.files.append(name)

    def _name(self, file: str) -> str:
        if file not in self._names:
            path = Path(file).resolve()
            inside = path.is_relative_to(PACKAGE)
            self._names[file] = path.relative_to(PACKAGE).as_posix() if inside else ""
        return self._names[file]


@pytest.fixture
def entered() -> Iterator[Entered]:
    """Yield what the threads that are started from now on enter."""
    found = Entered()
    former = threading.getprofile()
    threading.setprofile(found)
    yield found
    threading.setprofile(former)
    assert sys.getprofile() is None


def steps_of(page: str) -> list[list[str]]:
    """Return the files that each numbered step of a page names."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    steps = re.split(r"^\d+\. ", text, flags=re.MULTILINE)[1:]
    return [re.findall(r"`((?:\w+/)+\w+\.py)`", step) for step in steps]


def check(page: str, entered: Sequence[str]) -> None:
    """Check that the files of a page are entered, and the first ones of its steps in this order."""
    steps = steps_of(page)
    assert {name for step in steps for name in step} <= set(entered)
    latest = -1
    named: set[str] = set()
    for number, (first, *_) in enumerate(steps, start=1):
        place = entered.index(first)
        if first in named:  # a file to which the last steps return
            place = len(entered) - 1 - entered[::-1].index(first)
        assert place > latest, f"{page}: step {number}: {first} is entered before the step above"
        latest = place
        named.add(first)


def test_a_tick_enters_the_files_of_its_page(entered: Entered, host: Host, client: Client) -> None:
    host("executor")
    base = MovingBase(client)
    sent = ChainClient(client).send([call("goToPose", Pose(2.0, 0.0, 0.0))])
    client.eventually(lambda: base.pose.x > 0.3, "the robot drives")
    entered.recording = True
    driven = base.received
    client.eventually(lambda: base.received > driven + 5, "further commands")
    entered.recording = False
    sent.cancel()
    sent.outcome()
    files = entered.files
    received = [
        place
        for place, pair in enumerate(itertools.pairwise(files))
        if pair == ("nodes/inputs.py", "world/messages.py")
    ]
    assert len(received) > 2
    check("life_of_a_tick.md", files[received[1] : received[2]])


def test_a_request_enters_the_files_of_its_page(
    entered: Entered, host: Host, client: Client
) -> None:
    host("refinement")
    request = RefineSubgoal.Request()
    request.situation.robot.position.x = -2.0
    request.situation.objects = [ObjectState(name="ball")]
    request.chain.calls = [
        call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)),
        call("dribbleBall", Pose(0.0, 2.0, 1.57)),
    ]
    entered.recording = True
    answer = client.call(RefineSubgoal, "refine_subgoal", request)
    entered.recording = False
    assert answer.accepted, answer.reason
    check("life_of_a_request.md", entered.files)
