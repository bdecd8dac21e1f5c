"""The nodes with a robot without a holder, in an area far from the origin of odometry."""

from pathlib import Path

import pytest
import yaml
from chain_client import ChainClient, call
from conftest import Host, Start
from robots import PLAIN
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.drive import DRIVE
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.refinement import refine_request
from ator_ros.refinement.refiner import Refiner
from ator_ros.world.readers import MessageError

X, Y = 5e5, 5e6
OUTSIDE = (
    "chain.calls[0].goal (goToPose): expected a place for the robot inside the fence "
    "(x from 499995 to"
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    data = PLAIN.sections()
    data["scene"] = {"area": {"length": 8.0, "width": 5.0, "margin": 1.0, "x": X, "y": Y}}
    file = tmp_path / "plain.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


@pytest.mark.long
def test_a_robot_without_a_holder_drives(
    start: Start, host: Host, client: Client, file: Path
) -> None:
    start("simulation", robot=file, real_time_factor=4.0)
    host("executor", robot=file, odom_timeout=5.0, start_timeout=60.0)
    assert client.robot().pose == pytest.approx(Pose(X - 2.0, Y, 0.0), abs=1e-3)
    chains = ChainClient(client)
    passing = [
        call("goToPose", Pose(X - 1.0, Y, 0.0)),
        call("goToPose", Pose(X - 1.0, Y + 0.6, 1.5)),
    ]
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
    robot = DRIVE.robot(file)
    refiner, fence = Refiner(robot, {}), Fence.around(robot)
    with pytest.raises(MessageError) as error:
        refine_request(request, refiner, DRIVE.library(robot), frame="odom", fence=fence)
    assert str(error.value) in refused.reason
    assert str(error.value).endswith("change scene.area or the parameter fence")
