"""Learns the performance model of an action from its experience (paper, section 3)."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.goal_variables import STOP, direct_name
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DIRECT_VARIABLES, NEAR_GOAL
from ator_ros.bases.drive_parts import part_times
from ator_ros.bases.interface import Driving
from ator_ros.experience.table import ExperienceError, goal_variables_of_columns
from ator_ros.geometry import BoolArray, FloatArray, IntArray, wrap_angles
from ator_ros.performance.derived import ANGLE_BETWEEN, RESTS, Geometry
from ator_ros.performance.error_process import TIMING, ErrorProcess, fit_error_process
from ator_ros.performance.features import (
    CANDIDATES,
    DRIVES_ON,
    GENERAL,
    PATHS,
    ROUTE_ANGLE_AT,
    ROUTE_TIME,
    Feature,
    base_features,
    declared_by,
    feature_table,
    names_of,
    suited,
)
from ator_ros.performance.held_up import clipped, describe_held_up, find_held_up
from ator_ros.performance.model import (
    UNOBSERVED,
    Arrival,
    AtGoal,
    Passing,
    PerformanceModel,
)
from ator_ros.performance.path_times import LEAST_DRIVES, corrected, path_time_model
from ator_ros.performance.prior import Slope, prior_slopes
from ator_ros.performance.rising_terms import (
    OF_DIRECTION,
    RISING,
    rising_in,
    rising_terms,
    sum_of,
)
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.performance.tree.nodes import Hinge, ModelTree
from ator_ros.world.state import AT_REST, CONTROL_PERIOD

# Smoothing constants to choose from (M5': 15). With a few hundred starts the leaves are small, and
# a search along a heading exploits the jumps between them: much smoothing is better, unless an
# action changes its behavior at thresholds.
_SMOOTHINGS = (5.0, 60.0)
_FOLDS = 10  # of a cross-validation, where the learning is fast
_FEW_FOLDS = 3
_LEAF = 25  # least number of episodes in a leaf
# The same if the robot stands at both ends. There a tree of the basic features finds the thresholds
# of an action server in fifty drives.
_SMALL_LEAF = 8
_PATH = "path_time"
_LENGTH = "route_length"
# Median absolute deviations below the median at which duration less path time is clipped. A drive
# that is much faster had a shape that was not chosen. Unclipped, it lowers predictions nearby, and
# a search selects predictions that are too low.
_CLIPPED_AT = 3.0
# An action does not follow its path if this share of its drives is faster than their paths by that
# share of the median duration.
_FASTER_SHARE = 0.05
_FASTER_BY = 0.25
# Whole durations are learned if the mean error by parts is more than this multiple of theirs.
_MOST_BY_PARTS = 4.0 / 3.0
# Trees that are learned at most until the drives that were held up are the same twice.
_MOST_ROUNDS = 5
_COLUMNS = {
    "duration": "duration",
    "success": "success",
    "accuracy": "position_error",
    "heading": "heading_error",
}
"""The column of an experience table for each measure that has one, of `MEASURES`."""
SMALL_LEAF = 50
"""Least number of episodes at a leaf of the trees of other measures than the duration."""
_AT_GOAL = ((0.02, 0.05), (0.03, 0.08))  # m and rad to the goal that may count as being there
_STOPG = direct_name(STOP)
_LEAST_PASSING = 5  # episodes that show how an action passes its goals
# share of passed legs that may come less near than expected: a goal that is missed costs seconds
_NEARLY_NONE = 0.02
# drives that were held up, and drives at a leaf, from which it is learned where drives are held up
_LEAST_HELD_UP = 5
_LEAF_OF_HELD_UP = 10
_LEAST_AT_GOAL = 3  # episodes that show how long an action takes there
# A robot may still be stopping when an action starts: this share of starts is slower than that.
_MOSTLY = 0.95
_STOPPING = 0.2  # m/s
_TURNED = 0.5  # rad, least turn at the goal for which the angle that is left is measured
_ALIKE = 0.15  # greatest difference in s of durations that count as the same there: three ticks


class WorseThanMeanError(ExperienceError):
    """A model predicts worse than the mean duration of its drives does."""


def train(
    action: str,
    rows: pd.DataFrame,
    robot: Robot,
    *,
    features: Sequence[Feature] = CANDIDATES,
    better_than_mean: bool = False,
) -> PerformanceModel:
    """Learn the performance model of an action (paper, section 3).

    Where drives are held up is learned if a tree predicts it better than their share does.
    Fewer than `LEAST_DRIVES` that succeeded correct the times of paths, see
    `ator_ros.performance.path_times`. Of more, the success is learned from all episodes: its rate
    if no tree is better. Durations are learned from those that succeeded and were not held up, see
    `ator_ros.performance.held_up`; the errors at the goal from those that succeeded, if enough
    episodes have them, see `without_errors`.

    Parameters
    ----------
    action : str
        Name of the action.
    rows : pandas.DataFrame
        Rows of the action in an experience table.
    robot : Robot
        The robot of the experience.
    features : sequence of Feature
        Candidate features.
    better_than_mean : bool
        Whether to reject a model that predicts worse than the mean duration does.

    Raises
    ------
    ExperienceError
        No episode succeeded, or rows lack a goal variable that a feature derives from.
    WorseThanMeanError
        With `better_than_mean`: the model predicts worse, or its errors are not finite.
    """
    for name in declared_by(features):
        missing = rows[name].isna().sum() if name in rows else len(rows)
        if missing:
            expected = "expected a value in each row of experience"
            raise ExperienceError(
                f"{action}: {name}: {expected}, {missing} of {len(rows)} have none"
            )
    features = suited(features, robot)
    starts = rows[rows["t"] == 0.0]
    starts = starts[routed(starts, robot, features)]
    good_starts = starts[starts["success"]]
    if good_starts.empty:
        remarks = "".join(without_routes(rows, robot, features))
        raise ExperienceError(
            f"{action}: expected episodes that succeeded, got none of {len(starts)}{remarks}"
        )
    if len(good_starts) < LEAST_DRIVES:
        of_paths = path_time_model(action, DEFAULT_SET, robot)
        return corrected(of_paths, direct_of(good_starts), good_starts["duration"].tolist())
    learned = _learned_undisturbed(rows, good_starts, robot, features)
    undisturbed = good_starts[~learned.held_up]
    errors = learned.errors[~learned.held_up]
    if better_than_mean:
        _check_errors(action, errors, undisturbed["duration"].to_numpy(dtype=float))
    examples = examples_of(starts, robot, learned.features, learned.driving)
    trees = {"duration": learned.tree}
    for measure in ("success", "accuracy", "heading"):
        values = examples[measure].values
        table = examples[measure].table[list(names_of(features))]
        if measure == "success":
            trees[measure] = _rate_tree(values, table)
        elif len(values) >= LEAST_DRIVES:
            trees[measure] = small_tree(table, values)
    if learned.held_up.sum() >= _LEAST_HELD_UP:
        table = learned.table[list(names_of(features))].reset_index(drop=True)
        tree = _rate_tree(learned.held_up.astype(float), table, leaf=_LEAF_OF_HELD_UP)
        if tree.used_features():
            trees["held_up"] = tree
    named = {feature.name: feature for feature in learned.features}
    table = learned.table[~learned.held_up]
    every = np.full(len(table), True)
    counted = _far_from_goal(table) if _stands(table) else every
    return PerformanceModel(
        action,
        robot,
        trees,
        named,
        driving=learned.driving,
        at_goal=_observed_at_goal(from_rest_to_rest(undisturbed), robot),
        arrival=observed_arrival(from_rest_to_rest(undisturbed), robot),
        passing=observed_passing(starts),
        errors=error_process(
            learned.tree, table[counted], errors[counted], examples["duration"].prior
        ),
        held_up=describe_held_up(learned.errors, learned.held_up),
    )


def _check_errors(action: str, errors: FloatArray, durations: FloatArray) -> None:
    """Raise WorseThanMeanError unless errors (n,) in s are at most those of the mean duration."""
    count = len(durations)
    of_mean = np.abs(durations - durations.mean()).mean() * count / (count - 1)
    of_model = np.abs(errors).mean()
    if not of_model <= of_mean + CONTROL_PERIOD:  # also if it is NaN
        raise WorseThanMeanError(
            f"{action}: expected a model that predicts better than the mean duration of {count} "
            f"drives, which errs by {of_mean:.3g} s, got errors of {of_model:.3g} s in "
            "cross-validation: do their goals and poses fit?"
        )


@dataclass(frozen=True, eq=False)
class _Learned:
    """A tree of durations that was learned from n drives that succeeded.

    Attributes
    ----------
    driving, features
        How the action was observed to drive, and the candidate features.
    table : pandas.DataFrame
        The features of all drives.
    tree : ModelTree
        Learned from the drives that were not held up.
    errors : ndarray, shape (n,)
        Actual less predicted durations in s, by trees that were learned without the drive.
    held_up : ndarray of bool, shape (n,)
        Which drives were held up.
    """

    driving: Driving | None
    features: tuple[Feature, ...]
    table: pd.DataFrame
    tree: ModelTree
    errors: FloatArray
    held_up: BoolArray


def _learned_undisturbed(
    rows: pd.DataFrame, starts: pd.DataFrame, robot: Robot, features: Sequence[Feature]
) -> _Learned:
    """Learn durations, and which drives were held up; `starts` are those that succeeded."""
    durations = starts["duration"].to_numpy(dtype=float)
    path = [ROUTE_TIME if ROUTE_TIME in features else PATHS[0]]
    path_times = feature_table(direct_of(starts), robot, path)[:, 0]
    values = clipped(durations, path_times)
    held = np.full(len(starts), False)
    for _ in range(_MOST_ROUNDS):
        learned = _learned_without(held, values, rows, starts, robot, features)
        predicted = durations - learned.errors
        follows_path = len(learned.tree.base) > 0
        found = find_held_up(durations, predicted, held, follows_path=follows_path)
        if (found == held).all() and (values == durations).all():
            break
        held = found
        values = durations
    return learned


def _learned_without(
    held: BoolArray,
    durations: FloatArray,
    rows: pd.DataFrame,
    starts: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
) -> _Learned:
    """Learn durations (n,) in s without the drives that were held up."""
    counted = ~held
    of_others = rows[~rows["episode"].isin(starts["episode"][held])] if held.any() else rows
    driving = robot.observed_driving(of_others) if set(features) & set(PATHS) else None
    of_durations = duration_features(features, starts[counted], driving)
    drives = examples_of(starts, robot, of_durations, driving)["duration"]
    parts = drives.parts
    if parts is not None and (durations == drives.values).all():
        parts = parts[counted]
    else:
        parts = None
    table = drives.table[counted].reset_index(drop=True)
    tree, errors = duration_tree(table, durations[counted], drives.prior, parts)
    predicted = np.empty(len(durations))
    predicted[counted] = durations[counted] - errors
    predicted[held] = tree.predict(drives.table.loc[held, list(tree.names)].to_numpy())
    return _Learned(driving, of_durations, drives.table, tree, drives.values - predicted, held)


@dataclass(frozen=True, eq=False)
class Examples:
    """Examples of one of `MEASURES`.

    Attributes
    ----------
    measure : str
        The measure.
    rows : ndarray of int, shape (n,)
        Positions of the examples among the starts.
    table : pandas.DataFrame
        Their features, in SI units.
    values : ndarray, shape (n,)
        Their values of the measure, in its unit.
    parts : ndarray, shape (n, 3), or None
        Times of the parts of the drives, see `part_times`; None on a map, and for other measures
        than the duration.
    prior : mapping of str to Slope
        How durations are assumed to depend on the features, see `prior_slopes`.
    """

    measure: str
    rows: IntArray
    table: pd.DataFrame
    values: FloatArray
    parts: FloatArray | None
    prior: Mapping[str, Slope]


def examples_of(
    starts: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    driving: Driving | None,
) -> dict[str, Examples]:
    """Return the examples of each measure: of success all, of the others those that succeeded.

    Parameters
    ----------
    starts : pandas.DataFrame
        First rows of episodes of an action, see `ator_ros.experience.table`.
    robot : Robot
        The robot of the experience.
    features : sequence of Feature
        The features to compute.
    driving : Driving or None
        How the action drives, if features depend on it.
    """
    table = features_of(starts, robot, features, driving)
    prior = prior_slopes(features, robot, driving)
    succeeded = starts["success"].to_numpy(dtype=bool)
    found = {}
    for measure, column in _COLUMNS.items():
        values = starts[column].to_numpy(dtype=float)
        used = np.isfinite(values)
        if measure != "success":
            used &= succeeded
        has_parts = measure == "duration" and robot.grid is None
        parts = part_times(starts[used]) if has_parts else None
        rows = np.flatnonzero(used)
        of_measure = table[used].reset_index(drop=True)
        found[measure] = Examples(
            measure,
            rows,
            of_measure,
            values[used],
            parts,
            prior,
        )
    return found


def without_errors(action: str, rows: pd.DataFrame) -> list[str]:
    """Return a remark on each error at the goal that some of the episodes that succeeded lack."""
    counted = (rows["t"] == 0.0) & rows["success"]
    if _STOPG in rows:  # the heading of a goal that is passed is no error
        counted &= rows[_STOPG] != 0.0
    errors = rows.loc[counted, ["position_error", "heading_error"]]
    return [
        f"{action}: {name}: {count} of {len(errors)} episodes have none and are left out"
        for name, count in errors.isna().sum().items()
        if 0 < count < len(errors)
    ]


def routed(
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
) -> BoolArray:
    """Return which rows of an experience table have a route on the map, shape (n,).

    Without a map all rows do.
    """
    lengths = [feature for feature in features if feature.name == _LENGTH]
    table = feature_table(direct_of(rows), robot, lengths)
    return np.asarray(np.isfinite(table).all(axis=1))


def without_routes(
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
) -> list[str]:
    """Return a remark on episodes without a route on the map, if there are any."""
    found = routed(rows[rows["t"] == 0.0], robot, features)
    text = (
        "have no route on the map and are left out: is it the map of these drives, in their frame?"
    )
    return [] if found.all() else [f": {(~found).sum()} of {len(found)} episodes {text}"]


def duration_features(
    features: Sequence[Feature], starts: pd.DataFrame, driving: Driving | None
) -> tuple[Feature, ...]:
    """Return the candidate features of durations.

    These are `features`, and those that the base adds if the action drives so that they matter.
    The latter are candidates only without a map, and if the action drives from rest to rest.

    Parameters
    ----------
    features : sequence of Feature
        Candidates of all measures.
    starts : pandas.DataFrame
        First rows of the episodes of the action.
    driving : Driving or None
        How the action was observed to drive.
    """
    names = {*names_of(features)}
    is_drive = {*RISING} <= names and _LENGTH not in names
    if driving is not None and driving.uses_quantities and is_drive and _is_at_rest(starts):
        return tuple(dict.fromkeys((*features, *base_features(type(driving)))))
    return tuple(features)


def error_process(
    tree: ModelTree, table: pd.DataFrame, errors: FloatArray, prior: Mapping[str, Slope]
) -> ErrorProcess:
    """Return the process of the errors of a tree of durations.

    Its features are those of the tree, and those that durations rise with.

    Parameters
    ----------
    tree : ModelTree
        The tree.
    table : pandas.DataFrame
        Features of n episodes that succeeded; those of the tree are among them.
    errors : array of float, shape (n,)
        Actual less predicted durations in s, by trees that were learned without the episode.
    prior : mapping of str to Slope
        How durations are assumed to depend on the features, see `prior_slopes`.
    """
    rising = filter(table.columns.__contains__, rising_in(table.columns))
    names = list(dict.fromkeys((*tree.names, *rising)))
    return fit_error_process({name: prior[name] for name in names}, table[names].to_numpy(), errors)


def features_of(
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    driving: Driving | None,
) -> pd.DataFrame:
    """Return the features of n rows of an experience table, a column for each, in SI units."""
    table = feature_table(direct_of(rows), robot, features, driving)
    return pd.DataFrame(table, columns=list(names_of(features)))


def duration_tree(
    table: pd.DataFrame,
    durations: FloatArray,
    prior: Mapping[str, Slope],
    parts: FloatArray | None = None,
) -> tuple[ModelTree, FloatArray]:
    """Learn a tree of durations.

    The tree predicts, in the first of these cases that holds:

    - the whole duration, if path times are not among the features;
    - the difference to a sum of rising terms, if the robot stands at both ends: the sum has no
      jumps at thresholds that a search could exploit, except where the robot begins to drive
      backward;
    - the whole duration, if the action does not follow its path to the end, such as a shot;
    - the difference to the time of the path: linear models of whole durations would fall below it
      where the robot can hardly brake or turn in time, and a search selects such predictions.

    Parameters
    ----------
    table : pandas.DataFrame
        Features of n episodes that succeeded.
    durations : array of float, shape (n,)
        Their durations in s.
    prior : mapping of str to Slope
        How durations are assumed to depend on the features, see `prior_slopes`.
    parts : array of float, shape (n, 3), optional
        Times of their parts in s, NaN where unknown; see `part_times`.

    Returns
    -------
    tree : ModelTree
        The tree, with the features that it needs.
    errors : array of float, shape (n,)
        Actual less predicted durations in s, in cross-validation.
    """
    if _PATH not in table:
        tree, errors = _best_learning(table, durations, _whole, extrapolation=1.0)
    elif _stands(table):
        tree, errors = _on_sum(table, durations, parts, prior)
    else:
        late = durations - table[_PATH].to_numpy()
        earliest = np.quantile(late, _FASTER_SHARE, method="lower")
        faster = earliest < -_FASTER_BY * np.median(durations)
        tree, errors = _best_learning(table, durations, _whole if faster else _minus_path)
    spread = np.where(tree.is_leaf, np.maximum(tree.spread, TIMING), 0.0)
    return dataclasses.replace(tree, spread=spread).narrowed(), errors


def _on_sum(
    table: pd.DataFrame,
    durations: FloatArray,
    parts: FloatArray | None,
    prior: Mapping[str, Slope],
) -> tuple[ModelTree, FloatArray]:
    """Return a tree on top of a sum of rising terms, and its errors as `duration_tree` does."""
    rising = rising_in(table.columns)
    basic = table[[*rising, "route_time" if _LENGTH in rising else _PATH]]
    learn = partial(
        _best_learning,
        basic,
        durations,
        leaf=_SMALL_LEAF,
        folds=_FOLDS,
    )
    drives = _far_from_goal(table)
    if parts is None or _STOPG in table:  # a drive that is passed has no turn at its end
        parts = np.full((len(table), 1), np.nan)
    known = np.isfinite(parts).all(axis=1)
    if (drives & known).sum() < LEAST_DRIVES:
        return learn(partial(_minus_terms, parts=None, prior=prior))
    # By parts, the terms have the thresholds of the turns: the tree splits by distance only.
    of_parts = pd.DataFrame(parts, table.index)
    terms_by_parts = partial(_minus_terms, parts=of_parts, prior=prior)
    by_parts = learn(terms_by_parts, tree_features=basic.columns[:1])
    without_straights = table.drop(columns=list(OF_DIRECTION), errors="ignore")
    by_whole = _on_sum(without_straights, durations, None, prior)
    error_by_parts = np.abs(by_parts[1][drives]).mean()
    error_by_whole = np.abs(by_whole[1][drives]).mean()
    mostly_known = 2 * (drives & known).sum() >= drives.sum()
    most = _MOST_BY_PARTS if mostly_known else 1.0
    return by_parts if error_by_parts < most * error_by_whole else by_whole


def _stands(table: pd.DataFrame) -> bool:
    """Return whether the robot stands at both ends, or features show where it passes."""
    if _STOPG in table:
        return True
    needed = {*rising_in(table.columns), _PATH, "v", "speedg"}
    return needed <= set(table.columns) and _is_at_rest(table)


def from_rest_to_rest(starts: pd.DataFrame) -> pd.DataFrame:
    """Return the episodes that neither start nor end in passing; all of an action without those."""
    if _STOPG not in starts:
        return starts
    return starts[(starts[_STOPG] == 1.0) & (starts["v"].abs() <= DRIVES_ON)]


def observed_passing(starts: pd.DataFrame) -> Passing | None:
    """Return how an action passes its goals; None if hardly any episode shows that.

    Parameters
    ----------
    starts : pandas.DataFrame
        First rows of episodes that were not held up, also of those that missed their goals.
    """
    if _STOPG not in starts:
        return None
    nearer = starts["nearer"].dropna()
    speeds = starts.loc[starts["v"] > DRIVES_ON, "v"]
    if len(speeds) < _LEAST_PASSING:
        return None
    is_known = len(nearer) >= _LEAST_PASSING
    least = float(nearer.quantile(_NEARLY_NONE)) if is_known else 0.0
    return Passing(least, float(speeds.median()))


def _is_at_rest(rows: pd.DataFrame) -> bool:
    """Return whether the robot stands at the goals, and hardly moves at the starts of episodes."""
    arriving = rows["speedg"].abs()
    starting = rows["v"].abs()
    return bool(arriving.max() <= AT_REST.speed and starting.quantile(_MOSTLY) <= _STOPPING)


def _far_from_goal(table: pd.DataFrame) -> BoolArray:
    """Return which episodes have a goal away from their start; all, if those are too few."""
    distance, *_ = rising_in(table.columns)
    far: BoolArray = table[distance].to_numpy() > NEAR_GOAL
    return far if far.sum() >= LEAST_DRIVES else np.full(len(far), True)


_Fitted = tuple[tuple[Hinge, ...], FloatArray]
_Base = Callable[[pd.DataFrame, FloatArray], _Fitted]
"""Returns the terms that fit durations, and the target (n,) of the tree.

