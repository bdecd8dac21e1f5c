"""Predicted durations of steps from several situations, for planners and task assignment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ator_ros.bases.description import Robot
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
    robot: Robot,
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
    robot : Robot
        The robot in all situations.
    models : mapping of str to PredictsPerformance
        By action; an action may lack one.

    Returns
    -------
    Durations
        Arrays of shape (n, m).
    """
    found = Durations(*np.full((3, len(worlds), len(calls)), np.nan))
    starts = np.array(
        [(*world.robot.pose, world.robot.vx, world.robot.w, world.robot.vy) for world in worlds]
    )
    for action in dict.fromkeys(call.top.action for call in calls):
        model = models.get(action)
        if model is None or not worlds:
            continue
        columns = [number for number, call in enumerate(calls) if call.top.action == action]
        tables = [_situations(starts, calls[number], robot) for number in columns]
        table = DirectTable(tables[0].names, np.hstack([each.table for each in tables]))
        prediction = model.predict(table, ("duration", "spread", "success"), None)
        for values, name in zip(found, ("duration", "spread", "success"), strict=True):
            if (predicted := getattr(prediction, name)) is not None:
                values[:, columns] = predicted.reshape(len(columns), len(worlds)).T
    return found


def _situations(starts: FloatArray, call: TopCall, robot: Robot) -> DirectTable:
    """Return the direct variables of a step for starts x, y, yaw, v, w, vy, shape (n, 6)."""
    rows = StepRows(starts[0].tolist(), call.goal, (), None, (), robot.hold)
    table = rows.values(np.zeros(0), np.zeros(0))[:, None].repeat(len(starts), axis=1)
    table[: starts.shape[1]] = starts.T
    return DirectTable(rows.names, table)
