"""Drawings on the floor for the page and RViz: chains, rings, and the surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.goal_variables import ORDER
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import routes_of
from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.tops.chain import TopChain
from ator_ros.world.scene import WALL_THICKNESS

Color = tuple[float, float, float]  # red, green and blue, each from 0 to 1

GRAY: Color = (0.55, 0.57, 0.6)
BLUE: Color = (0.13, 0.45, 0.9)
ORANGE: Color = (0.95, 0.5, 0.1)
VIOLET: Color = (0.6, 0.45, 0.75)
YELLOW: Color = (1.0, 0.82, 0.24)
WHITE: Color = (0.93, 0.94, 0.95)

# widths of lines in m
_LEG_WIDTH = 0.015
_ALTERNATIVE_WIDTH = 0.008
_LINE_WIDTH = 0.03
_ARROW_WIDTH = 0.04
_ARROW = 0.4  # length of an arrow in m
_RING_RADIUS = 0.35  # m where the chain is fastest
_RING_DEPTH = 0.35  # m more where it is slowest
_RING_WIDTH = 0.03
_CHOSEN_WIDTH = 0.05


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight segments: ends (n, 2, 2) and width in m, colors (n, 3).

    Names are unique in a drawing.
    """

    name: str
    points: FloatArray
    colors: FloatArray
    width: float = 0.02


@dataclass(frozen=True)
class Label:
    """A text at a place (m). Names are unique in a drawing."""

    name: str
    text: str
    x: float
    y: float


def station_labels(chain: TopChain) -> list[Label]:
    """Return the number of each station of a round as sent, and its place in the order chosen.

    Those that are passed are marked. Empty for a chain whose order is not open and without any.
    """
    if not any(ORDER in call.open or call.passing for call in chain.calls):
        return []
    labels = []
    for place, (index, call) in enumerate(zip(chain.order, chain.calls, strict=True)):
        text = str(index + 1) if place == index else f"{index + 1} ({_ordinal(place + 1)})"
        text += " passed" if call.passing else ""
        labels.append(Label(f"station{index}", text, *call.goal.pose[:2]))
    return labels


def _ordinal(number: int) -> str:
    """Return 1st, 2nd, 3rd, 4th, …."""
    is_teen = number // 10 % 10 == 1
    ending = "th" if is_teen else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def polyline(
    name: str, corners: Sequence[tuple[float, float]], color: Color, width: float
) -> Segments:
    """Return the segments between neighboring `corners` (m)."""
    line = np.asarray(corners, dtype=float).reshape(-1, 2)
    points = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.zeros((0, 2, 2))
    return Segments(name, points, np.tile(np.asarray(color, dtype=float), (len(points), 1)), width)


def _arrow(name: str, pose: Pose, color: Color) -> Segments:
    tip = pose.ahead(_ARROW)
    left, right = (tip._replace(yaw=tip.yaw + turn).ahead(-0.4 * _ARROW) for turn in (0.45, -0.45))
    points = np.array([[a[:2], b[:2]] for a, b in ((pose, tip), (tip, left), (tip, right))])
    return Segments(name, points, np.tile(color, (len(points), 1)), _ARROW_WIDTH)


def _chain_shapes(name: str, start: Pose, chain: TopChain, color: Color) -> list[Segments]:
    """Return a line from `start` along the subgoals, and an arrow at each of them."""
    goals = [call.goal.pose for call in chain.calls]
    legs = polyline(f"{name}/legs", [pose[:2] for pose in (start, *goals)], color, _LEG_WIDTH)
    return [
        legs,
        *(_arrow(f"{name}/subgoal{step}", pose, color) for step, pose in enumerate(goals)),
    ]


def executed_chain_shapes(start: Pose, chain: TopChain, step: int) -> list[Segments]:
    """Return a chain that is executed from `start`.

    The subgoal of the current `step`, from 0, is orange.
    """
    shapes = _chain_shapes("chain", start, chain, BLUE)
    if step < len(chain.calls):
        shapes[step + 1] = _arrow(f"chain/subgoal{step}", chain.calls[step].goal.pose, ORANGE)
    return shapes


def refinement_shapes(
    start: Pose, naive: TopChain, chain: TopChain, curves: Sequence[SubgoalCurve]
) -> list[Segments]:
    """Return the naive chain from `start` in gray, the refined one in blue, and rings.

    See `ring`.
    """
    return [
        *_chain_shapes("naive", start, naive, GRAY),
        *_chain_shapes("chain", start, chain, BLUE),
        *(shape for curve in curves for shape in ring(chain, curve)),
    ]