The target is the durations less these terms, in s.
"""


def _whole(_: pd.DataFrame, durations: FloatArray) -> _Fitted:
    return (), durations


def _minus_path(table: pd.DataFrame, durations: FloatArray) -> _Fitted:
    late = durations - table[_PATH].to_numpy()
    usual = float(np.median(late))
    spread = float(np.median(np.abs(late - usual)))
    return (Hinge(_PATH, 0.0, 1.0),), np.maximum(late, usual - _CLIPPED_AT * spread)


def _minus_terms(
    table: pd.DataFrame,
    durations: FloatArray,
    *,
    parts: pd.DataFrame | None,
    prior: Mapping[str, Slope],
) -> _Fitted:
    times = durations[:, None]
    if parts is not None:
        times = parts.loc[table.index].to_numpy()
    used = _far_from_goal(table) & np.isfinite(times).all(axis=1)
    base = rising_terms(table[used], times[used], prior)
    return base, durations - sum_of(base, table)


def _best_learning(
    table: pd.DataFrame,
    durations: FloatArray,
    base_of: _Base,
    *,
    extrapolation: float = 0.0,
    leaf: int = _LEAF,
    folds: int = _FEW_FOLDS,
    tree_features: Sequence[str] | None = None,
) -> tuple[ModelTree, FloatArray]:
    """Return the tree of the best of `_SMOOTHINGS`, and its errors in cross-validation, shape (n,).

    The tree itself uses `tree_features`, by default all of `table`. Errors are in s.
    """
    used = table if tree_features is None else table[list(tree_features)]
    fold = np.arange(len(durations)) % folds
    errors = np.empty((len(_SMOOTHINGS), len(durations)))
    learners = [
        ModelTreeRegressor(smoothing=each, extrapolation=extrapolation, min_samples_leaf=leaf)
        for each in _SMOOTHINGS
    ]
    for number in range(folds):
        held = fold == number
        base, target = base_of(table[~held], durations[~held])
        values = durations[held] - sum_of(base, table[held])
        for at, learner in enumerate(learners):
            learner.fit(used[~held], target)
            errors[at, held] = values - learner.predict(used[held])
    base, target = base_of(table, durations)
    best = int(np.argmin(np.abs(errors).sum(axis=1)))
    tree: ModelTree = learners[best].fit(used, target).tree_
    with_base = dataclasses.replace(tree.over(tuple(table)), base=base)
    return with_base, errors[best]


def small_tree(
    table: pd.DataFrame,
    values: FloatArray,
    *,
    leaf: int = SMALL_LEAF,
) -> ModelTree:
    """Learn a tree of at most eight leaves, for a measure that depends little on the situation.

    Parameters
    ----------
    table : pandas.DataFrame
        Features of n episodes.
    values : array of float, shape (n,)
        The measure, in its unit.
    leaf : int
        Least number of episodes at a leaf.
    """
    tree = ModelTreeRegressor(max_leaves=8, min_samples_leaf=leaf, extrapolation=0.0)
    learned: ModelTree = tree.fit(table, values).tree_
    return learned.narrowed()


def _rate_tree(happened: FloatArray, table: pd.DataFrame, *, leaf: int = SMALL_LEAF) -> ModelTree:
    """Learn a probability: a constant rate, unless a tree predicts it better."""
    # A few failures make leaves of any shape, and refinement would avoid each, as failures cost
    # much. So the tree must have a smaller squared error (Brier score) in cross-validation, by two
    # standard errors.
    fold = np.arange(len(happened)) % _FOLDS
    gains = np.zeros(len(happened))
    for number in range(_FOLDS if happened.min() < happened.max() else 0):
        held = fold == number
        seen = fold != number
        tree = small_tree(table[seen], happened[seen], leaf=leaf)
        features = table.loc[held, list(tree.names)].to_numpy()
        predicted = tree.predict(features).clip(0.0, 1.0)
        error_of_rate = (happened[seen].mean() - happened[held]) ** 2
        gains[held] = error_of_rate - (predicted - happened[held]) ** 2
    standard_error = gains.std() / math.sqrt(len(gains))
    if gains.mean() > 2.0 * standard_error:
        return small_tree(table, happened, leaf=leaf)
    return small_tree(table, np.full(len(happened), happened.mean()))


def _observed_at_goal(starts: pd.DataFrame, robot: Robot) -> AtGoal | None:
    """Return how long an action takes at its goal, from first rows of episodes that succeeded."""
    # The bounds are the widest within which durations hardly differ; if they differ next to the
    # goal, None.
    geometry = Geometry(direct_of(starts), robot)
    durations = starts["duration"].to_numpy(dtype=float)
    angle = geometry.rows[ANGLE_BETWEEN]
    at_rest = geometry.rows[RESTS] > 0.5
    found = UNOBSERVED
    for dist, most in ((found.dist, found.angle), *_AT_GOAL):
        within = durations[at_rest & (geometry.dist <= dist) & (angle <= most)]
        if len(within) < _LEAST_AT_GOAL:
            continue
        if np.ptp(within) > _ALIKE:
            return None if dist == UNOBSERVED.dist else found
        mean = max(float(within.mean()), CONTROL_PERIOD)
        spread = max(float(within.std()), CONTROL_PERIOD)
        found = AtGoal(dist, most, mean, spread)
    return found


def observed_arrival(starts: pd.DataFrame, robot: Robot) -> Arrival | None:
    """Return how far short of its goals an action stops, in m and rad.

    These are the median errors at the end. None if the robot does not stand at both ends.

    Parameters
    ----------
    starts : pandas.DataFrame
        First rows of episodes that succeeded.
    robot : Robot
        The robot of the experience.
    """
    if not _is_at_rest(starts):
        return None
    angle = GENERAL["angle_at_dest"] if robot.grid is None else ROUTE_ANGLE_AT
    turned = feature_table(direct_of(starts), robot, [angle])[:, 0] > _TURNED
    dist = starts["position_error"].median()
    angle_left = starts.loc[turned, "heading_error"].median()
    return Arrival(*np.nan_to_num([dist, angle_left]).tolist())


def direct_of(rows: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the direct variables of n rows of an experience table, arrays of shape (n,) by name.

    Declared goal variables are among them if any row has a value.
    """
    declared = map(direct_name, goal_variables_of_columns(rows.columns))
    names = (
        *DIRECT_VARIABLES,
        *(name for name in declared if rows[name].notna().any()),
    )
    return {name: rows[name].to_numpy(dtype=float) for name in names}


