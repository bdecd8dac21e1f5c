"""The chains of a soak: three nodes, a client, and the observations."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.toolset import make_library
from ator_ros.evaluation.trials import random_trial
from ator_ros.tools.command_line import source_of
from ator_ros.tools.processes import NodeProcesses, all_nodes, node_setting
from ator_ros.tools.work.soak_report import NODES, Soak, sample

if TYPE_CHECKING:
    from ator_ros.tools.work.soak_client import SoakClient

WARM_UP_S = 10.0
"""Time in s before the first sample counts: caches fill, imports happen."""
IDLE_S = 10.0
"""Time in s without a goal before the first chain, in which the nodes' idle CPU is measured."""
MOST_HICCUPS = 10
_WRITING_PERIOD = 60.0


class SoakRun:
    """The chains of one soak.

    Parameters
    ----------
    options : Namespace
        Those of `soak`: how long, of which chain, with which seed, robot and models.
    domain : Domain
        The domain that they name.
    nodes : NodeProcesses
        The three nodes, started.
    client : SoakClient
        On their domain.
    write : callable
        Called every minute with what was seen so far.
    """

    def __init__(
        self,
        *,
        options: argparse.Namespace,
        domain: Domain,
        nodes: NodeProcesses,
        client: SoakClient,
        write: Callable[[Soak], None],
    ) -> None:
        self._options, self._domain, self._nodes, self._client = options, domain, nodes, client
        self._duration, self._write = options.duration, write
        source = source_of(options)
        self._library = make_library(source.described(), source)
        self.soak = Soak()

    def go(self) -> None:
        """Measure the idle nodes, then run chains; note hiccups of ROS and continue with the next."""
        self._client.ready()
        self._idle()
        began, trial = time.monotonic(), 0
        writes = began + _WRITING_PERIOD
        while (elapsed := time.monotonic() - began) < self._duration:
            try:
                self._chain(trial, counts=elapsed >= min(WARM_UP_S, self._duration / 2))
            except (RuntimeError, OSError) as error:
                self._nodes.check()  # a node that has ended is no hiccup
                self.soak.hiccups.append(f"at {elapsed:.0f} s: {error}")
                if len(self.soak.hiccups) > MOST_HICCUPS:
                    raise
            trial += 1
            if sys.stdout.isatty():
                print(f"\r{elapsed:6.0f} of {self._duration:.0f} s, {trial} chains", end="", flush=True)
            if time.monotonic() > writes:
                writes += _WRITING_PERIOD
                self._write(self.soak)
                if not sys.stdout.isatty():
                    print(f"{elapsed:.0f} of {self._duration:.0f} s, {trial} chains", flush=True)
        if sys.stdout.isatty():
            print()

    def _cpu(self) -> dict[str, float]:
        return {name: sample(self._nodes.pid(name)).cpu for name in NODES}

    def _idle(self) -> None:
        before, began = self._cpu(), time.monotonic()
        time.sleep(min(IDLE_S, self._duration))
        took, after = time.monotonic() - began, self._cpu()
        self.soak.idle_cpu = {name: (after[name] - before[name]) / took for name in NODES}

    def _chain(self, index: int, *, counts: bool) -> None:
        from ator_ros.nodes.messages import chain_of

        trial = random_trial(
            self._domain, self._options.chain, self._library, seed=self._options.seed, index=index
        )
        self._client.place(trial.world)
        self._client.take_answers()
        before, began = self._cpu(), time.monotonic()
        ended = self._client.execute(
            chain_of(trial.chain, action_set=self._options.action_set, frame="odom"), refine=True
        )
        took, after = time.monotonic() - began, self._cpu()
        soak = self.soak
        soak.chains += 1
        if not ended.success:
            soak.failures.append(ended.reason)
        if not counts:
            return
        soak.answers.append(self._client.take_answers())
        soak.busy += took
        for name in NODES:
            soak.busy_cpu[name] += after[name] - before[name]
            soak.samples[name].append(sample(self._nodes.pid(name)))


def run_soak(
    options: argparse.Namespace, domain: Domain, *, write: Callable[[Soak], None] = lambda _: None
) -> Soak:
    """Start the three nodes and execute random chains for `options.duration` (s of real time)."""
    from ator_ros.tools.work.soak_client import SoakClient

    started = all_nodes(options.real_time_factor, **node_setting(options))
    with started as nodes, SoakClient(nodes.domain, nodes.check, domain.objects) as client:
        made = SoakRun(options=options, domain=domain, nodes=nodes, client=client, write=write)
        try:
            made.go()
        finally:
            write(made.soak)
    return made.soak
