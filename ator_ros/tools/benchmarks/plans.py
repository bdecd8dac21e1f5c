"""How long the chains for a goal take to build, in random situations, without ROS.

Times are those of the processor, which is what an idle machine takes: one thread computes.
"""

from __future__ import annotations

import statistics
import time

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.evaluation.toolset import ToolsetSource, make_library
from ator_ros.evaluation.trials import random_trial
from ator_ros.planning.planner import chains_for
from ator_ros.planning.search import search
from ator_ros.tools.benchmarks.rows import PlanTime
from ator_ros.tops.library import TopLibrary

SEED = 803
LIMIT_MS = 50.0
_WARM_UP = 3


def measure(source: ToolsetSource, requests: int = 100) -> dict[str, PlanTime]:
    """Return for each goal that the domain names the median and the 99th percentile in ms, and the limit."""
    domain, robot = find_domain(source.domain), source.described()
    library = make_library(robot, source)
    return {name: _row(name, domain, library, requests) for name in sorted(domain.goals(robot))}


def _row(goal: str, domain: Domain, library: TopLibrary, requests: int) -> PlanTime:
    wishes = domain.goals(library.robot)[goal].terms
    chain = next(iter(domain.chains))
    times, found = [], []
    for index in range(requests + _WARM_UP):
        world = random_trial(domain, chain, library, seed=SEED, index=index).world
        began = time.process_time()
        found.append(len(chains_for(wishes, world, library, domain.objects, search)))
        times.append(1000.0 * (time.process_time() - began))
    times = times[_WARM_UP:]
    return PlanTime(
        requests=requests,
        median_ms=round(statistics.median(times), 2),
        p99_ms=round(statistics.quantiles(times, n=100)[-1], 2),
        limit_ms=LIMIT_MS,
        most_chains=max(found),
    )
