"""One round of learning: from the store of records to a new set of models, if it is better."""

from __future__ import annotations

import dataclasses
import shutil
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions.goal_variables import direct_name
from ator_ros.domains.domain import Domain
from ator_ros.evaluation.gate_from_episodes import usual_widths
from ator_ros.experience.columns import goal_variables_of_columns
from ator_ros.experience.store import NUMBER, action_sets_in, read_records
from ator_ros.experience.table import library_versions
from ator_ros.learning.candidates import Lessons, Records, constant
from ator_ros.learning.judging import RoundVerdict, judge
from ator_ros.learning.sets import (
    RECORDS,
    Change,
    begin,
    current_set,
    read_manifest,
    seal,
    sets_in,
)
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import OBSERVED, PATHS, Feature, Kinds, declared_by, kinds_of, with_kinds
from ator_ros.performance.model import MEASURES, UNOBSERVED, PerformanceModel
from ator_ros.performance.model_file import (
    ModelFileError,
    RobotMismatchWarning,
    is_model,
    load_model,
    model_path,
    save_model,
)
from ator_ros.performance.training import observed_driving
from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.refinement import RefinementError
from ator_ros.refinement.calibration import CALIBRATION, load_calibration_if_any, save_calibration
from ator_ros.refinement.gate import ThresholdGate, save_gate
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


CAUTION = ThresholdGate(0.05, 0.5)
"""Gate of models that come with none: it opens as their spreads, as large as their errors, shrink."""
_FORMER = 3  # sets before the present one that are tried again
_STARTED_WITH = "the models of the start"


@dataclass(frozen=True)
class Source:
    """What is learned from.

    Attributes
    ----------
    folder : Path
        Of the learned sets, with the store of records in it.
    domain : Domain
        Of the actions.
    robot : Robot
        That executes them.
    models : Path
        Folder of the models that the node was started with; there may be none.
    observed : bool
        Whether features know nothing but what was observed.
    """

    folder: Path
    domain: Domain
    robot: Robot
    models: Path
    observed: bool = False

    def features(self, action: str, action_set: str) -> tuple[Feature, ...]:
        """Return the candidate features of an action."""
        if not self.observed:
            return self.domain.candidates(action, action_set)
        return (*OBSERVED, *self.domain.goal_features(action, action_set))

    def model(self, place: Path, action: str, action_set: str) -> PerformanceModel | None:
        """Return the model of an action in the folder of a set; None where there is none."""
        file = place / model_path(action, action_set)
        if not file.exists():
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RobotMismatchWarning)
            try:
                return load_model(file, self.robot, self.domain.known_features)
            except ModelFileError:
                return None  # the nodes report it


def learn(source: Source, *, time: str) -> dict[str, Any]:
    """Compare, and make a new set where a model is better; it is not published.

    Parameters
    ----------
    source : Source
        What is learned from.
    time : str
        Written into the set.

    Returns
    -------
    dict
        "made": the folder of the new set, "" without one; "digest" of it; "damaged": records that could not
        be read; "actions": by "SET/ACTION" for durations, "SET/ACTION/MEASURE" for others, the fields of
        `RoundVerdict` but the tree.
    """
    records, place = source.folder / RECORDS, current_set(source.folder)
    seen = read_manifest(place).seen if place is not None else {}
    verdicts: dict[str, ActionVerdict] = {}
    ends: dict[str, int] = {}
    damaged = 0
    for action_set in action_sets_in(records):
        if action_set not in source.domain.action_sets:
            continue
        stored = read_records(records, action_set)
        damaged += stored.damaged
        for action, rows in stored.rows.groupby("action", sort=True):
            if action in source.domain.actions(action_set):
                name = f"{action_set}/{action}"
                verdicts[name] = _verdict(source, str(action), action_set, rows, seen)
                ends[name] = int(rows[NUMBER].max()) + 1
    made = _made(source, place, verdicts, seen, ends, time) if any(v.model for v in verdicts.values()) else {}
    told = {
        _key(name, measure): {field: value for field, value in vars(found).items() if field != "tree"}
        for name, verdict in verdicts.items()
        for measure, found in verdict.measures.items()
    }
    return {"made": "", "digest": "", **made, "damaged": damaged, "actions": told}


