"""The nodes with states that come late, through ROS."""

from __future__ import annotations

import pytest
from chain_client import ChainClient, call, chain_of_the_paper
from conftest import Start
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose

LATENCY = 0.15
PUNCTUAL = 3.25  # s that this drive takes where nothing is late
DRIVE = [call("goToBall", Pose(0.0, 0.0, 0.5))]


def drive(start: Start, client: Client, *, foreseen: float) -> tuple[bool, float]:
    """Drive to the ball with states that come late; say whether it succeeded, and the time in s."""
    start("simulation", real_time_factor=0.0, command_wait=0.5, latency=LATENCY)
    start("executor", odom_timeout=5.0, latency=foreseen)
    result = ChainClient(client).send(DRIVE).result()
    return result.outcome.code == Outcome.SUCCEEDED, result.record.actual.duration


def test_a_latency_that_is_foreseen_costs_nothing(start: Start, client: Client) -> None:
    succeeded, duration = drive(start, client, foreseen=LATENCY)
    assert succeeded
    assert duration == pytest.approx(PUNCTUAL, abs=0.11)


def test_a_latency_that_nobody_foresees_makes_the_robot_push_the_ball(start: Start, client: Client) -> None:
    succeeded, duration = drive(start, client, foreseen=0.0)
    assert not succeeded or duration > PUNCTUAL + 0.5


def test_the_chain_of_the_paper_succeeds_with_late_states(start: Start, client: Client) -> None:
    start("simulation", real_time_factor=0.0, command_wait=0.5, latency=LATENCY)
    start("refinement")
    start("executor", odom_timeout=5.0, refinement_timeout=20.0, latency=LATENCY)
    outcome = ChainClient(client).send(chain_of_the_paper(), refine=True).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome
