"""Models learned offline from episodes of a changed robot: what learning while playing can reach."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from ator_ros.experience.collect import episode_generator
from ator_ros.experience.episode import Episode, run_episode
from ator_ros.experience.store import RecordStore, StoreInfo
from ator_ros.experience.store_reading import read_records
from ator_ros.learning.changed import Changed
from ator_ros.learning.round import Source
from ator_ros.learning.sets import RECORDS
from ator_ros.performance.model_file import model_path, save_model
from ator_ros.performance.training import train
from ator_ros.refinement.gate import GATE
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.outcome import top_of

DONE = "done"
"""File in the folder of models that are complete."""
_MOST = 100_000


def learn_offline(
    folder: Path, source: Source, changed: Changed, actions: Iterable[str], *, action_set: str, count: int,
    seed: int, gate: Path,
) -> None:  # fmt: skip
    """Learn models from `count` episodes of each action, from anywhere.

    Parameters
    ----------
    folder : Path
        For records and models; what was there is deleted.
    source : Source
        Domain and robot as described.
    changed : Changed
        How the robot differs; it has seen before how its objects roll.
    actions : iterable of str
        Names of the actions of `action_set`.
    action_set : str
        Name of the set.
    count, seed : int
        Of the episodes.
    gate : Path
        Folder of the gate that is used with them, if it has one.
    """
    shutil.rmtree(folder, ignore_errors=True)
    info = StoreInfo(source.robot.digest(), source.domain.name)
    store = RecordStore(folder / RECORDS, info, most=_MOST)
    for name in actions:
        for episode in _episodes(source, changed, name, action_set, count, seed):
            store.append(action_set, episode)
    for action, rows in read_records(folder / RECORDS, action_set).rows.groupby("action"):
        name = str(action)
        model = train(name, rows, source.robot, features=source.features(name, action_set))
        model = dataclasses.replace(model, metadata={"action_set": action_set})
        save_model(folder / model_path(name, action_set), model)
    if (gate / GATE).exists():
        shutil.copy(gate / GATE, folder / model_path("gate", action_set))
    (folder / DONE).touch()


def _episodes(
    source: Source, changed: Changed, name: str, action_set: str, count: int, seed: int
) -> Iterator[Episode]:
    actual = changed.robot(source.robot)
    robot = dataclasses.replace(source.robot, scene=actual.scene)
    action, tops = source.domain.actions(action_set)[name], source.domain.tops_for(robot)
    for number in range(count):
        situation = action.sample(robot, episode_generator(name, seed, number))
        top = top_of(situation, tops, robot)
        with Simulation(actual, wheels=changed.wheels) as simulation:
            yield run_episode(simulation, action.factory(robot), situation, top=top)