def start_ranges(rows: pd.DataFrame, robot: Robot) -> dict[str, list[float]]:
    """Return the least and the greatest value of quantities at the starts of episodes, by name.

    These are "way", the distance in m to the goal's place from the axle or the hold, whichever the
    goal is for; "turn", the angle in rad between both headings; "v" and "speedg", the speeds in m/s
    at both ends.
    """
    starts = rows[rows["t"] == 0.0]
    between = (starts["yawg"] - starts["yaw"]).to_numpy(dtype=float)
    columns = {
        "way": _distances(starts, robot),
        "turn": np.abs(wrap_angles(between)),
        "v": starts["v"],
        "speedg": starts["speedg"],
    }
    return {name: [float(values.min()), float(values.max())] for name, values in columns.items()}


def _distances(starts: pd.DataFrame, robot: Robot) -> FloatArray:
    """Return the distances in m to the goal's place, from the axle or hold that the goal is for."""
    back = robot.hold * starts["hold"] if robot.holder is not None else 0.0
    distances: FloatArray = np.hypot(
        starts["xg"] - starts["x"] - back * np.cos(starts["yaw"]),
        starts["yg"] - starts["y"] - back * np.sin(starts["yaw"]),
    ).to_numpy(dtype=float)
    return distances


def digest(rows: pd.DataFrame) -> str:
    """Return a digest of the rows that a model was learned from: 16 hexadecimal digits."""
    names = [*direct_of(rows), "t", "time_to_go", "success"]
    numbers = np.ascontiguousarray(rows[names].to_numpy(dtype=float))
    return hashlib.sha256(numbers.tobytes()).hexdigest()[:16]
