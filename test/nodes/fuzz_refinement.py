"""Send generated requests through conversions and refinement; only our own errors may come out.

scripts/run python test/nodes/fuzz_refinement.py --requests 100000
"""

from __future__ import annotations

import argparse
import math
import random
from collections import Counter

from ator_interfaces.msg import TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes import conversions
from ator_ros.nodes.checks import FARTHEST, FASTEST, MessageError
from ator_ros.nodes.refinement import refinement_of
from ator_ros.nodes.refinement_answers import answer_of
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot import load_robot
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.state import GOAL_VARIABLES

FRAME = "odom"
EDGES = (0.0, 1.0, -1.0, 1e-300, -1e-9, 5e-324, math.pi, -math.pi, FARTHEST, -FARTHEST)
NONSENSE = (math.nan, math.inf, -math.inf, 1e308)


class Generator:
    """Makes requests: mostly sensible ones, with edges, and now and then nonsense in one of the numbers."""

    def __init__(self, seed: int, tops: list[str]) -> None:
        self._random = random.Random(seed)
        self._tops = tops

    def request(self) -> RefineSubgoal.Request:
        """Give the next request."""
        draw = self._random
        request = RefineSubgoal.Request(want_curve=draw.random() < 0.3)
        self._fill(request.situation.robot)
        request.situation.v, request.situation.w = self._number(FASTEST), self._number(FASTEST)
        request.chain.calls = [self._call() for _ in range(draw.choice((0, 1, 2, 2, 2, 3, 4)))]
        if draw.random() < 0.3:
            for name in request.objective.get_fields_and_field_types():
                setattr(request.objective, name, self._number(FARTHEST))
        return request

    def _call(self) -> TopCall:
        draw = self._random
        call = TopCall(top=draw.choice(self._tops) if draw.random() < 0.98 else "fly")
        self._fill(call.goal.pose)
        call.speed = abs(self._number(FASTEST))
        call.bound = [name for name in GOAL_VARIABLES if draw.random() < 0.6]
        call.open = [name for name in GOAL_VARIABLES if name not in call.bound and draw.random() < 0.3]
        return call

    def _fill(self, pose: conversions.PoseMessage) -> None:
        pose.position.x, pose.position.y = self._number(FARTHEST), self._number(FARTHEST)
        half = self._random.uniform(-math.pi, math.pi)
        pose.orientation.z = math.sin(half)
        pose.orientation.w = math.cos(half) if self._random.random() < 0.99 else self._number(1.0)

    def _number(self, limit: float) -> float:
        kind = self._random.random()
        if kind < 0.01:
            return self._random.choice(NONSENSE)
        if kind < 0.2:
            return max(-limit, min(limit, self._random.choice(EDGES)))
        return self._random.uniform(-3.0, 3.0) if kind < 0.95 else self._random.uniform(-limit, limit)


def serve(request: RefineSubgoal.Request, refiner: Refiner, library: TopLibrary) -> str:
    """Do what the node does with a request; give "answered" or "refused"."""
    try:
        refinement = refinement_of(request, refiner, library, frame=FRAME)
    except (MessageError, RefinementError):
        return "refused"
    answer = answer_of(refinement, action_set="default", frame=FRAME, want_curve=request.want_curve)
    conversions.chain_from(answer.chain, library, frame=FRAME)  # an answer can be executed
    return "answered"


def fuzz(requests: int, seed: int, refiner: Refiner) -> Counter[str]:
    """Serve generated requests and count the outcomes."""
    library = TopLibrary(refiner.robot)
    generator = Generator(seed, list(library))
    return Counter(serve(generator.request(), refiner, library) for _ in range(requests))


def main() -> None:
    """Fuzz with the shipped models and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=501)
    options = parser.parse_args()
    robot = load_robot()
    counts = fuzz(options.requests, options.seed, Refiner(robot, load_models(robot)))
    print(", ".join(f"{count} {name}" for name, count in sorted(counts.items())), "no other exception")


if __name__ == "__main__":
    main()
