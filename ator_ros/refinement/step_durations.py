"""Predicted durations of steps from several situations, for planners and task assignment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.goal_variables import with_values
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DirectTable
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_prediction import PredictsPerformance, StepRows
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import TopCall, projected
from ator_ros.tops.ranges import Ranges
from ator_ros.world.state import RobotState, World

HEADINGS = 12
"""Candidates of an open heading in a table of pairs: 30 degrees apart."""
_FIELDS = ("duration", "spread", "success")


class Durations(NamedTuple):
    """Predictions for n situations and m steps.

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


class DurationTable:
    """The durations of m steps from n situations, predicted part by part.

    Parameters
    ----------
    worlds : sequence of World
        The n situations in which a step would start, in the goals' frame; only the robot's state
        counts.
    calls : sequence of TopCall
        The m steps, with their own goals; pre-conditions are not checked.
    models : mapping of str to PredictsPerformance
        By action.
    """

    def __init__(
        self,
        worlds: Sequence[World],
        calls: Sequence[TopCall],
        models: Mapping[str, PredictsPerformance],
    ) -> None:
        self._calls = calls
        self._models = models
        self._origins = [[world.robot] for world in worlds]  # the states that each row starts in
        self._headings = [np.array([call.goal.pose.yaw]) for call in calls]
        self._own_rows: dict[int, int] = {}  # by call: the row that starts at its end

    @classmethod
    def of_pairs(
        cls,
        worlds: Sequence[World],
        calls: Sequence[TopCall],
        models: Mapping[str, PredictsPerformance],
        *,
        robot: Robot,
        ranges: Ranges,
    ) -> DurationTable:
        """Return the table that planners of rounds need, with m more rows: from the ends of calls.

        Where a heading is open, each entry is that of the fastest of `HEADINGS` allowed ones at
        both ends. So the sum along a round is a lower bound: a station has one heading for both of
        its legs. `worlds` has at least one item.
        """
        table = cls(worlds, calls, models)
        for number, call in enumerate(calls):
            domain = call.range_of("yaw", robot, ranges)
            is_bound = (0, "yaw") in bindings((call.top,))
            if domain is not None and call.opens("yaw") and not is_bound:
                table._headings[number], _ = domain.grid(HEADINGS)
            ends = []
            for yaw in table._headings[number].tolist():
                turned = TopCall(call.top, with_values(call.goal, {"yaw": yaw}))
                ends.append(projected(worlds[0], turned, robot).robot)
            table._own_rows[number] = len(table._origins)
            table._origins.append(ends)
        return table

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""
        return len(self._origins), len(self._calls)

    def part(self, column: int, first: int, last: int) -> Durations:
        """Return the predictions of a step for the rows `first` to before `last`, shape (k,)."""
        origins = self._origins[first:last]
        call = self._calls[column]
        found = Durations(*np.full((len(_FIELDS), len(origins)), np.nan))
        model = self._models[call.top.action]
        states = [state for origin in origins for state in origin]
        headings = self._headings[column]
        if len(states) * len(headings) > len(origins):
            durations = _predicted(model, call, states, headings, ("duration",)).duration
            sizes = [len(origin) for origin in origins]
            fastest = _fastest(durations.reshape(len(states), -1), sizes)
            states = [states[row] for row, _ in fastest]
            headings = headings[[heading for _, heading in fastest]]
        prediction = _predicted(model, call, states, headings, _FIELDS, paired=True)
        for values, name in zip(found, _FIELDS, strict=True):
            predicted = getattr(prediction, name)
            if predicted is not None:
                values[:] = predicted
        own = self._own_rows.get(column, -1) - first
        if 0 <= own < len(origins):
            for values, value in zip(found, (0.0, 0.0, 1.0), strict=True):
                values[own] = value
        return found

    def whole(self) -> Durations:
        """Return all predictions."""
        rows, columns = self.shape
        parts = [self.part(column, 0, rows) for column in range(columns)]
        by_field = zip(*parts, strict=True)
        return Durations(*(np.reshape(part, (columns, rows)).T for part in by_field))


def predict_durations(
    worlds: Sequence[World],
    calls: Sequence[TopCall],
    models: Mapping[str, PredictsPerformance],
) -> Durations:
    """Predict each of m steps from each of n situations; see `DurationTable`.

    Returns
    -------
    Durations
        Arrays of shape (n, m).
    """
    return DurationTable(worlds, calls, models).whole()


def _predicted(
    model: PredictsPerformance,
    call: TopCall,
    states: Sequence[RobotState],
    headings: FloatArray,
    fields: tuple[str, ...],
    *,
    paired: bool = False,
) -> Any:
    """Return the prediction of a step with n headings from m states.

    For each state with each heading, shape (m * n,), or `paired`, shape (m,).
    """
    poses = np.array([state.pose for state in states]).reshape(-1, 3)
    start = {
        "x": poses[:, 0],
        "y": poses[:, 1],
        "yaw": poses[:, 2],
        "v": np.array([state.vx for state in states]),
        "w": np.array([state.w for state in states]),
        "vy": np.array([state.vy for state in states]),
    }
    if not paired:
        start = {name: values[:, None] for name, values in start.items()}
    at_origin = dict.fromkeys(start, 0.0)
    rows = StepRows(at_origin, call.goal, ("yaw",), lambda _: start)
    table = rows.values(np.zeros(0), headings[:, None])
    direct = DirectTable(rows.names, table.reshape(len(rows.names), -1))
    return model.predict(direct, fields, None)


def _fastest(durations: FloatArray, sizes: Sequence[int]) -> list[tuple[int, int]]:
    """Return, for each group of rows, row and column of the least duration; the first if NaN."""
    found = []
    first = 0
    for size in sizes:
        part = durations[first : first + size]
        part = np.nan_to_num(part, nan=np.inf, posinf=np.inf)
        row, column = np.unravel_index(int(part.argmin()), part.shape)
        found.append((first + int(row), int(column)))
        first += size
    return found
