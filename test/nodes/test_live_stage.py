"""A view's stage beside nodes that err, refuse, or see the robot in tf."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from played_nodes import PlayedNodes

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.trials import random_trial
from ator_ros.geometry import Pose
from ator_ros.nodes import silence
from ator_ros.nodes.live_stage import LiveStage
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.runs import Run
from ator_ros.viewing.stage import StageError
from ator_ros.world.state import ObjectState, RobotState, World

pytestmark = pytest.mark.node
ROBOT = SOCCER.robot()
TRIAL = random_trial(SOCCER, "dribble", SOCCER.library(ROBOT), seed=0, index=0)
PLACES = World(0.0, RobotState(Pose(1.0, 1.0, 0.0)), {"ball": ObjectState(-1.0, 0.5)})
Staged = tuple[LiveStage, PlayedNodes]


@pytest.fixture
def staged(domain: int, request: pytest.FixtureRequest) -> Iterator[Staged]:
    """Yield a stage and the nodes that it uses; a parameter `tf` takes odometry away."""
    with ExitStack() as closing:
        nodes = PlayedNodes(domain, from_tf=getattr(request, "param", "odom") == "tf")
        closing.callback(nodes.close)
        own = SpunNode("view", domain=domain, patience=20.0)
        stage = LiveStage(own, SOCCER, ROBOT)
        own.start()
        closing.callback(own.close)
        stage.ready(simulated=False)
        assert stage.can_place
        yield stage, nodes


def until(happened: Callable[[], object], what: str) -> None:
    end = time.monotonic() + 20.0
    while not happened():
        assert time.monotonic() < end, f"expected {what}"
        time.sleep(0.01)


def test_an_object_that_is_seen_with_noise_is_not_waited_for(staged: Staged) -> None:
    stage, nodes = staged
    stage.place(PLACES)
    world = stage.world()
    assert world is not None
    assert world.robot.pose == PLACES.robot.pose
    assert world.objects["ball"].x == pytest.approx(-1.0, abs=0.11)
    assert nodes.paused
    stage.pause(paused=False)
    assert not nodes.paused


def test_where_a_start_fails_time_goes_on(staged: Staged) -> None:
    stage, nodes = staged
    stage.place(PLACES)
    draft = Draft(TRIAL.world, TRIAL.chain, "default")
    with pytest.raises(StageError, match="accepts no goal"):
        stage.execute(Run("naive"), draft, refine=False)
    until(lambda: not nodes.paused, "time to go on after a refused goal")
    off = World(0.0, RobotState(Pose(9.0, 0.0, 0.0)))
    with pytest.raises(StageError, match="off the floor"):
        stage.place(off)
    until(lambda: not nodes.paused, "time to go on after a refused start")


def test_a_chain_of_which_nothing_is_told_any_more_is_lost(
    staged: Staged, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage, nodes = staged
    monkeypatch.setattr(silence, "_LONGEST", 1.0)
    nodes.accepts = True
    run = Run("naive")
    stage.execute(run, Draft(TRIAL.world, TRIAL.chain, "default"), refine=False)

    def watched(seconds: float) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end and not run.ended:
            stage.watch()
            time.sleep(0.02)
        return run.ended

    assert not watched(2.0)
    stage.pause(paused=True)
    nodes.silent = True
    assert not watched(2.0)  # while time stands nobody has anything to tell
    stage.pause(paused=False)
    assert watched(10.0)
    assert run.status == "lost: the executor does not answer"
    stage.stop()  # nothing is under way any more
    nodes.silent = False
    stage.execute(Run("naive"), Draft(TRIAL.world, TRIAL.chain, "default"), refine=False)


def test_a_view_that_ends_lets_time_go_on(staged: Staged) -> None:
    stage, nodes = staged
    stage.pause(paused=True)
    assert nodes.paused
    stage.leave()
    assert not nodes.paused


def test_what_is_not_moved_is_told_until_it_is(staged: Staged) -> None:
    stage, _ = staged
    assert stage.refused == ""
    stage.place_robot(Pose(9.0, 0.0, 0.0))
    stage.place_object("ball", 9.0, 0.0)
    until(lambda: set(stage.refused.split("; ")) == {"robot: off the floor", "ball: off the floor"}, "both")
    stage.place_robot(Pose(1.0, 0.0, 0.0))
    until(lambda: stage.refused == "ball: off the floor", "that of the ball alone")
    stage.place(PLACES)
    assert stage.refused == ""


@pytest.mark.parametrize("staged", ["tf"], indirect=True)
def test_a_robot_of_which_only_tf_tells_is_seen(staged: Staged) -> None:
    stage, nodes = staged
    until(lambda: stage.world() is not None, "the robot")
    world = stage.world()
    assert world is not None
    assert world.robot.pose.distance(nodes.robot) < 1e-6
    assert stage.silence < 5.0
