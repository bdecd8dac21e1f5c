"""Predicted durations of steps from several situations, for planners and task assignment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ator_ros.bases.direct import DirectTable
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_prediction import PredictsPerformance, StepRows
from ator_ros.tops.chain import TopCall
from ator_ros.world.state import World


class Durations(NamedTuple):
    """Predictions for n situations and m steps; NaN if the action of the step has no model.

    Attributes
    ----------
    durations, spreads : ndarray, shape (n, m)
        Expected durations in s, and the standard deviations in s of actual durations about them.
    success : ndarray, shape (n, m)
        Probabilities of success.
    """

    durations: FloatArray
    spreads: FloatArray
    success: FloatArray


def predict_durations(
    worlds: Sequence[World],
    calls: Sequence[TopCall],
    models: Mapping[str, PredictsPerformance],
) -> Durations:
    """Predict each of m steps from each of n situations.

    Parameters
    ----------
    worlds : sequence of World
        The n situations in which a step would start, in the goals' frame; only the robot's state
        counts.
    calls : sequence of TopCall
        The m steps, with their own goals; pre-conditions are not checked.
    models : mapping of str to PredictsPerformance
        By action; an action may lack one.

    Returns
    -------
    Durations
        Arrays of shape (n, m).
    """
    fields = ("duration", "spread", "success")
    found = Durations(*np.full((len(fields), len(worlds), len(calls)), np.nan))
    if not worlds:
        return found
    robots = [world.robot for world in worlds]
    poses = np.array([robot.pose for robot in robots])
    start = {
        "x": poses[:, 0],
        "y": poses[:, 1],
        "yaw": poses[:, 2],
        "v": np.array([robot.vx for robot in robots]),
        "w": np.array([robot.w for robot in robots]),
        "vy": np.array([robot.vy for robot in robots]),
    }
    nothing = np.zeros(0)
    for column, call in enumerate(calls):
        model = models.get(call.top.action)
        if model is None:
            continue
        rows = StepRows(dict.fromkeys(start, 0.0), call.goal, (), lambda _: start)
        direct = DirectTable(rows.names, rows.values(nothing, nothing))
        prediction = model.predict(direct, fields, None)
        for values, name in zip(found, fields, strict=True):
            predicted = getattr(prediction, name)
            if predicted is not None:
                values[:, column] = predicted
    return found
