"""How often the best of three ways to shoot is chosen: each is refined and executed.

The ways: dribble anywhere and shoot; shoot from where the ball lies; drive round to its other side first, and
shoot. The robot starts anywhere at rest, and the ball lies where all three are plans. A choice is right if it
takes at most 2 % longer than the best executed. An interrupted run goes on where it was:
    scripts/run python benchmarks/choice_among_alternatives.py --seed 2042 --out docs/choice.json
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from resumed import OtherResultsError, resumed

from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.situations import random_pose
from ator_ros.domains.soccer.thresholds import ball_clearance
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import Toolset
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import choose
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

FORMAT = Format("ator_ros choice", 1, "choice among alternatives")
WAYS = ("dribble anywhere and shoot", "shoot from here", "approach from the other side and shoot")
EQUAL = 1.02
ROUND = 0.8
"""Distance in m behind the ball, seen from the goal, to which the third way drives first."""
PLACE = 1.5
"""Distance in m before the goal of the placeholder of the first way's shooting place."""
_MOVING = frozenset({"yaw", "speed"})
_ANYWHERE = _MOVING | {"x", "y"}


def ways(library: TopLibrary, ball: Pose) -> tuple[TopChain, ...]:
    """Return the three plans for a ball."""
    robot = library.robot
    x, y = field_of(robot).goal_centre()
    axis = math.atan2(y - ball.y, x - ball.x)
    behind = Pose(ball.x - ROUND * math.cos(axis), ball.y - ROUND * math.sin(axis), axis)
    fetch, score = _call(library, "goToBall", ball, _MOVING), _call(library, "shoot", Pose(x, y, 0.0))
    return (
        TopChain((fetch, _call(library, "dribbleBall", Pose(x - PLACE, y, 0.0), _ANYWHERE), score)),
        TopChain((fetch, score)),
        TopChain((_call(library, "goToPose", behind, _MOVING), fetch, score)),
    )


def _call(library: TopLibrary, top: str, pose: Pose, opened: frozenset[str] = frozenset()) -> TopCall:
    return TopCall(library[top], Goal(pose, 0.0, library[top].point), opened)


def situation(library: TopLibrary, seed: int, index: int) -> tuple[World, tuple[TopChain, ...]]:
    """Draw robot and ball so that all ways are plans; it depends on seed and index alone."""
    robot = library.robot
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    while True:
        ball, start = random_pose(robot, rng), random_pose(robot, rng)
        world = World(0.0, RobotState(start), {BALL: ObjectState(ball.x, ball.y)})
        plans = ways(library, ball)
        apart = start.distance(ball) >= ball_clearance(robot)
        if apart and not any(plan.violations(world, robot) for plan in plans):
            return world, plans


def evaluated(tools: Toolset, library: TopLibrary, seed: int, index: int) -> dict[str, Any]:
    """Choose among the ways in one situation, and execute all of them."""
    world, plans = situation(library, seed, index)
    selection = choose(tools.refiner(gated=True), world, plans, placeholders=True)
    rows = []
    for judged in selection.judged:
        found, prediction = judged.refinement, judged.prediction
        assert found is not None
        assert prediction is not None
        run = run_chain(tools.robot, library, world, found.chain)
        rows.append(
            {
                "predicted": round(prediction.cost, 3),
                "actions": [round(action["duration"], 3) for action in prediction.actions],
                "duration": round(run.duration, 3),
                "executed": [round(duration, 3) for duration in run.actions],
                **({} if run.success else {"failed": run.reason}),
            }
        )
    return {"index": index, "chosen": selection.number, "ways": rows}


def summary(records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the share of right choices with its interval, and how far choices are behind the best."""
    durations = np.array([[way["duration"] for way in record["ways"]] for record in records])
    predicted = np.array([[way["predicted"] for way in record["ways"]] for record in records])
    failed = np.array([["failed" in way for way in record["ways"]] for record in records])
    chosen = np.array([record["chosen"] for record in records])
    each, best = np.arange(len(records)), durations.min(axis=1)
    taken = durations[each, chosen]
    right = taken <= EQUAL * best
    return {
        "situations": len(records),
        "right_percent": round(100.0 * float(right.mean()), 2),
        "right_percent_ci95": [round(100.0 * bound, 2) for bound in wilson(int(right.sum()), len(right))],
        "mean_chosen_s": round(float(taken.mean()), 3),
        "mean_best_s": round(float(best.mean()), 3),
        "behind_best_percent": round(100.0 * float(taken.sum() / best.sum() - 1.0), 2),
        "ways": [
            {
                "way": way,
                "chosen": int((chosen == number).sum()),
                "right_when_chosen": int(right[chosen == number].sum()),
                "best": int((durations.argmin(axis=1) == number).sum()),
                "always_right_percent": round(
                    100.0 * float((durations[:, number] <= EQUAL * best).mean()), 2
                ),
                "mean_s": round(float(durations[:, number].mean()), 3),
                "failures": int(failed[:, number].sum()),
                "predicted_less_actual_s": round(
                    float((predicted - durations)[:, number][~failed[:, number]].mean()), 3
                ),
            }
            for number, way in enumerate(WAYS)
        ],
    }


def wilson(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson's)."""
    z = 1.959964
    share, scale = count / of, 1.0 + z * z / of
    centre = (share + z * z / (2.0 * of)) / scale
    half = z * math.sqrt(share * (1.0 - share) / of + z * z / (4.0 * of * of)) / scale
    return centre - half, centre + half


def main(words: list[str]) -> int:
    """Evaluate what is not in the partial results yet, and write the summary; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--situations", type=int, default=500, metavar="N")
    parser.add_argument("--seed", type=int, default=441)
    parser.add_argument("--out", type=Path, default=Path("choice.json"))
    options = parser.parse_args(words)
    source = ToolsetSource()
    tools, library = tools_of(source)
    partial = options.out.with_suffix(".jsonl")
    identity = {"seed": options.seed, "digest": source.digest(("gated",), "shoot")}
    try:
        records = resumed(
            partial, identity, range(options.situations),
            lambda index: evaluated(tools, library, options.seed, index),
        )  # fmt: skip
    except OtherResultsError as error:
        print(error, file=sys.stderr)
        return 2
    result = {"command": portable_command("choice_among_alternatives", words), **summary(records)}
    write_text(options.out, FORMAT.text({**result, "records": records}))
    print(json.dumps(result, indent=1))
    partial.unlink()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
