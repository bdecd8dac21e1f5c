"""Starts the programs, with one thread for linear algebra each; signals end them from then on.

Each of them is a console script (`setup.py`), or is started by a launch file:

    python3 -m ator_ros.start commands.launch urdf ROBOT_FILE
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

# Matrices here are small. With a thread for each core a node takes twice the CPU time to start.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
INTERRUPTED = 130
"""The exit code of a tool after Ctrl-C or SIGTERM."""


class Programs:
    """The modules of a package with a function `main`, as attributes.

    A signal that comes before `main` has its own handlers ends the program with the exit code
    `interrupted`. A signal that is ignored remains so.
    """

    def __init__(self, package: str, interrupted: int) -> None:
        self._package = package
        self._interrupted = interrupted

    def __getattr__(self, module: str) -> Callable[[], Any]:
        """Return a function that imports a module and runs its `main`."""

        def run() -> Any:
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) is not signal.SIG_IGN:
                    # an import may replace an exception by another, or print it and go on
                    signal.signal(number, lambda *_: os._exit(self._interrupted))
            for name in _ONE_THREAD:
                os.environ.setdefault(name, "1")
            return import_module(f"{self._package}.{module}").main()

        return run


nodes = Programs("ator_ros.nodes", 0)
commands = Programs("ator_ros.nodes", INTERRUPTED)
tools = Programs("ator_ros.tools", INTERRUPTED)
examples = Programs("ator_ros_examples", 0)

if __name__ == "__main__":
    group, _, name = sys.argv.pop(1).partition(".")
    sys.exit(getattr(globals()[group], name)())
