"""What is learned of drives of an omnidirectional robot."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omni_robots import UNLIKE

from ator_ros.actions.situation import Situation
from ator_ros.bases.omni.omni_driving import OmniDriving
from ator_ros.bases.omni.omni_limits import OmniLimits
from ator_ros.domains.available_models import models_for
from ator_ros.domains.drive import DRIVE, tops_for
from ator_ros.experience.simulated import episode_generator, run_episode
from ator_ros.experience.table import join
from ator_ros.performance.features import GENERAL
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import OtherBaseError, load_model, save_model
from ator_ros.performance.training import train
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.library import top_of

EPISODES = 40
SPEC = DRIVE.actions()["goToPose"]


def drawn(number: int) -> Situation:
    return SPEC.situation(UNLIKE, episode_generator("goToPose", 65, number))


@pytest.fixture(scope="module")
def experience() -> pd.DataFrame:
    rows = []
    with Simulation(UNLIKE) as simulation:
        for number in range(EPISODES):
            situation = drawn(number)
            top = top_of(situation, tops_for(UNLIKE), UNLIKE)
            episode = run_episode(simulation, SPEC.factory(UNLIKE), situation, top=top)
            rows.append(episode.rows(number, ()))
    return join(rows)


@pytest.fixture(scope="module")
def model(experience: pd.DataFrame) -> PerformanceModel:
    return train("goToPose", experience, UNLIKE)


@pytest.mark.long
def test_its_limits_are_observed_on_each_axis(model: PerformanceModel) -> None:
    assert isinstance(model.driving, OmniDriving)
    found = model.driving.limits
    described = UNLIKE.limits
    assert isinstance(found, OmniLimits)
    assert 0.7 * described.v < found.v < 1.05 * described.v
    assert found.sideways == pytest.approx(described.sideways, rel=0.15)
    assert found.w == pytest.approx(described.w, rel=0.1)
    assert 0.5 * described.a < found.a < 1.3 * described.a
    assert found.shape == described.shape


@pytest.mark.long
def test_its_durations_are_predicted(experience: pd.DataFrame, model: PerformanceModel) -> None:
    starts = experience[experience["t"] == 0.0]
    predicted = model.predict({name: starts[name].to_numpy() for name in starts}).duration
    durations = starts["duration"].to_numpy()
    assert np.abs(predicted - durations).mean() < 0.05 * durations.mean()


@pytest.mark.long
def test_its_model_is_read_as_written(model: PerformanceModel, tmp_path: Path) -> None:
    file = tmp_path / "goToPose.json"
    save_model(file, model)
    again = load_model(file, UNLIKE, GENERAL)
    assert again.driving == model.driving
    assert again.rules() == model.rules()


def test_shipped_models_of_another_kind_of_base_are_none_of_this_robot() -> None:
    assert list(models_for(DRIVE, UNLIKE)) == ["goToPose"]
    with pytest.raises(OtherBaseError, match="a robot that drives otherwise than mecanum: run"):
        models_for(DRIVE, UNLIKE, folder=DRIVE.models_root(None))
