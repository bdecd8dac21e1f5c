"""The example with a behavior of py_trees for `execute_chain`."""

import sys

import pytest
from chain_client import call
from conftest import Start
from hall import Hall
from process import run
from py_trees.common import Status

from ator_ros.geometry import Pose
from examples import behavior_tree
from examples.behavior_tree import ExecuteChainBehaviour

PLACES = Pose(1.0, 0.5, 0.3), Pose(2.0, 0.0, 1.0)


def test_it_runs_until_the_chain_ends_and_cancels_it_when_it_is_stopped(hall: Hall) -> None:
    client, server = hall.client, hall.serve()
    behavior = ExecuteChainBehaviour("tour", [call("visit", pose) for pose in PLACES], refine=False)
    client.within(lambda: behavior.setup(node=client.node))

    def reaches(status: Status) -> bool:
        client.within(behavior.tick_once)
        return behavior.status is status

    client.eventually(lambda: reaches(Status.RUNNING) and server.goals, "a goal")
    for number, pose in enumerate(PLACES, 1):
        client.eventually(
            lambda: reaches(Status.RUNNING) and "drive" in behavior.feedback_message, "feedback"
        )
        hall.reach(server, number, pose)
    client.eventually(lambda: reaches(Status.SUCCESS), "the end")
    assert behavior.feedback_message.startswith("drive succeeded: ")
    client.eventually(lambda: reaches(Status.RUNNING) and len(server.goals) == 3, "the next goal")
    client.within(lambda: behavior.stop(Status.INVALID))
    client.eventually(lambda: server.canceled, "a cancellation")
    client.within(lambda: server.finish("canceled"))
    client.eventually(
        lambda: reaches(Status.RUNNING) and len(server.goals) == 4, "a goal after that"
    )
    client.within(lambda: server.finish("abort", code=2))
    client.eventually(lambda: reaches(Status.FAILURE), "the failure")


@pytest.mark.long
def test_the_example_drives_a_round(start: Start, domain: int) -> None:
    start("simulation", real_time_factor=3.0)
    start("refinement", deadline=5.0)
    start("executor", odom_timeout=5.0, refinement_timeout=10.0)
    ran = run(sys.executable, behavior_tree.__file__, domain=domain)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "tour" in ran.stdout
