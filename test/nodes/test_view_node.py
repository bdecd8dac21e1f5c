"""The command `view`, with the nodes that it starts and a client of its page."""

import re
import signal
import subprocess
from collections.abc import Iterator

import pytest

pytest.importorskip("viser", reason="needs viser: docs/install.md")

from process import executable
from view.viser_client import ViserClient, free_port

pytestmark = [pytest.mark.node, pytest.mark.long]


@pytest.fixture
def page() -> Iterator[ViserClient]:
    port = free_port()
    command = [executable("view"), "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        process.stdout.readline()
        assert f":{port} in a browser" in process.stdout.readline()
        client = ViserClient(port)
        client.patience = 120.0
        yield client
        client.close()
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0


def test_the_page_runs_a_race(page: ViserClient) -> None:
    page.until(lambda: "best, predicted" in page.text(), "the panel")
    page.press("Race: naive, then refined")
    verdict = r"naive (\d+\.\d\d) s, refined (\d+\.\d\d) s: gain"
    page.until(lambda: re.search(verdict, page.text()), "two times")
    times = re.search(verdict, page.text())
    assert 0.0 < float(times[2]) < float(times[1])
    page.until(lambda: "2 chains, 1 of them refined" in page.text(), "the history")
    gain = re.search(r"same start: \+(\d+\.\d\d) s, mean of 1", page.text())
    assert float(gain[1]) == pytest.approx(float(times[1]) - float(times[2]), abs=0.011)
