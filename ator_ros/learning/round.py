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
from scipy.ndimage import median_filter

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.experience.store import NUMBER, action_sets_in, read_records
from ator_ros.experience.table import library_versions
from ator_ros.files import FileError
from ator_ros.geometry import BoolArray, FloatArray, IntArray
from ator_ros.learning.judging import RoundVerdict, constant_tree, judge
from ator_ros.learning.sets import (
    RECORDS,
    Manifest,
    current_set,
    new_set_folder,
    read_manifest,
    seal,
    sets_in,
)
from ator_ros.performance.error_process import ErrorProcess
from ator_ros.performance.features import Feature, declared_by, names_of, suited
from ator_ros.performance.held_up import describe_held_up, find_held_up
from ator_ros.performance.model import MEASURES, PerformanceModel
from ator_ros.performance.model_file import (
    RobotMismatchWarning,
    load_model,
    model_path,
    models_folder,
    save_model,
)
from ator_ros.performance.path_times import path_time_model
from ator_ros.performance.training import (
    Examples,
    direct_of,
    duration_features,
    error_process,
    examples_of,
    from_rest_to_rest,
    observed_arrival,
    observed_passing,
    routed,
)
from ator_ros.world.state import CONTROL_PERIOD

_LEAST_RECORDS = 12  # to estimate the mean of a measure
_RECORDS_FOR_ANGLE = 100  # to learn, once, above which angle an action drives backward
_NEIGHBORS = 15  # drives, to whose median predictions are scaled: fewer would follow delays
_FORMER = 3  # earlier sets whose models are candidates

Verdicts = dict[str, RoundVerdict]
"""The verdict on each measure of an action."""


def _improved(
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    *,
    current: PerformanceModel,
    seen: Mapping[str, int],
    former: Mapping[str, PerformanceModel],
) -> tuple[Verdicts, PerformanceModel | None]:
    """Judge each tree of an action's model on the newest records.

    Return a model if some tree is better. `rows` are the starts of episodes, oldest first, with
    `NUMBER`; `seen` is the number from which on they are new, by measure; `former` are models that
    were in use before.
    """
    features = suited(features, robot)
    rows = _usable(rows, features)
    rows = rows[routed(rows, robot, features)]
    succeeded = rows[rows["success"]]
    delays, held = _delays(succeeded, current)
    held_up = describe_held_up(delays, held)
    rows = rows.drop(succeeded.index[held])
    succeeded = succeeded[~held]
    driving = current.driving
    if driving is not None and len(rows) >= _RECORDS_FOR_ANGLE:
        # Present trees have no features that depend on what the driving leaves open.
        driving = robot.completed_driving(driving, succeeded)
    former = {name: model for name, model in former.items() if model.driving == driving}
    of_durations = duration_features(features, succeeded, driving)
    known = {feature.name: feature for feature in of_durations}
    for other in (*former.values(), current):
        known |= other.features
    with np.errstate(all="ignore"):  # records may be of any situation
        examples = examples_of(rows, robot, tuple(known.values()), driving)
    trees = dict(current.trees)
    verdicts: Verdicts = {}
    for measure, found in examples.items():
        names = names_of(of_durations if measure == "duration" else features)
        new = rows[NUMBER].to_numpy()[found.rows] >= seen[measure]
        verdicts[measure] = judge(
            found,
            names,
            new=int(new.sum()),
            # Path times are no candidate: a tree of twenty drives predicts later ones better.
            current=trees.get(measure) if current.is_learned else None,
            former={
                name: model.trees[measure]
                for name, model in former.items()
                if measure in model.trees
            },
        )
    better = {name: found.tree for name, found in verdicts.items() if found.tree is not None}
    if not current.is_learned and "duration" not in better:  # path times need no file
        for name, verdict in verdicts.items():
            verdicts[name] = dataclasses.replace(verdict, kind="", tree=None)
        return verdicts, None
    errors = current.errors
    durations = examples["duration"]
    judged = verdicts["duration"]
    if judged.tree is not None and judged.errors is not None:
        tested = durations.table.iloc[judged.tested]
        errors = error_process(judged.tree, tested, judged.errors, durations.prior)
    elif current.is_learned:
        unseen = rows[NUMBER].to_numpy()[durations.rows] >= seen["duration"]
        errors = _better_known(current, durations, np.flatnonzero(unseen))
    if not better and errors is current.errors:
        return verdicts, None
    if not current.is_learned:  # measures without a better tree are predicted by their means
        for name, found in examples.items():
            if name not in trees and len(found.values) >= _LEAST_RECORDS:
                trees[name] = constant_tree(found.table, found.values)
    trees |= better
    return verdicts, dataclasses.replace(
        current,
        trees=trees,
        features=known,
        driving=driving,
        errors=errors,
        arrival=observed_arrival(from_rest_to_rest(succeeded), robot),
        passing=observed_passing(rows) or current.passing,
        held_up=held_up,
    )


