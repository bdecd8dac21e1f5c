"""Send generated requests through the checks of messages and refinement; only our own errors may come out.

scripts/run python test/nodes/fuzz_refinement.py --requests 100000 --out docs/fuzz.json

Any other exception ends it, after the request has been written to the standard error stream.
"""

from __future__ import annotations

import argparse
import math
import random
import re
import sys
import time
from collections import Counter
from pathlib import Path

from ator_interfaces.msg import ObjectState, TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.goal_variables import GOAL_VARIABLES
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.table import library_versions
from ator_ros.files import save
from ator_ros.nodes import messages
from ator_ros.nodes.messages import answer_of
from ator_ros.nodes.refinement import refine_request
from ator_ros.performance.model_file import load_models
from ator_ros.refinement import RefinementError
from ator_ros.refinement.free_variables import allowed_changes
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import load_robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.messages import FARTHEST, FASTEST, MessageError

FRAME = "odom"
EDGES = (0.0, 1.0, -1.0, 1e-300, -1e-9, 5e-324, math.pi, -math.pi, FARTHEST, -FARTHEST)
NONSENSE = (math.nan, math.inf, -math.inf, 1e308)
LENGTHS = (0, 1, 2, 2, 2, 2, 3, 3, 4)
WORDS_OF_A_KIND = 5
_PROGRESS = 1000


class Generator:
    """Makes requests: mostly valid plans, with edges, and now and then nonsense in one of the numbers."""

    def __init__(self, seed: int, tops: list[str], fastest_goal: float) -> None:
        self._random = random.Random(seed)
        self._tops = tops
        self._fastest_goal = fastest_goal

    def request(self) -> RefineSubgoal.Request:
        """Return the next request."""
        draw = self._random
        request = RefineSubgoal.Request(want_curve=draw.random() < 0.3)
        self._fill(request.situation.robot)
        request.situation.v, request.situation.w = self._number(FASTEST), self._number(FASTEST)
        length = draw.choice(LENGTHS) if draw.random() < 0.99 else draw.randint(5, 200)
        request.chain.calls = [self._call(top) for top in self._plan(length)]
        if draw.random() < 0.95:
            place_ball(request)
        if draw.random() < 0.01:
            request.situation.header.frame_id = "moon"
        if draw.random() < 0.3:
            for name in request.objective.get_fields_and_field_types():
                setattr(request.objective, name, self._number(FARTHEST))
        return request

    def _plan(self, length: int) -> list[str]:
        """Draw TOPs, mostly such that those that start with the ball in front of the robot can."""
        draw, tops, held = self._random, list[str](), False
        sensible = draw.random() < 0.9
        for _ in range(length):
            possible = self._tops if held or not sensible else ["goToPose", "goToBall"]
            tops.append(draw.choice(possible) if draw.random() < 0.98 else "fly")
            held = tops[-1] in ("goToBall", "dribbleBall")
        return tops

    def _call(self, top: str) -> TopCall:
        draw = self._random
        call = TopCall(top=top)
        self._fill(call.goal.pose)
        call.speed = abs(self._number(self._fastest_goal))
        call.open = [name for name in (*GOAL_VARIABLES, "*") if draw.random() < 0.4]
        if draw.random() < 0.005:
            call.open.append(draw.choice(("x", "beauty")))
        return call

    def _fill(self, pose: messages.PoseMessage) -> None:
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


def place_ball(request: RefineSubgoal.Request) -> None:
    """Put the ball where the plan first drives to it, and later approaches where the plan has left it."""
    ball = None
    for call in request.chain.calls:
        place = call.goal.pose.position
        if call.top == "goToBall" and ball is None:
            there = ObjectState(name="ball")
            there.position.x, there.position.y = place.x, place.y
            request.situation.objects = [there]
        elif call.top == "goToBall":
            place.x, place.y = ball.x, ball.y
        if call.top != "goToPose":
            ball = place


def serve(request: RefineSubgoal.Request, refiner: Refiner, library: TopLibrary) -> str:
    """Do what the node does with a request; give "answered" or "refused"."""
    try:
        choice = refine_request(request, refiner, library, frame=FRAME)
    except (MessageError, RefinementError) as error:
        return f"refused: {kind_of(str(error))}"
    answer = answer_of(choice, request, action_set="default", frame=FRAME)
    plan, chain = (messages.chain_from(c, library, frame=FRAME) for c in (request.chain, answer.chain))
    allowed_changes(plan, chain, library.robot, library.ranges)  # as the executor sees to it
    return "refined" if choice.refinement.refined else "left alone"


def kind_of(error: str) -> str:
    """Return the first words of what was expected: errors of one kind differ in names and numbers."""
    expected = error[error.index("expected") :].partition(", got")[0]  # ours all say what was expected
    return " ".join(re.findall(r"[a-zA-Z']+", expected)[:WORDS_OF_A_KIND])


def fuzz(requests: int, seed: int, refiner: Refiner) -> Counter[str]:
    """Serve generated requests and count the outcomes."""
    library = SOCCER.library(refiner.robot)
    generator = Generator(seed, list(library), 3.0 * refiner.robot.limits.v)
    counts: Counter[str] = Counter()
    for number in range(requests):
        request = generator.request()
        try:
            counts[serve(request, refiner, library)] += 1
        except Exception:
            print(f"request {number} of seed {seed}: {request}", file=sys.stderr)
            raise
        if number % _PROGRESS == _PROGRESS - 1:
            print(f"\r{number + 1} of {requests} requests", end="", flush=True)
    print()
    return counts


def main() -> None:
    """Fuzz with the shipped models; print and write the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=501)
    parser.add_argument("--out", type=Path, default=Path("build/fuzz.json"), metavar="FILE.json")
    options = parser.parse_args()
    robot = load_robot()
    began = time.monotonic()
    models = load_models(robot, SOCCER.known_features)
    counts = fuzz(options.requests, options.seed, Refiner(robot, models, ranges=SOCCER.ranges))
    report = {
        "command": "scripts/run python test/nodes/fuzz_refinement.py"
        f" --requests {options.requests} --seed {options.seed}",
        "requests": counts.total(),
        "answers": dict(counts.most_common()),
        "other_exceptions": 0,
        "seconds": round(time.monotonic() - began),
        "versions": library_versions(),
    }
    save(options.out, "fuzz", report)
    print(options.out.read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    main()
