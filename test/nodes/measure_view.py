"""Measure the view at real time with one client: its share of a core, and how often a drag is followed.

By hand: ``scripts/run python test/nodes/measure_view.py``; see docs/view.md.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from free_port import free_port
from view.viser_client import ViserClient

_BALL = "/objects/ball/body"
_RING = "/chain/ring0"
_DRAGS_PER_SECOND = 50


@contextmanager
def own_view(*words: str) -> Iterator[tuple[subprocess.Popen[str], int, int]]:
    """Start a view; yield its process, its port and the ROS domain of its nodes."""
    port = free_port()
    command = [sys.executable, "-m", "ator_ros.tools.view", "--port", str(port), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        domain = re.search(r"domain (\d+)", process.stdout.readline())
        assert domain
        assert "http" in process.stdout.readline()
        yield process, port, int(domain[1])
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0


def spent(number: int) -> float:
    """Return the processor time in s that a process has taken."""
    fields = Path(f"/proc/{number}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def share(number: int, seconds: float) -> float:
    """Return what a process takes of a core, in %."""
    before, began = spent(number), time.monotonic()
    time.sleep(seconds)
    return 100.0 * (spent(number) - before) / (time.monotonic() - began)


def drags(client: ViserClient, seconds: float) -> float:
    """Drag the ball in a circle; return how often a second the ring of a new answer was drawn."""
    client.drag(_BALL, 1.0, 0.0, "start")
    drawn, began = client.drawn[_RING], time.monotonic()
    while (now := time.monotonic() - began) < seconds:
        client.drag(_BALL, math.cos(now), math.sin(now))
        time.sleep(1.0 / _DRAGS_PER_SECOND)
    client.drag(_BALL, 1.0, 0.0, "end")
    return (client.drawn[_RING] - drawn) / now


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement (default: 20)")
    seconds = parser.parse_args().seconds
    with own_view() as (process, port, _):
        client = ViserClient(port)
        client.look()
        client.until(lambda: client.drawn[_RING], "the first ring")
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", flush=True)
        print(f"robot standing: {share(process.pid, seconds):.1f} % of a core", flush=True)
        client.set("Play refined", value=True)
        client.until(lambda: "/trails/refined" in client.scene, "the trail")
        print(f"chain executed: {share(process.pid, min(seconds, 8.0)):.1f} % of a core", flush=True)
        client.set("Seed", 1)  # another situation ends the chain
        client.until(lambda: "drag robot" in client.text(), "the end of the chain")
        client.until(lambda: _RING in client.scene, "the ring")
        before, began = spent(process.pid), time.monotonic()
        followed = drags(client, seconds)
        taken = 100.0 * (spent(process.pid) - before) / (time.monotonic() - began)
        print(f"ball dragged: followed {followed:.1f} times/s, {taken:.1f} % of a core", flush=True)
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", flush=True)
        client.close()


if __name__ == "__main__":
    main()