def _better_known(
    current: PerformanceModel, durations: Examples, unseen: IntArray
) -> ErrorProcess | None:
    """Return the errors of the present tree on records that it was not learned from.

    Those that are known if there are not twice as many such records: each new set begins another
    measurement of gains.
    """
    known = current.errors
    if known is None or known.corrects or len(unseen) < 2 * len(known.points):
        return known
    tree = current.trees["duration"]
    table = durations.table.iloc[unseen].reset_index(drop=True)
    found = durations.values[unseen] - tree.predict(table[list(tree.names)].to_numpy())
    return error_process(tree, table, found, durations.prior)


def _delays(rows: pd.DataFrame, current: PerformanceModel) -> tuple[FloatArray, BoolArray]:
    """Return by how many s drives took longer than predicted, and which were held up, shape (n,).

    A robot that has become slower takes longer in each of its newest drives, so predictions are
    scaled to the median of the drives before and after.
    """
    if rows.empty:
        return np.zeros(0), np.zeros(0, dtype=bool)
    durations = rows["duration"].to_numpy(dtype=float)
    with np.errstate(all="ignore"):  # records may be of any situation
        predicted = current.predict(direct_of(rows)).duration
    assert predicted is not None
    ratios = np.log(durations / np.maximum(predicted, CONTROL_PERIOD))
    usual = predicted * np.exp(median_filter(ratios, _NEIGHBORS, mode="nearest"))
    follows_path = current.is_learned and len(current.trees["duration"].base) > 0
    nothing = np.full(len(rows), False)
    return durations - usual, find_held_up(durations, usual, nothing, follows_path=follows_path)


def _usable(rows: pd.DataFrame, features: Sequence[Feature]) -> pd.DataFrame:
    """Return the episodes with all goal variables, without successes of an implausible duration."""
    wanted = list(declared_by(features))
    if not set(rows.columns).issuperset(wanted):
        return rows[:0]
    rows = rows[rows[wanted].notna().all(axis=1)]
    durations = rows["duration"].to_numpy(dtype=float)
    good = rows["success"].to_numpy(dtype=bool)
    usual = float(np.median(durations[good])) if good.any() else 0.0
    return rows[~good | ((durations > 0.0) & (durations < max(10.0 * usual, 1.0)))]


