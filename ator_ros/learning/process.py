"""A round of learning in a process of low priority; its parent publishes the result."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

NICE = 15
_LONGEST = 2000  # characters of the message of a process that failed
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


class RoundProcess:
    """A round of learning under way; the arguments are parameters of the node, `grid` is its map."""

    def __init__(self, folder: Path, *, domain: str, robot: str, models: str, grid: str, time: str) -> None:
        arguments = json.dumps([str(folder), domain, robot, models, grid, time])
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ator_ros.learning.process", arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=os.environ | _ONE_THREAD,
            start_new_session=True,  # Ctrl-C goes to the node only, which ends this process
        )

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def result(self) -> dict[str, Any]:
        """Return what `learn` returned, once done, or {"failed": why}."""
        out, err = self._process.communicate()
        if self._process.returncode == 0:
            result: dict[str, Any] = json.loads(out)
            return result
        last = err.decode(errors="replace").strip().rpartition("\n")[2]
        return {"failed": (last or f"it ended with {self._process.returncode}")[:_LONGEST]}

    def kill(self) -> None:
        """End the process; its result is not published."""
        self._process.kill()
        self._process.communicate()


def main() -> None:
    """Execute one round at the lowest priority, and write its result to standard output."""
    os.nice(NICE)
    with suppress(OSError):  # Linux weighs sessions before processes, and this process has its own session
        Path("/proc/self/autogroup").write_text(str(NICE), encoding="ascii")
    from ator_ros.domains.domain import domain_for
    from ator_ros.learning.round import Source, learn

    folder, name, robot, models, grid, time = json.loads(sys.argv[1])
    domain = domain_for(name, robot).on_map(grid)
    place = Path(models) if models else domain.shipped_models
    source = Source(Path(folder), domain, domain.robot(robot or None), place)
    sys.stdout.write(json.dumps(learn(source, time=time), allow_nan=False))


if __name__ == "__main__":
    main()
