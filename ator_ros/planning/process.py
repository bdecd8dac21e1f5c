"""Planning in a process of its own: a node neither waits for it nor imports what it needs.

The process reads requests from standard input and writes answers to standard output, a line of JSON each. It
is started by the first request. One that takes too long is killed, whatever it is doing.
"""

from __future__ import annotations

import dataclasses
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from ator_ros.execution.fence import Fence
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.exchange import Json, asked, chain_from, read, written
from ator_ros.planning.wanted import Wish
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

_STARTING = 60.0
"""Real time in s that the process may take to start."""
_LARGEST = 1_000_000
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


class PlanProcess:
    """The process that plans for one domain and robot; one request at a time.

    Parameters
    ----------
    domain, robot : str
        As the parameters of nodes: a name or a file.
    fence : Fence, optional
        Where the chains may lead; by default around the scene's area.
    time_limit : float
        Real time in s that a request may take.
    """

    def __init__(self, domain: str, robot: str, *, time_limit: float, fence: Fence | None = None) -> None:
        edges = None if fence is None else dataclasses.astuple(fence)
        self._told, self._limit = json.dumps([domain, robot, edges]), time_limit
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def chains(self, wishes: Sequence[Wish], world: World, library: TopLibrary) -> list[TopChain]:
        """Return the chains for a goal, as `chains_for` does; waits for the process.

        Raises
        ------
        PlanningError
            There is no plan, or none was found in time.
        """
        answer = self._answer(asked(wishes, world, library.action_set))
        if "refused" in answer:
            raise PlanningError(answer["refused"])
        return [chain_from(calls, library) for calls in answer["chains"]]

    def _answer(self, request: Json) -> Any:
        process = self._started()
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
            return json.loads(self._line(process, self._limit))
        except (OSError, TimeoutError) as error:
            self._kill()
            late = isinstance(error, TimeoutError)
            why = (
                f"no plan was found within {self._limit:g} s" if late else "the process that plans has ended"
            )
            raise PlanningError(why) from error

    def _started(self) -> subprocess.Popen[bytes]:
        if self._closed:
            raise PlanningError("the node ends")
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ator_ros.planning.process", self._told],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | _ONE_THREAD,
            start_new_session=True,  # Ctrl-C is for the node, which ends it
        )
        try:
            ready = json.loads(self._line(self._process, _STARTING))
        except (OSError, TimeoutError) as error:
            self._kill()
            raise PlanningError("the process that plans did not start") from error
        if "refused" in ready:
            self._kill()
            raise PlanningError(ready["refused"])
        return self._process

    def _line(self, process: subprocess.Popen[bytes], limit: float) -> bytes:
        """Return the next line of the process; raises TimeoutError, or OSError where it has ended."""
        assert process.stdout is not None
        end, line = time.monotonic() + limit, b""
        while not line.endswith(b"\n"):
            there, _, _ = select.select([process.stdout], [], [], max(0.0, end - time.monotonic()))
            if not there:
                raise TimeoutError
            new = os.read(process.stdout.fileno(), _LARGEST)
            if not new or len(line) > _LARGEST:
                raise OSError("ended")
            line += new
        return line

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def close(self) -> None:
        """End the process; a request under way is refused."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()


def main() -> None:
    """Answer requests until standard input ends."""
    out, sys.stdout = sys.stdout, sys.stderr  # what libraries print is no answer

    def tell(answer: Json) -> None:
        out.write(json.dumps(answer) + "\n")
        out.flush()

    try:
        from ator_ros.domains.domain import domain_for
        from ator_ros.planning import engine  # which takes a second to import
        from ator_ros.planning.planner import chains_for
        from ator_ros.planning.search import search
    except ImportError as error:
        tell({"refused": f"planning needs unified-planning and up-pyperplan: {error}"})
        return
    name, robot_file, edges = json.loads(sys.argv[1])
    domain = domain_for(name, robot_file)
    robot = domain.robot(robot_file or None)
    fence = None if edges is None else Fence(*edges)
    engine.warm_up()
    tell({"ready": True})
    for line in sys.stdin:
        request = json.loads(line)
        library = domain.library(robot, request["action_set"])
        wishes, world = read(request)
        try:
            found = chains_for(wishes, world, library, domain.objects, search, fence)
            tell({"chains": [written(chain) for chain in found]})
        except PlanningError as error:
            tell({"refused": str(error)})


if __name__ == "__main__":
    main()
