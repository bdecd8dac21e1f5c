"""The nodes with a robot without a holder, in an area far from the origin of odometry."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from chain_client import ChainClient, call
from conftest import Host, Start
from experience_rows import synthetic_experience
from refinement_requests import refine
from robots import PLAIN
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.drive import DRIVE
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.performance.model_file import save_model
from ator_ros.performance.training import train

X, Y = 5e5, 5e6
OUTSIDE = "chain.calls[0].goal (goToPose): expected a place for the robot inside the fence (x from 499995 to"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a description without a ball."""
    data = PLAIN.sections()
    data["scene"] = {"area": {"length": 8.0, "width": 5.0, "margin": 1.0, "x": X, "y": Y}}
    file = tmp_path / "plain.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


@pytest.fixture
def models(tmp_path: Path) -> Path:
    """Return a folder with a small model."""
    rows = synthetic_experience("goToPose")
    model = train("goToPose", rows, DRIVE.equip(PLAIN), features=DRIVE.candidates("goToPose"))
    save_model(tmp_path / "models" / "goToPose.json", model)
    return tmp_path / "models"


def test_a_robot_without_a_holder_drives(
    start: Start, host: Host, client: Client, file: Path, models: Path
) -> None:
    start("simulation", robot=file, real_time_factor=4.0)
    start("refinement", robot=file, models=models)
    host("executor", robot=file, odom_timeout=5.0, start_timeout=60.0, refinement_timeout=30.0)
    assert client.robot().pose == pytest.approx(Pose(X - 2.0, Y, 0.0), abs=1e-3)
    chains = ChainClient(client)
    passing = [call("goToPose", Pose(X - 1.0, Y, 0.0)), call("goToPose", Pose(X - 1.0, Y + 0.6, 1.5))]
    passing[0].speed = 0.2
    outcome = chains.send(passing).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason
    assert client.robot().pose == pytest.approx(Pose(X - 1.0, Y + 0.6, 1.5), abs=0.12)

    outside = call("goToPose", Pose(X + 5.5, Y, 0.0))
    refused = chains.send([outside]).outcome()
    assert refused.code == Outcome.REFUSED
    assert OUTSIDE in refused.reason
    request = RefineSubgoal.Request()
    request.situation.robot = pose_of(Pose(X, Y, 0.0))
    request.chain.calls = [outside]
    answer = refine(client, request)
    assert not answer.accepted
    assert answer.reason in refused.reason
    assert answer.reason.endswith("change scene.area or the parameter fence")
