"""A chain as shapes: naive in grey, as it will be executed in colour, rings around its refined subgoals."""

from __future__ import annotations

from collections.abc import Sequence

from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopChain
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.ring import rings_of
from ator_ros.viewing.shapes import BLUE, GREY, ORANGE, VIOLET, Arrow, Colour, Segments, Shape, polyline

_LEG_WIDTH = 0.015
_THIN = 0.008


def picture_of_goals(name: str, start: Pose, goals: Sequence[Pose], colour: Colour) -> list[Shape]:
    """Return an arrow at each subgoal of a chain, and a line from `start` from one to the next."""
    legs = polyline(f"{name}/legs", [(pose.x, pose.y) for pose in (start, *goals)], colour, _LEG_WIDTH)
    arrows = (Arrow(f"{name}/subgoal{step}", pose, colour) for step, pose in enumerate(goals))
    return [legs, *arrows]


def picture_under_way(start: Pose, goals: Sequence[Pose], step: int, colour: Colour = BLUE) -> list[Shape]:
    """Return a chain that is executed from `start`; the subgoal of `step`, from 0, is orange."""
    shapes = picture_of_goals("chain", start, goals, colour)
    present = [Arrow(f"chain/subgoal{step}", pose, ORANGE) for pose in goals[step : step + 1]]
    return [*(shape for shape in shapes if shape.name != f"chain/subgoal{step}"), *present]


def goals_of(chain: TopChain) -> list[Pose]:
    """Return the subgoals of a chain."""
    return [call.goal.pose for call in chain.calls]


def alternatives(start: Pose, chains: Sequence[TopChain]) -> list[Segments]:
    """Return thin lines from `start` along the subgoals of other chains."""
    return [
        polyline(
            f"alternative{number}",
            [(pose.x, pose.y) for pose in (start, *goals_of(chain))],
            VIOLET,
            _THIN,
        )
        for number, chain in enumerate(chains)
    ]


def picture_of(start: Pose, advice: Advice) -> list[Shape]:
    """Return what is drawn of an advice for a robot at `start`."""
    return [
        *picture_of_goals("naive", start, goals_of(advice.naive), GREY),
        *picture_of_goals("chain", start, goals_of(advice.chain), BLUE),
        *rings(advice),
    ]


def rings(advice: Advice) -> list[Segments]:
    """Return the rings of all subgoals whose heading was searched."""
    return [shape for curve in advice.curves for shape in rings_of(advice.chain, curve)]
