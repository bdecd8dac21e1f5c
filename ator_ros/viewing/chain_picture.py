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


def picture_of_chain(name: str, start: Pose, chain: TopChain, colour: Colour) -> list[Shape]:
    """Return an arrow at each subgoal of a chain, and a line from `start` from one to the next."""
    poses = [call.goal.pose for call in chain.calls]
    legs = polyline(f"{name}/legs", [(pose.x, pose.y) for pose in (start, *poses)], colour, _LEG_WIDTH)
    arrows = (Arrow(f"{name}/subgoal{step}", pose, colour) for step, pose in enumerate(poses))
    return [legs, *arrows]


def picture_under_way(start: Pose, chain: TopChain, step: int) -> list[Shape]:
    """Return a chain that is executed from `start`; the subgoal of `step`, from 0, is orange."""
    shapes = picture_of_chain("chain", start, chain, BLUE)
    pose = chain.calls[step].goal.pose
    return [Arrow(shape.name, pose, ORANGE) if n == step + 1 else shape for n, shape in enumerate(shapes)]


def alternatives(start: Pose, chains: Sequence[TopChain]) -> list[Segments]:
    """Return thin lines from `start` along the subgoals of other chains."""
    return [
        polyline(
            f"alternative{number}",
            [(start.x, start.y), *((call.goal.pose.x, call.goal.pose.y) for call in chain.calls)],
            VIOLET,
            _THIN,
        )
        for number, chain in enumerate(chains)
    ]


def picture_of(start: Pose, advice: Advice) -> list[Shape]:
    """Return what is drawn of an advice for a robot at `start`."""
    return [
        *picture_of_chain("naive", start, advice.naive, GREY),
        *picture_of_chain("chain", start, advice.chain, BLUE),
        *rings(advice),
    ]


def rings(advice: Advice) -> list[Segments]:
    """Return the rings of all subgoals whose heading was searched."""
    return [shape for curve in advice.curves for shape in rings_of(advice.chain, curve)]