def _key(name: str, measure: str) -> str:
    """Return what manifests and diagnostics call a measure of an action, SET/ACTION."""
    return name if measure == "duration" else f"{name}/{measure}"


def _verdict(
    source: Source, action: str, action_set: str, rows: pd.DataFrame, seen: Mapping[str, int]
) -> ActionVerdict:
    place = current_set(source.folder)
    now = source.model(place or source.models, action, action_set)
    former: dict[str, PerformanceModel] = {}
    earlier = [other for other in sets_in(source.folder) if place is None or other.name < place.name]
    for other in (*((source.models,) if place else ()), *(earlier[-_FORMER:] if place else ())):
        model = source.model(other, action, action_set)
        if model is not None:
            former[_STARTED_WITH if other == source.models else f"set {other.name[:6]}"] = model
    return improved(
        action,
        rows,
        source.robot,
        source.features(action, action_set),
        now=now,
        seen={measure: seen.get(_key(f"{action_set}/{action}", measure), 0) for measure in MEASURES},
        former=former,
    )


def _made(
    source: Source,
    place: Path | None,
    verdicts: Mapping[str, ActionVerdict],
    seen: Mapping[str, int],
    ends: Mapping[str, int],
    time: str,
) -> dict[str, Any]:
    """Make a set of the present one and the better models; return its folder and digest."""
    made = begin(source.folder)
    changes: list[Change] = []
    known = dict(seen)
    for action_set in source.domain.action_sets:
        _copy(place or source.models, made, action_set)
    for name, verdict in verdicts.items():
        if verdict.model is None:
            continue
        action_set, action = name.split("/")
        better = _changes(action_set, action, verdict)
        kinds = "; ".join(f"{change.measure}: {change.kind}" for change in better)
        episodes = max(found.episodes for found in verdict.measures.values())
        former = source.model(place or source.models, action, action_set)
        # Where the search may go: records of chains that were refined themselves tell less of it.
        known_starts = {"starts": former.experience} if former is not None and former.experience else {}
        metadata = {
            "action_set": action_set,
            "training": {"command": "learning", "kind": kinds, "episodes": episodes, **known_starts},
            "versions": library_versions(),
            "robot_digest": source.robot.digest(),
        }
        model = dataclasses.replace(verdict.model, metadata=metadata)
        save_model(made / model_path(action, action_set), model)
        changes += better
        known |= {_key(name, change.measure): ends[name] for change in better}
        gate = made / model_path("gate", action_set)
        if not gate.exists():
            widths = usual_widths(source.robot) if source.observed else {}
            cautious = dataclasses.replace(CAUTION, widths=widths)
            save_gate(gate, cautious, {"command": "learning"}, action_set)
    for action_set in {change.action_set for change in changes}:
        _keep_matching(source, made, action_set)
    manifest = {
        "time": time,
        "parent": place.name if place is not None else "",
        "episodes": {
            name: max(found.episodes for found in verdict.measures.values())
            for name, verdict in verdicts.items()
        },
        "seen": known,
    }
    return {"made": str(made), "digest": seal(made, manifest, tuple(changes))}


def _changes(action_set: str, action: str, verdict: ActionVerdict) -> list[Change]:
    """Return why the trees of an action's model were replaced."""
    return [
        Change(action_set, action, found.kind, found.tested, found.before, found.after, found.chance, measure)
        for measure, found in verdict.measures.items()
        if found.tree is not None and found.after is not None and found.chance is not None
    ]


def _copy(place: Path, made: Path, action_set: str) -> None:
    """Copy the files of an action set."""
    folder = model_path("any", action_set).parent
    (made / folder).mkdir(exist_ok=True)
    for file in (place / folder).glob("*.json"):
        if is_model(file) or file.stem in ("gate", "calibration"):
            shutil.copyfile(file, made / folder / file.name)


def _keep_matching(source: Source, made: Path, action_set: str) -> None:
    """Keep of the calibration what belongs to models that stay; the others need none: they have no bias."""
    folder = (made / model_path("any", action_set)).parent
    try:
        calibration = load_calibration_if_any(folder)
    except RefinementError:
        (folder / CALIBRATION).unlink()
        return
    models = {action: source.model(made, action, action_set) for action in calibration.shortfalls}
    if calibration.shortfalls:
        save_calibration(folder / CALIBRATION, calibration.matching(models), {"command": "learning"})