def alternative_shapes(start: Pose, chains: Sequence[TopChain]) -> list[Segments]:
    """Return thin lines from `start` along the subgoals of other chains."""
    lines = ([start[:2], *(call.goal.pose[:2] for call in chain.calls)] for chain in chains)
    return [
        polyline(f"alternative{i}", line, VIOLET, _ALTERNATIVE_WIDTH)
        for i, line in enumerate(lines)
    ]


def costs_by_heading(curve: SubgoalCurve) -> tuple[FloatArray, FloatArray]:
    """Return the searched headings and the least cost in s through each.

    Headings are in rad, ascending in [-pi, pi). Both have shape (n,), and are empty where the
    heading was not searched; infinite costs are left out.
    """
    if "yaw" not in curve.names:
        return np.zeros(0), np.zeros(0)
    known = np.isfinite(curve.totals)
    column = curve.values[known, curve.names.index("yaw")]
    headings, number = np.unique(np.round(wrap_angles(column), 6), return_inverse=True)
    costs = np.full(len(headings), np.inf)
    np.minimum.at(costs, number, curve.totals[known])
    return headings, costs


def ring(chain: TopChain, curve: SubgoalCurve) -> tuple[Segments, ...]:
    """Return the ring of one subgoal of `chain`, and a mark of the chain's own heading.

    Each point stands for one heading and lies on the side from which the robot then arrives: green
    and near the subgoal if the chain is predicted to be fast, red and far if it is slow.
    """
    headings, costs = costs_by_heading(curve)
    if len(headings) < 3:
        return ()
    pose = chain.sent(curve.subgoal).goal.pose
    least = float(costs.min())
    most = float(costs.max())
    shares = (costs - least) / (most - least) if most > least else np.zeros(len(costs))
    reach = _RING_RADIUS + _RING_DEPTH * shares
    points = np.stack(
        [pose.x - reach * np.cos(headings), pose.y - reach * np.sin(headings)], axis=1
    )
    colors = np.stack([shares, 0.8 * (1.0 - shares), np.zeros(len(shares))], axis=1)
    segments = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    ends = [pose.ahead(-_RING_RADIUS - _RING_DEPTH * share)[:2] for share in (-0.6, 1.2)]
    return (
        Segments(f"ring{curve.subgoal}", segments, colors, _RING_WIDTH),
        Segments(f"chosen{curve.subgoal}", np.array([ends]), np.array([BLUE]), _CHOSEN_WIDTH),
    )


def route_line(start: Pose, goal: Pose, robot: Robot) -> FloatArray:
    """Return the corners of the robot's route from place to place in m, shape (n, 2).

    A straight line without a map.
    """
    routes = routes_of(robot)
    if routes is None:
        return np.array([start[:2], goal[:2]])
    return routes.corners(start, goal)


def walls(robot: Robot) -> Segments:
    """Return the outlines of the obstacles on the robot's map; empty without one.

    On a large map this takes seconds.
    """
    lines = []
    for middle, length, width in [] if robot.grid is None else robot.grid.walls:
        x, y = 0.5 * length, 0.5 * width
        corners = [(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
        outline = [middle.compose(Pose(*corner, 0.0))[:2] for corner in corners]
        lines.append(polyline("wall", outline, GRAY, _LINE_WIDTH))
    if not lines:
        return polyline("walls", [], GRAY, _LINE_WIDTH)
    points = np.concatenate([line.points for line in lines])
    colors = np.concatenate([line.colors for line in lines])
    return Segments("walls", points, colors, _LINE_WIDTH)


def surroundings(domain: Domain, robot: Robot) -> list[Segments]:
    """Return the outline of the area, the domain's lines, and the walls of the bays."""
    x_min, y_min, x_max, y_max = robot.scene.area.lines
    outline = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max), (x_min, y_min)]
    shapes = [polyline("area", outline, WHITE, _LINE_WIDTH)]
    for number, line in enumerate(domain.lines(robot)):
        shapes.append(polyline(f"line{number}", line, WHITE, _LINE_WIDTH))
    for number, bay in enumerate(robot.scene.bays):
        front = Pose(bay.x, bay.y, bay.yaw)
        side = bay.width / 2.0
        places = ((0.0, side), (bay.depth, side), (bay.depth, -side), (0.0, -side))
        walls = [front.compose(Pose(x, y, 0.0))[:2] for x, y in places]
        shapes.append(polyline(f"bay{number}", walls, GRAY, WALL_THICKNESS))
    return shapes
