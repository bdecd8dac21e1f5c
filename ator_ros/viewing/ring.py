"""The ring around a subgoal: how long the whole chain is predicted to take, by the heading there."""

from __future__ import annotations

import numpy as np

from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.tops.chain import TopChain
from ator_ros.viewing.shapes import BLUE, Segments

_INNER, _DEPTH = 0.35, 0.35
"""Radius in m where the chain is fastest, and what is added where it is slowest."""
_CHOSEN_WIDTH, _WIDTH = 0.05, 0.03
_HEADING = "yaw"


def times_by_heading(curve: SubgoalCurve) -> tuple[FloatArray, FloatArray]:
    """Return the searched headings in rad, ascending in [-pi, pi), and the least cost in s through each.

    Returns
    -------
    headings, costs : ndarray, shape (n,)
        Empty where the heading was not searched; costs that are not finite are left out.
    """
    if _HEADING not in curve.names:
        return np.zeros(0), np.zeros(0)
    known = np.isfinite(curve.totals)
    column = curve.values[known, curve.names.index(_HEADING)]
    headings, number = np.unique(np.round(wrap_angles(column), 6), return_inverse=True)
    costs = np.full(len(headings), np.inf)
    np.minimum.at(costs, number, curve.totals[known])
    return headings, costs


def rings_of(chain: TopChain, curve: SubgoalCurve) -> tuple[Segments, ...]:
    """Return the ring of one subgoal of `chain`, and the mark of the heading that the chain has.

    A point of the ring lies where the robot comes from if it arrives with that heading. The ring is green and
    near the subgoal where the chain is predicted to be fast, red and far from it where it is slow.
    """
    headings, costs = times_by_heading(curve)
    if len(headings) < 3:
        return ()
    pose = chain.calls[curve.subgoal].goal.pose
    least, most = float(costs.min()), float(costs.max())
    shares = (costs - least) / (most - least) if most > least else np.zeros(len(costs))
    reach = _INNER + _DEPTH * shares
    points = np.stack([pose.x - reach * np.cos(headings), pose.y - reach * np.sin(headings)], axis=1)
    colours = np.stack([shares, 0.8 * (1.0 - shares), np.zeros(len(shares))], axis=1)
    ring = Segments(
        f"ring{curve.subgoal}", np.stack([points, np.roll(points, -1, axis=0)], axis=1), colours, _WIDTH
    )
    mark = np.array([[_behind(pose, pose.yaw, -0.6), _behind(pose, pose.yaw, 1.2)]])
    return ring, Segments(f"chosen{curve.subgoal}", mark, np.array([BLUE]), _CHOSEN_WIDTH)


def _behind(pose: Pose, heading: float, share: float) -> tuple[float, float]:
    there = pose._replace(yaw=heading).ahead(-_INNER - _DEPTH * share)
    return there.x, there.y
