"""A domain that is installed from another folder is collected, learned, refined and executed as ours is."""

from __future__ import annotations

import importlib
import json
import os
import shutil
from pathlib import Path

import pytest
from chain_client import ChainClient, call
from conftest import Start
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import PlaceBall
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import SENSOR_DATA

pytestmark = pytest.mark.node
SOURCE = Path(__file__).resolve().parents[1] / "outside" / "delivery.py"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the package `delivery` as pip would, in a folder of its own; return the folder."""
    shutil.copy(SOURCE, tmp_path)
    metadata = tmp_path / "delivery-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: delivery\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[ator_ros.domains]\ndelivery = delivery:DELIVERY\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    return tmp_path


def run(command: str, *words: object) -> None:
    """Run a command line in this process, with one worker."""
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    assert tool.main(["--domain", "delivery", *map(str, words)]) == 0


def test_a_domain_from_another_package_is_learned_and_executed(
    installed: Path, start: Start, client: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    table, models = installed / "table.parquet", installed / "models"
    run("collect", "--episodes", 60, "--seed", 5, "--out", table, "--jobs", 1)
    assert "turnDriveTurn: 60 episodes" in capsys.readouterr().out
    run("train", table, "--models", models)
    learned = json.loads((models / "turnDriveTurn.json").read_text())
    assert learned["features"]["turned"] == "rad"  # the domain's own
    words = ("--situations", 2, "--policies", "naive", "refined", "--models", models)
    run("evaluate", *words, "--out", installed / "evaluation", "--jobs", 1)
    result = json.loads((installed / "evaluation" / "evaluation.json").read_text())
    assert result["settings"]["source"]["domain"] == "delivery"

    parcels = client.listen(Odometry, "parcel", SENSOR_DATA)
    start("simulation", domain="delivery", real_time_factor=10.0, command_wait=2.0, parcel_start="[3.4, 1.0]")
    first = client.eventually(lambda: parcels and parcels[0].pose.pose.position, "a parcel")
    assert (first.x, first.y, first.z) == pytest.approx((3.4, 1.0, 0.25), abs=1e-3)
    request = PlaceBall.Request(velocity=Vector3(x=0.3))
    assert client.call(PlaceBall, "place_parcel", request).message == "parcel at x 0.000 m, y 0.000 m"
    client.eventually(lambda: parcels[-1].pose.pose.position.x > 0.01, "the parcel rolls")
    assert client.call(PlaceBall, "place_parcel", PlaceBall.Request(remove=True)).success
    start("refinement", domain="delivery", models=models, gate=False, deadline=5.0)
    start("executor", domain="delivery", models=models, odom_timeout=5.0, refinement_timeout=20.0)
    chains = ChainClient(client)
    visits = [call("visit", Pose(1.0, 0.5, 3.0), opened=("yaw",)), call("visit", Pose(2.0, -1.0, 0.0))]
    result = chains.send(visits, refine=True).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    # Turns on the spot add up to the same whatever the heading between them, so little is to be gained.
    assert "predicted gain" in result.record.refinement
    for action in result.record.actions:
        assert action.action == "turnDriveTurn"
        assert action.predicted.duration == pytest.approx(action.actual.duration, rel=0.5)