@dataclass(frozen=True)
class Source:
    """The input of a round of learning: `folder` has the learned sets and the store of records.

    `models` is the folder with which the node was started; it may be missing.
    """

    folder: Path
    domain: Domain
    robot: Robot
    models: Path

    def model(self, place: Path, action: str, action_set: str) -> PerformanceModel | None:
        """Return the model of an action in the folder of a set.

        None if it is missing or unusable.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RobotMismatchWarning)
            try:
                file = place / model_path(action, action_set)
                return load_model(file, self.robot, self.domain.known_features)
            except FileError:
                return None  # the nodes report it


def learn(source: Source, *, time: str) -> dict[str, Any]:
    """Compare models, and make a new set with this time stamp if one is better.

    It is not published.

    Returns
    -------
    dict
        "made": the folder of the new set, "" without one; "actions": by "SET/ACTION" for durations,
        "SET/ACTION/MEASURE" for others, the fields of `RoundVerdict` but the tree.
    """
    records = source.folder / RECORDS
    place = current_set(source.folder)
    base = place or source.models
    seen = read_manifest(place).seen if place is not None else {}
    models: dict[Path, PerformanceModel] = {}
    actions: dict[str, dict[str, Any]] = {}
    episodes: dict[str, int] = {}
    reasons: dict[str, str] = {}
    for action_set in filter(source.domain.action_sets.__contains__, action_sets_in(records)):
        for action, rows in read_records(records, action_set).groupby("action", sort=True):
            if action not in source.domain.actions(action_set):
                continue
            name = f"{action_set}/{action}"
            current = source.model(base, str(action), action_set) or path_time_model(
                str(action), action_set, source.robot
            )
            verdicts, model = _improved(
                rows,
                source.robot,
                source.domain.candidates(str(action), action_set),
                current=current,
                seen={measure: seen.get(_key(name, measure), 0) for measure in MEASURES},
                former=_former(source, place, str(action), action_set),
            )
            for measure, verdict in verdicts.items():
                key = _key(name, measure)
                actions[key] = {
                    each: getattr(verdict, each) for each in ("episodes", "reason", "kind")
                }
                if verdict.tree is not None:
                    reasons[key] = verdict.reason
                    seen[key] = int(rows[NUMBER].max()) + 1
            episodes[name] = max(verdict.episodes for verdict in verdicts.values())
            if model is not None:
                metadata = _metadata(source, action_set, verdicts, episodes[name], current)
                models[model_path(str(action), action_set)] = dataclasses.replace(
                    model, metadata=metadata
                )
    made: Path | str = ""
    if models:
        made = _make_set(source, base, models)
        seal(made, Manifest("", time, episodes, seen, reasons))
    return {"made": str(made), "actions": actions}


def _metadata(
    source: Source,
    action_set: str,
    verdicts: Verdicts,
    episodes: int,
    current: PerformanceModel,
) -> dict[str, Any]:
    """Return the metadata of a better model than `current`."""
    kinds = "; ".join(
        f"{measure}: {verdict.kind}" for measure, verdict in verdicts.items() if verdict.kind
    )
    kinds = kinds or "errors of the present tree on further records"
    # The ranges of starts are kept, since records of refined chains cover less of them.
    starts = current.metadata["training"].get("starts", {})
    training = {"command": "learning", "kind": kinds, "episodes": episodes, "starts": starts}
    if source.robot.grid is not None:
        training["map"] = str(source.robot.grid)
    return {"action_set": action_set, "training": training, "versions": library_versions()}


def _key(name: str, measure: str) -> str:
    """Return the name of a measure of an action, SET/ACTION, in manifests and diagnostics."""
    return name if measure == "duration" else f"{name}/{measure}"


def _former(
    source: Source, place: Path | None, action: str, action_set: str
) -> dict[str, PerformanceModel]:
    """Return the models of an action that were in use before a set, by the names of their sets."""
    if place is None:
        return {}
    earlier = [other for other in sets_in(source.folder) if other.name < place.name]
    places = {"the models of the start": source.models}
    places |= {f"set {other.name[:6]}": other for other in earlier[-_FORMER:]}
    found = {name: source.model(other, action, action_set) for name, other in places.items()}
    return {name: model for name, model in found.items() if model is not None}


def _make_set(source: Source, base: Path, models: Mapping[Path, PerformanceModel]) -> Path:
    """Make a set of the files of `base` and the better models, by their places in it.

    Return its folder.
    """
    made = new_set_folder(source.folder)
    for action_set in source.domain.action_sets:
        folder = models_folder(made, action_set)
        folder.mkdir(exist_ok=True)
        for file in models_folder(base, action_set).glob("*.json"):
            shutil.copyfile(file, folder / file.name)
    for file, model in models.items():
        save_model(made / file, model)
    return made
