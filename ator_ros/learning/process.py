"""A round of learning in a process of low priority; its parent publishes the result."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

from ator_ros.printable import quoted

_LONGEST = 2000  # characters of the message of a process that failed


class RoundProcess:
    """A running round of learning, in a process that runs `module` with a JSON object as argument.

    The object has the `settings`, and the number of this process as `parent`.
    """

    def __init__(self, module: str, settings: Mapping[str, str]) -> None:
        argument = json.dumps({**settings, "parent": str(os.getpid())})
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, argument],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
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
            try:
                result: dict[str, Any] = json.loads(out)
            except ValueError:
                return {"failed": f"expected its result as JSON, got {quoted(out[:100])}"}
            return result
        last = err.decode(errors="replace").strip().rpartition("\n")[2]
        return {"failed": (last or f"it ended with {self._process.returncode}")[:_LONGEST]}

    def kill(self) -> None:
        """End the process; its result is not published."""
        self._process.kill()
        self._process.communicate()
