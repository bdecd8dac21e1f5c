"""Assign the ball to the one of two robots that is predicted to reach it first.

    scripts/run python examples/who_goes_to_the_ball.py --situations 200

If the robots share their states, each can predict both times, and they decide alike without
negotiation. The program compares this decision with the usual one, by distance, in random
situations in which both robots are in motion. Each robot goes to the ball in the simulation. Over
ROS, the service `predict_durations` gives the same predictions.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import Pose
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.step_durations import predict_durations
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = SOCCER.robot()
LIBRARY = SOCCER.library(ROBOT)
MODELS = load_models(ROBOT, SOCCER.known_features)
SPACING = 0.6  # m, least distance between robots, ball and the edges of the field
MOST_V, MOST_W = 0.8, 0.8  # m/s and rad/s at the start


def who_goes(times: Sequence[float], spreads: Sequence[float], now: int | None = None) -> int:
    """Return the index of the robot that goes, by predicted times and standard deviations (s).

    The robot that goes `now` is replaced only if another one is faster by more than the standard
    deviation of the difference. Otherwise two robots that are equally near would alternate.
    """
    first = min(range(len(times)), key=times.__getitem__)
    if now is None:
        return first
    return first if times[now] - times[first] > math.hypot(spreads[now], spreads[first]) else now


def to_ball(world: World) -> TopCall:
    """Return the step to the ball, with the heading of the straight path."""
    ball, pose = world.objects[BALL], world.robot.pose
    heading = math.atan2(ball.y - pose.y, ball.x - pose.x)
    return TopCall(LIBRARY["goToBall"], Goal(Pose(ball.x, ball.y, heading), 0.0, Point.HOLD))


def predicted(worlds: Sequence[World]) -> tuple[list[float], list[float]]:
    """Return the predicted time to the ball and its standard deviation for each robot, in s."""
    found = predict_durations(worlds, [to_ball(world) for world in worlds], MODELS)
    return np.diag(found.durations).tolist(), np.diag(found.spreads).tolist()


def random_worlds(random: np.random.Generator) -> list[World]:
    """Return random situations of two robots in motion, with the same ball."""
    area = ROBOT.scene.area
    half = np.array([area.length / 2.0 - SPACING, area.width / 2.0 - SPACING])
    while True:
        places = random.uniform(-half, half, (3, 2))
        if min(math.dist(one, other) for one, other in itertools.combinations(places, 2)) > SPACING:
            break
    ball = {BALL: ObjectState(*places[2])}
    motions = random.uniform((-math.pi, 0.0, -MOST_W), (math.pi, MOST_V, MOST_W), (2, 3))
    return [
        World(0.0, RobotState(Pose(x, y, yaw), v, w), ball)
        for (x, y), (yaw, v, w) in zip(places[:2].tolist(), motions.tolist(), strict=True)
    ]


def compared(number: int, seed: int) -> tuple[list[float], int, int] | None:
    """Return both times to the ball (s), and the robots chosen by distance and predicted time.

    Return None if one of the robots does not reach the ball in this random situation.
    """
    worlds = random_worlds(np.random.default_rng([seed, number]))
    runs = [run_chain(ROBOT, LIBRARY, world, TopChain((to_ball(world),))) for world in worlds]
    if not all(run.success for run in runs):
        return None
    ball = worlds[0].objects[BALL]
    distances = [
        math.hypot(ball.x - world.robot.pose.x, ball.y - world.robot.pose.y) for world in worlds
    ]
    return [run.duration for run in runs], int(np.argmin(distances)), who_goes(*predicted(worlds))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--situations", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7001)
    options = parser.parse_args(arguments)
    with ProcessPoolExecutor() as processes:
        found = list(processes.map(partial(compared, seed=options.seed), range(options.situations)))
    outcomes = [outcome for outcome in found if outcome is not None]
    print(f"{len(outcomes)} of {len(found)} situations in which both robots reach the ball")
    times, *choices = map(np.array, zip(*outcomes, strict=True))
    for name, chosen in zip(("by distance", "by predicted time"), choices, strict=True):
        durations = times[np.arange(len(times)), chosen]
        loss = durations - times.min(axis=1)
        low, high = mean_ci95(loss)
        print(
            f"{name}: {durations.mean():.2f} s to the ball, "
            f"{loss.mean():.2f} s later than the faster robot "
            f"(95 % CI {low:.2f} to {high:.2f} s), {np.count_nonzero(loss)} wrong choices"
        )


if __name__ == "__main__":
    main()
