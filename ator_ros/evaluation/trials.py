"""Random situations with a chain to execute in them (paper, section 5)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.experience.situations import CLEARANCE, SHORTEST, random_pose
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import BallState, RobotState, World

OPEN_HEADING = frozenset({"yaw"})
SHOOTING_DISTANCE = (1.2, 2.0)
"""Range in m of a shooting position's distance from the middle of the goal line."""
SHOOTING_BEARING = math.radians(50.0)
"""Greatest angle at the goal between a shooting position and the middle axis of the field."""

#: What the seeds of the experiments are for; no range is used for anything else.
SEEDS: Mapping[str, str] = MappingProxyType(
    {
        "1xx": "training episodes",
        "2xx": "episodes that measure the models' accuracy",
        "3xx": "situations that the gate and the calibration are learned from",
        "4xx-8xx": "development",
        "9xx": "quality of the actions, effect of the sensors",
        "2005": "the evaluations of before, looked at while the gate was made",
        "2015": "the final evaluation of the paper's actions",
        "2026": "the final evaluation",
        "3107": "further situations that the calibration is learned from",
        "3108": "the final errors of calibrated predictions",
    }
)


@dataclass(frozen=True, slots=True)
class Trial:
    """One situation of an experiment: the state at the start and the plan, its first heading left open."""

    index: int
    world: World
    chain: TopChain


def random_trial(seed: int, index: int, chain: str, robot: Robot, library: TopLibrary) -> Trial:
    """Draw situation number `index` of the experiment with this seed: it depends on nothing else.

    Parameters
    ----------
    seed, index : int
        Of the experiment, and of the situation in it.
    chain : {"dribble", "shoot"}
        Which chain; see `CHAINS`.
    robot : Robot
        Sizes, limits and field.
    library : TopLibrary
        Where the chain's TOPs come from.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    ball = random_pose(robot, rng)
    start = random_pose(robot, rng)
    while start.distance(ball) < CLEARANCE:
        start = random_pose(robot, rng)
    world = World(0.0, RobotState(start), BallState(ball.x, ball.y))
    return Trial(index, world, CHAINS[chain](ball, robot, library, rng))


def _dribble(ball: Pose, robot: Robot, library: TopLibrary, rng: np.random.Generator) -> TopChain:
    goal = random_pose(robot, rng)
    while goal.distance(ball) < SHORTEST:
        goal = random_pose(robot, rng)
    return TopChain((_call(library, "goToBall", ball, OPEN_HEADING), _call(library, "dribbleBall", goal)))


def _shoot(ball: Pose, robot: Robot, library: TopLibrary, rng: np.random.Generator) -> TopChain:
    x, y = robot.field.goal_centre()
    position = ball
    while position.distance(ball) < SHORTEST:
        distance, bearing = rng.uniform(*SHOOTING_DISTANCE), rng.uniform(-SHOOTING_BEARING, SHOOTING_BEARING)
        position = Pose(x - distance * math.cos(bearing), y + distance * math.sin(bearing), -bearing)
    return TopChain(
        (
            _call(library, "goToBall", ball, OPEN_HEADING),
            _call(library, "dribbleBall", position, OPEN_HEADING),
            _call(library, "shoot", Pose(x, y, 0.0)),
        )
    )


def _call(library: TopLibrary, top: str, pose: Pose, opened: frozenset[str] = frozenset()) -> TopCall:
    return TopCall(library[top], Goal(pose, 0.0, library[top].point), opened)


#: "dribble" is the chain of the paper's Table 1, "shoot" that of its Figure 1.
CHAINS: Mapping[str, Callable[[Pose, Robot, TopLibrary, np.random.Generator], TopChain]] = MappingProxyType(
    {"dribble": _dribble, "shoot": _shoot}
)


def open_speeds(chain: TopChain) -> TopChain:
    """Return the chain with the arrival speeds at its intermediate subgoals left open too."""
    *intermediate, last = chain.calls
    opened = (dataclasses.replace(call, open=call.open | {"speed"}) for call in intermediate)
    return TopChain((*opened, last))


def with_headings(chain: TopChain, headings: Mapping[int, float]) -> TopChain:
    """Return the chain with headings (rad) at some subgoals replaced and committed to."""
    calls = list(chain.calls)
    for index, yaw in headings.items():
        call = calls[index]
        goal = dataclasses.replace(call.goal, pose=call.goal.pose._replace(yaw=float(yaw)))
        calls[index] = dataclasses.replace(call, goal=goal, open=call.open - {"yaw"})
    return TopChain(tuple(calls))
