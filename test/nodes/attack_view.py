"""Ill-treat a view: clients that vanish, fast drags, nonsense in fields, everything pressed at once.

By hand: ``scripts/run python test/nodes/attack_view.py``; it fails where the page does not answer any more.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from measure_view import own_view
from viser_client import ViserClient

_BALL, _ROBOT, _KNOB, _GOAL = "/objects/ball/body", "/start/body", "/start/knob", "/goals/1/body"
_CHAIN = "/chain/naive/legs"
_NONSENSE = (None, "", "x" * 100_000, "\x00{}<script>`", -1, 1e400, float("nan"), 2**62, [], {}, True, [1, 2])
_FIELDS = (
    "Chain", "Seed", "Number", "Actions", "duration", "accuracy (s per m)", "1. goToBall: yaw", "Speed",
    "Time", "2. dribbleBall: speed", "Play naive", "Keep this chain as an alternative", "Random situation",
)  # fmt: skip
_GONE = (OSError, AssertionError, EOFError)


class Attack:
    """Ill-treats the page at a port."""

    def __init__(self, port: int, rng: random.Random) -> None:
        self._port, self._rng = port, rng

    def _joined(self) -> ViserClient:
        client = ViserClient(self._port)
        client.look()
        client.until(lambda: "Seed" in client.fields, "the panel")
        return client

    def vanishing(self) -> None:
        """Let clients come and vanish, some while they drag."""
        for number in range(5):
            client = self._joined()
            if number % 2:
                client.drag(_BALL, 0.5, 0.5, "start")
            client.vanish()

    def dragging(self) -> None:
        """Drag everything at 100 Hz, also off the floor, with two clients."""
        clients = [self._joined(), self._joined()]
        for number in range(200):
            for client, node in zip(
                clients, self._rng.choices((_BALL, _ROBOT, _KNOB, _GOAL), k=2), strict=True
            ):
                client.drag(
                    node, self._rng.uniform(-9, 9), self._rng.uniform(-9, 9), "update" if number else "start"
                )
            time.sleep(0.01)
        for client in clients:
            client.close()

    def nonsense(self) -> None:
        """Enter what no browser would."""
        for label in _FIELDS:
            client = self._joined()
            with contextlib.suppress(*_GONE):  # a client that is no browser may be cut off
                client.set(label, self._rng.choice(_NONSENSE))
                client.drag(_BALL, float("nan"), 1e300)
                client.send("NoSuchMessage", value=1)
                client.close()

    def pressing(self) -> None:
        """Press everything at once."""
        client = self._joined()
        for _ in range(30):
            client.set(
                self._rng.choice(("Play naive", "Play refined", "Race: naive, then refined")), value=True
            )
            client.set("Time", self._rng.choice(("pause", "go on", "back")))
            client.drag(_BALL, self._rng.uniform(-2, 2), self._rng.uniform(-2, 2))
            time.sleep(0.02)
        client.close()

    def check(self, process: subprocess.Popen[str]) -> None:
        """Make sure that a new client is served, and that a drag is followed."""
        assert process.poll() is None, "the view has ended"
        client = self._joined()
        client.patience = 40.0
        client.set("Time", "back")
        client.set("Chain", "dribble")
        seed = self._rng.randrange(2**20)
        client.set("Seed", seed)
        client.until(lambda: "drag robot" in client.text(), f"a situation; {client.text()[:200]}")
        time.sleep(1.0)
        drawn = client.drawn[_CHAIN]
        client.drag(_BALL, 0.0, 0.0, "start")
        client.drag(_BALL, 0.2, 0.1)
        with contextlib.suppress(AssertionError):
            client.until(lambda: client.drawn[_CHAIN] > drawn, "a chain")
        assert client.drawn[_CHAIN] > drawn, f"expected a chain that follows, got {client.text()}"
        client.close()


def main() -> None:
    """Attack until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with own_view() as (process, port, _):
        attack = Attack(port, random.Random(options.seed))
        ways: tuple[Callable[[], None], ...] = (
            attack.vanishing, attack.dragging, attack.nonsense, attack.pressing,
        )  # fmt: skip
        end, number = time.monotonic() + options.seconds, 0
        while number < len(ways) or time.monotonic() < end:
            way = ways[number % len(ways)]
            began = time.monotonic()
            way()
            attack.check(process)
            print(f"{way.__name__}: went on after {time.monotonic() - began:.1f} s", flush=True)
            number += 1
        threads = len(list(Path(f"/proc/{process.pid}/task").iterdir()))
        print(f"{threads} threads", flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main()
