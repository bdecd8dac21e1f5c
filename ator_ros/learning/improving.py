"""The model of an action after a round of learning: measure by measure, the tree that predicts best."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ator_ros.actions.goal_variables import direct_name
from ator_ros.experience.columns import goal_variables_of_columns
from ator_ros.learning.correcting import constant
from ator_ros.learning.judging import RoundVerdict, judge
from ator_ros.learning.lessons import Lessons, Records
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import PATHS, Feature, Kinds, declared_by, kinds_of, with_kinds
from ator_ros.performance.model import MEASURES, UNOBSERVED, PerformanceModel
from ator_ros.performance.training import observed_driving
from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.robot.description import Robot

_LEAST_TOLD = 12  # records needed to estimate the mean of a measure
_SPREADS = (0.5, 10.0)  # by how much spreads change at most


@dataclass(frozen=True)
class ActionVerdict:
    """What a round of learning found out about an action.

    Attributes
    ----------
    measures : mapping
        Verdict on each measure.
    model : PerformanceModel or None
        The model with the better trees; None where there is none.
    """

    measures: Mapping[str, RoundVerdict]
    model: PerformanceModel | None


def improved(
    action: str,
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    *,
    now: PerformanceModel | None,
    seen: Mapping[str, int],
    former: Mapping[str, PerformanceModel],
) -> ActionVerdict:
    """Judge each tree of an action's model on the newest records.

    Parameters
    ----------
    action : str
        Name of the action.
    rows : pandas.DataFrame
        Starts of its episodes, oldest first, with `NUMBER`.
    robot, features
        As for `train`.
    now : PerformanceModel or None
        The model in use.
    seen : mapping
        Measure to the number from which on records are new to its tree.
    former : mapping
        Models that were in use before, by the names of their sets; those shipped, too.
    """
    rows = plausible(_complete(rows, features))
    driving = now.driving if now is not None else _driving(rows, robot, features)
    kinds = _kinds(now, former)
    former = {
        name: model
        for name, model in former.items()
        if model.driving == driving and kinds_of(model.features.values()) == kinds
    }
    models = [*former.values(), *([now] if now is not None else [])]
    known = {feature.name: feature for feature in features}
    for model in models:
        known |= model.features
    known = with_kinds(known, kinds) if kinds else known  # also those that no model uses
    records = Records(rows, robot, known, driving)
    names = [feature.name for feature in features]
    verdicts: dict[str, RoundVerdict] = {}
    for measure in MEASURES:
        verdicts[measure] = judge(
            records.lessons(measure),
            names,
            now=now.trees.get(measure) if now is not None else None,
            seen=seen.get(measure, 0),
            former=_trees(measure, former, now),
        )
    better = {measure: verdict.tree for measure, verdict in verdicts.items() if verdict.tree is not None}
    if now is None and "duration" not in better:
        # Without durations there is no model, so that nothing else is taken up either.
        kept = {name: dataclasses.replace(found, kind="", tree=None) for name, found in verdicts.items()}
        return ActionVerdict(kept, None)
    if not better:
        return ActionVerdict(verdicts, None)
    if "duration" in better:
        better["duration"] = with_honest_spread(
            better["duration"], records.lessons("duration"), verdicts["duration"]
        )
    trees = dict(now.trees) if now is not None else _means(records)
    trees |= better
    chosen = {measure: trees[measure] for measure in MEASURES if measure in trees}
    at_goal = now.at_goal if now is not None else UNOBSERVED
    model = PerformanceModel(action, robot, chosen, known, driving=driving, at_goal=at_goal)
    return ActionVerdict(verdicts, model)


def _kinds(now: PerformanceModel | None, former: Mapping[str, PerformanceModel]) -> Kinds:
    """Return the kinds of motion of the model in use, or of a former one where there is none."""
    known = [now] if now is not None else list(former.values())
    return next(filter(None, (kinds_of(model.features.values()) for model in known)), {})


def _trees(
    measure: str, models: Mapping[str, PerformanceModel], now: PerformanceModel | None
) -> dict[str, ModelTree]:
    """Return the trees of a measure that are not in use, each once."""
    present = now.trees.get(measure) if now is not None else None
    found: dict[str, ModelTree] = {}
    for name, model in models.items():
        tree = model.trees.get(measure)
        others = [*found.values(), *([present] if present is not None else [])]
        if tree is not None and not any(_same(tree, other) for other in others):
            found[name] = tree
    return found


def _same(one: ModelTree, other: ModelTree) -> bool:
    """Return whether two trees predict the same."""
    fields = ("feature", "threshold", "children", "intercept", "coefficients", "lower", "upper")
    return one.names == other.names and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in fields
    )


def _complete(rows: pd.DataFrame, features: Sequence[Feature]) -> pd.DataFrame:
    """Return the episodes that have the goal variables which the action declares."""
    there = set(map(direct_name, goal_variables_of_columns(rows.columns)))
    wanted = declared_by(features)
    if not there.issuperset(wanted):
        return rows[:0]
    return rows[rows[list(wanted)].notna().all(axis=1)]


def _driving(rows: pd.DataFrame, robot: Robot, features: Sequence[Feature]) -> DrivingStyle | None:
    return observed_driving(rows, robot) if set(features) & set(PATHS) and len(rows) else None


def _means(records: Records) -> dict[str, ModelTree]:
    """Return trees of the measures that predict their means: nothing better is known of a new action."""
    told = {measure: records.lessons(measure) for measure in MEASURES}
    return {
        measure: constant(lessons.table.columns[0], float(np.mean(lessons.values)), len(lessons.values))
        for measure, lessons in told.items()
        if len(lessons.values) >= _LEAST_TOLD
    }


def with_honest_spread(tree: ModelTree, lessons: Lessons, verdict: RoundVerdict) -> ModelTree:
    """Return the tree with spreads as large as its errors on the records that it was tested on."""
    assert verdict.error is not None
    table = lessons.table[list(tree.names)].to_numpy()[-verdict.tested :]
    expected = float(np.median(tree.predict_with_spread(np.ascontiguousarray(table))[1]))
    factor = float(np.clip(verdict.error / expected, *_SPREADS)) if expected > 0.0 else 1.0
    return dataclasses.replace(tree, spread=factor * tree.spread)


def plausible(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the episodes whose durations can be true; a record may lie, and a failure may take any time."""
    durations, good = rows["duration"].to_numpy(dtype=float), rows["success"].to_numpy(dtype=bool)
    usual = float(np.median(durations[good])) if good.any() else 0.0
    return rows[~good | ((durations > 0.0) & (durations < max(10.0 * usual, 1.0)))]
