"""How fast experience is collected, with one worker and with several.

    python -m benchmarks.collection [--episodes 100] [--jobs 2]

Nothing else should run meanwhile: the workers share the cores with it.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence

from ator_ros.actions.catalogue import ACTION_SETS
from ator_ros.experience.collect import collect
from ator_ros.robot import load_robot

ACTIONS = ("goToPose", "dribbleBall")
SEED = 802
EPISODES = 1000
LIMIT_S = 180.0
"""What 1000 episodes of each action may take with two workers."""
LEAST_SPEEDUP = 1.8


def measure(episodes: int = 100, jobs: int = 2) -> dict[str, float]:
    """Give s per episode with one worker and with `jobs`, the speed-up, and what 2 x 1000 episodes take."""
    one, several = _seconds(episodes, 1), _seconds(episodes, jobs)
    return {
        "one_worker_s": round(one, 4),
        "several_workers_s": round(several, 4),
        "workers": jobs,
        "speedup": round(one / several, 2),
        "least_speedup": LEAST_SPEEDUP,
        "collection_s": round(several * EPISODES * len(ACTIONS), 1),
        "limit_s": LIMIT_S,
    }


def _seconds(episodes: int, jobs: int) -> float:
    """Give the wall time in s per episode, without the start of the workers."""
    factories = {name: ACTION_SETS["default"][name] for name in ACTIONS}
    robot = load_robot()
    for _ in collect(factories, robot, episodes=jobs, seed=SEED, jobs=jobs):
        pass
    began = time.perf_counter()
    count = sum(1 for _ in collect(factories, robot, episodes=episodes, seed=SEED, jobs=jobs))
    return (time.perf_counter() - began) / count


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; the exit code is 1 where a limit is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args(argv)
    result = measure(options.episodes, options.jobs)
    print(json.dumps(result, indent=1))
    return 1 if result["collection_s"] > LIMIT_S or result["speedup"] < LEAST_SPEEDUP else 0


if __name__ == "__main__":
    sys.exit(main())
