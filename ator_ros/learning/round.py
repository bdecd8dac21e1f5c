"""One round of learning: from the store of records to a new set of models, if one is better."""

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
from ator_ros.learning.candidates import Records, TrainingData, constant
from ator_ros.learning.judging import RoundVerdict, judge
from ator_ros.learning.sets import (
    RECORDS,
    Change,
    current_set,
    new_set_folder,
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

_LEAST_RECORDS = 12  # to estimate the mean of a measure
_SPREADS = (0.5, 10.0)  # least and greatest factor by which spreads change


@dataclass(frozen=True)
class ActionVerdict:
    """Result of a round of learning for an action.

    Attributes
    ----------
    measures : mapping
        Verdict on each measure.
    model : PerformanceModel or None
        The model with the better trees; None if no tree is better.
    """

    measures: Mapping[str, RoundVerdict]
    model: PerformanceModel | None


def improved(
    action: str,
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    *,
    current: PerformanceModel | None,
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
    current : PerformanceModel or None
        The model in use.
    seen : mapping
        Measure to the number from which on records are new to its tree.
    former : mapping
        Models that were in use before, by the names of their sets, and those of the start.
    """
    rows = _plausible(_complete(rows, features))
    driving = current.driving if current is not None else _driving(rows, robot, features)
    kinds = _kinds(current, former)
    former = {
        name: model
        for name, model in former.items()
        if model.driving == driving and kinds_of(model.features.values()) == kinds
    }
    models = [*former.values(), *([current] if current is not None else [])]
    known = {feature.name: feature for feature in features}
    for model in models:
        known |= model.features
    known = with_kinds(known, kinds) if kinds else known  # also those that no model uses
    records = Records(rows, robot, known, driving)
    names = [feature.name for feature in features]
    verdicts: dict[str, RoundVerdict] = {}
    for measure in MEASURES:
        verdicts[measure] = judge(
            records.data(measure),
            names,
            current=current.trees.get(measure) if current is not None else None,
            seen=seen.get(measure, 0),
            former=_trees(measure, former, current),
        )
    better = {measure: verdict.tree for measure, verdict in verdicts.items() if verdict.tree is not None}
    if current is None and "duration" not in better:
        # A model needs a tree of durations.
        kept = {name: dataclasses.replace(found, kind="", tree=None) for name, found in verdicts.items()}
        return ActionVerdict(kept, None)
    if not better:
        return ActionVerdict(verdicts, None)
    if "duration" in better:
        better["duration"] = with_observed_spread(
            better["duration"], records.data("duration"), verdicts["duration"]
        )
    trees = dict(current.trees) if current is not None else _means(records)
    trees |= better
    chosen = {measure: trees[measure] for measure in MEASURES if measure in trees}
    at_goal = current.at_goal if current is not None else UNOBSERVED
    model = PerformanceModel(action, robot, chosen, known, driving=driving, at_goal=at_goal)
    return ActionVerdict(verdicts, model)


def _kinds(current: PerformanceModel | None, former: Mapping[str, PerformanceModel]) -> Kinds:
    """Return the kinds of motion of the model in use or, without one, of a former model."""
    known = [current] if current is not None else list(former.values())
    return next(filter(None, (kinds_of(model.features.values()) for model in known)), {})


def _trees(
    measure: str, models: Mapping[str, PerformanceModel], current: PerformanceModel | None
) -> dict[str, ModelTree]:
    """Return the trees of a measure that are not in use, each once."""
    present = current.trees.get(measure) if current is not None else None
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
    """Return the episodes with a value of each goal variable that the action declares."""
    there = set(map(direct_name, goal_variables_of_columns(rows.columns)))
    wanted = declared_by(features)
    if not there.issuperset(wanted):
        return rows[:0]
    return rows[rows[list(wanted)].notna().all(axis=1)]


def _driving(rows: pd.DataFrame, robot: Robot, features: Sequence[Feature]) -> DrivingStyle | None:
    return observed_driving(rows, robot) if set(features) & set(PATHS) and len(rows) else None


def _means(records: Records) -> dict[str, ModelTree]:
    """Return constant trees of the means of the measures, for an action without a model."""
    by_measure = {measure: records.data(measure) for measure in MEASURES}
    return {
        measure: constant(data.table.columns[0], float(np.mean(data.values)), len(data.values))
        for measure, data in by_measure.items()
        if len(data.values) >= _LEAST_RECORDS
    }


def with_observed_spread(tree: ModelTree, data: TrainingData, verdict: RoundVerdict) -> ModelTree:
    """Return the tree with spreads as large as its errors on the test records."""
    assert verdict.error is not None
    table = data.table[list(tree.names)].to_numpy()[-verdict.tested :]
    expected = float(np.median(tree.predict_with_spread(np.ascontiguousarray(table))[1]))
    factor = float(np.clip(verdict.error / expected, *_SPREADS)) if expected > 0.0 else 1.0
    return dataclasses.replace(tree, spread=factor * tree.spread)


def _plausible(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the episodes without successes of an impossible duration; a failure may take any time."""
    durations, good = rows["duration"].to_numpy(dtype=float), rows["success"].to_numpy(dtype=bool)
    usual = float(np.median(durations[good])) if good.any() else 0.0
    return rows[~good | ((durations > 0.0) & (durations < max(10.0 * usual, 1.0)))]


CAUTION = ThresholdGate(0.05, 0.5)
"""Gate of models without one: it accepts more as their spreads, and with them their errors, shrink."""
_FORMER = 3  # earlier sets whose models are candidates
_STARTED_WITH = "the models of the start"


@dataclass(frozen=True)
class Source:
    """What a round of learning starts from.

    Attributes
    ----------
    folder : Path
        Folder of the learned sets and the store of records.
    domain : Domain
        The domain.
    robot : Robot
        The robot.
    models : Path
        Folder of the models that the node was started with; it may be missing.
    observed : bool
        Whether to use observed features only, without ideal times of actions.
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
        """Return the model of an action in the folder of a set; None if there is none."""
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
    """Compare models, and make a new set if one is better; it is not published.

    Parameters
    ----------
    source : Source
        Records and models.
    time : str
        Time of the set, for its manifest.

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
    better = any(verdict.model for verdict in verdicts.values())
    made = _make_set(source, place, verdicts, seen, ends, time) if better else {}
    actions = {
        _key(name, measure): {field: value for field, value in vars(found).items() if field != "tree"}
        for name, verdict in verdicts.items()
        for measure, found in verdict.measures.items()
    }
    return {"made": "", "digest": "", **made, "damaged": damaged, "actions": actions}


def _key(name: str, measure: str) -> str:
    """Return the name of a measure of an action, SET/ACTION, in manifests and diagnostics."""
    return name if measure == "duration" else f"{name}/{measure}"


def _verdict(
    source: Source, action: str, action_set: str, rows: pd.DataFrame, seen: Mapping[str, int]
) -> ActionVerdict:
    place = current_set(source.folder)
    current = source.model(place or source.models, action, action_set)
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
        current=current,
        seen={measure: seen.get(_key(f"{action_set}/{action}", measure), 0) for measure in MEASURES},
        former=former,
    )


def _make_set(
    source: Source,
    place: Path | None,
    verdicts: Mapping[str, ActionVerdict],
    seen: Mapping[str, int],
    ends: Mapping[str, int],
    time: str,
) -> dict[str, Any]:
    """Make a set of the present one and the better models; return its folder and digest."""
    made = new_set_folder(source.folder)
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
        # Kept, since records of refined chains cover less of the ranges of starts.
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
    """Remove the corrections of models that changed: trees fitted to executed chains have no bias."""
    folder = (made / model_path("any", action_set)).parent
    try:
        calibration = load_calibration_if_any(folder)
    except RefinementError:
        (folder / CALIBRATION).unlink()
        return
    models = {action: source.model(made, action, action_set) for action in calibration.shortfalls}
    if calibration.shortfalls:
        save_calibration(folder / CALIBRATION, calibration.matching(models), {"command": "learning"})
