"""An installed domain of another package is collected, learned, refined and executed."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from chain_client import ChainClient, call
from conftest import Start
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from ros_client import Client

from ator_interfaces.msg import Outcome, TopCall
from ator_interfaces.srv import PlaceObject
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import SENSOR_DATA

pytestmark = pytest.mark.long
SOURCE = Path(__file__).resolve().parents[1] / "outside"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the package `delivery` with pip in a separate folder; return the folder."""
    shutil.copytree(SOURCE, tmp_path / "source")
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-build-isolation",
    ]
    subprocess.run([*command, "--target", str(tmp_path), str(tmp_path / "source")], check=True)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    return tmp_path


def run(command: str, *words: object) -> None:
    """Run a command line in this process, with one worker."""
    tool = importlib.import_module(f"ator_ros.tools.{command}")
    assert tool.main(["--domain", "delivery", *map(str, words)]) == 0


def cruises(calls: Iterable[TopCall]) -> list[float]:
    return [item.value for call in calls for item in call.values if item.name == "cruise"]


def place(client: Client, x: float, y: float) -> None:
    request = PlaceObject.Request()
    request.position.point.x, request.position.point.y = x, y
    assert client.call(PlaceObject, "place_parcel", request).success


def test_a_domain_from_another_package_is_learned_and_executed(
    installed: Path, start: Start, client: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    table, models = installed / "table.parquet", installed / "models"
    run("collect", "--episodes", 60, "--seed", 5, "--out", table, "--jobs", 1)
    assert "turnDriveTurn: 60 episodes" in capsys.readouterr().out
    run("train", table, "--models", models)
    learned = json.loads((models / "turnDriveTurn.json").read_text())
    # a feature of the domain, of its own goal variable
    assert learned["features"]["cruised"] == "s"
    words = ("--situations", 2, "--policies", "naive", "refined", "--models", models)
    run("evaluate", *words, "--out", installed / "evaluation", "--jobs", 1)
    result = json.loads((installed / "evaluation" / "evaluation.json").read_text())
    assert result["settings"]["source"]["domain"] == "delivery"

    parcels = client.listen(Odometry, "parcel", SENSOR_DATA)
    start(
        "simulation",
        domain="delivery",
        real_time_factor=10.0,
        command_wait=2.0,
        parcel_start="[3.4, 1.0]",
    )
    first = client.eventually(lambda: parcels and parcels[0].pose.pose.position, "a parcel")
    assert (first.x, first.y, first.z) == pytest.approx((3.4, 1.0, 0.25), abs=1e-3)
    request = PlaceObject.Request(velocity=Vector3(x=0.3))
    assert (
        client.call(PlaceObject, "place_parcel", request).message
        == "parcel at x 0.000 m, y 0.000 m"
    )
    client.eventually(lambda: parcels[-1].pose.pose.position.x > 0.01, "the parcel rolls")
    assert client.call(PlaceObject, "place_parcel", PlaceObject.Request(remove=True)).success
    start("refinement", domain="delivery", models=models, gate=False, deadline=5.0)
    start("executor", domain="delivery", models=models, odom_timeout=5.0, refinement_timeout=20.0)
    chains = ChainClient(client)
    visits = [
        call("visit", Pose(1.0, 0.5, 3.0), opened=("yaw", "cruise"), cruise=0.3),
        call("pass", Pose(2.0, -1.0, 0.0), opened=("cruise",), cruise=0.6),
    ]
    assert "parcel is missing: pass needs it" in chains.send(visits).outcome().reason
    place(client, 1.1, 0.9)
    chains.wait_for_newer_odometry()
    outcome = chains.send(visits).outcome()
    assert outcome.code == Outcome.REFUSED
    assert "distance from robot to parcel 0.5 to inf m" in outcome.reason
    place(client, 3.4, 1.0)
    chains.wait_for_newer_odometry()
    result = chains.send(visits, refine=True).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert (
        "cruise of step 2 (pass) is bound by the pre-condition of step 2 (pass): robot.vx near "
        "goal.cruise" in result.record.refinement
    )
    # A free value is the maximum; a bound one is unchanged.
    assert cruises(result.record.chain.calls) == pytest.approx([1.0, 0.6])
    assert cruises(action.call for action in result.record.actions) == pytest.approx([1.0, 0.6])
    for action in result.record.actions:
        assert action.action == "turnDriveTurn"
        assert action.predicted.duration == pytest.approx(action.actual.duration, rel=0.5)
