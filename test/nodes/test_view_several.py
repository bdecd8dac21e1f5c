"""A view beside running nodes: one simulation of two robots, each with an executor and a refinement node."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from conftest import Start

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.live_stage import LiveStage
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.viewing.desk import NAIVE, REFINED, Desk

pytestmark = [pytest.mark.node, pytest.mark.long]
NAMES = ("ann", "bob")
STARTS = {"ann": Pose(-2.0, 0.0, 0.0), "bob": Pose(1.0, -1.5, 3.0)}
PATIENCE = 240.0


@pytest.fixture
def stages(domain: int, start: Start) -> Iterator[dict[str, LiveStage]]:
    """Yield the stages of both robots, as `view --attach --robots ann bob` makes them."""
    numbers = [value for name in NAMES for value in STARTS[name]]
    start("simulation", robots=f"[{', '.join(NAMES)}]", robot_start=f"{numbers}", command_wait=10.0)
    for name in NAMES:
        frame = f"{name}/odom"
        start("refinement", namespace=name, frame=frame, deadline=5.0)
        robot_frame = f"{name}/base_link"
        start(
            "executor", namespace=name, frame=frame, robot_frame=robot_frame, odom_timeout=10.0,
            refinement_timeout=20.0, start_timeout=30.0,
        )  # fmt: skip
    with ExitStack() as closing:
        found = {}
        for name in NAMES:
            own = SpunNode(
                "view", domain=domain, words=["--ros-args", "-r", f"__ns:=/{name}"], patience=PATIENCE
            )
            found[name] = LiveStage(own, SOCCER, SOCCER.robot(), frame=f"{name}/odom")
            own.start()
            closing.callback(own.close)
        for stage in found.values():
            stage.ready(simulated=False)
            stage._own.patience = PATIENCE / 4.0
        yield found


def steps(desk: Desk, happened: Callable[[], bool], what: str) -> None:
    """Let a desk go on until something has happened."""
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, f"expected {what}; {desk.problem}"
        desk.step()
        time.sleep(0.05)


def distance(stage: LiveStage, pose: Pose) -> float:
    world = stage.world()
    return float("inf") if world is None else world.robot.pose.distance(pose)


def test_two_robots_of_one_simulation_are_shown_moved_and_played(stages: dict[str, LiveStage]) -> None:
    ann, bob = stages.values()
    assert ann.can_place
    assert bob.can_place
    desk = Desk(ann, SOCCER, {name: SOCCER.library(SOCCER.robot(), name) for name in SOCCER.action_sets})
    desk.control(ann)
    steps(desk, lambda: desk.advice is not None, "advice for ann")
    for name, stage in stages.items():
        assert distance(stage, STARTS[name]) < 0.02  # nothing was moved by being looked at
    assert desk.draft.world.robot.pose.distance(STARTS["ann"]) < 0.02

    desk.step([lambda: desk.move_object("ball", 0.3, 0.6)])
    for stage in stages.values():
        steps(desk, lambda stage=stage: is_ball_at(stage, 0.3, 0.6), "the ball for both")

    desk.step([lambda: ann.set_factor(2.0)])
    assert desk.problem == ""
    desk.play(REFINED)
    steps(desk, lambda: bool(desk.runs) and desk.runs[-1].ended, "ann's chain")
    assert desk.runs[-1].duration > 0.0, desk.runs[-1].status
    assert distance(ann, STARTS["ann"]) > 0.3
    assert distance(bob, STARTS["bob"]) < 0.05

    desk.control(bob)
    steps(desk, lambda: desk.advice is not None and not desk.problem, "advice for bob")
    # Ann stands where her chain ended: bob drives elsewhere.
    desk.step([lambda: desk.move_object("ball", 0.5, -1.0), lambda: desk.move_goal(1, Pose(2.0, -0.5, 0.3))])
    desk.play(NAIVE)
    steps(desk, lambda: bool(desk.runs) and desk.runs[-1].ended, "bob's chain")
    assert desk.runs[-1].duration > 0.0, desk.runs[-1].status
    steps(desk, lambda: len(bob.history.chains) == 1, "bob's record")
    assert [len(stage.history.chains) for stage in stages.values()] == [1, 1]


def is_ball_at(stage: LiveStage, x: float, y: float) -> bool:
    world = stage.world()
    ball = None if world is None else world.objects.get("ball")
    return ball is not None and abs(ball.x - x) < 0.02 and abs(ball.y - y) < 0.02


def test_an_executor_that_dies_ends_the_run_and_another_one_plays(domain: int, start: Start) -> None:
    start("simulation", command_wait=10.0)
    start("refinement", deadline=5.0)
    setting = {"odom_timeout": 10.0, "refinement_timeout": 20.0, "start_timeout": 30.0}
    executor = start("executor", **setting)
    own = SpunNode("view", domain=domain, patience=PATIENCE)
    stage = LiveStage(own, SOCCER, SOCCER.robot())
    own.start()
    try:
        stage.ready(simulated=False)
        desk = Desk(stage, SOCCER, {"default": SOCCER.library(SOCCER.robot(), "default")})
        desk.control(stage)
        steps(desk, lambda: desk.advice is not None, "advice")
        desk.play(NAIVE)
        steps(desk, lambda: bool(desk.runs), "a run")
        executor.kill()
        steps(desk, lambda: desk.runs[-1].ended, "the loss of the chain")
        assert desk.runs[-1].status == "lost: the executor does not answer"
        own.patience = PATIENCE
        start("executor", **setting)
        stage.ready(simulated=False)
        own.patience = PATIENCE / 4.0
        desk.play(NAIVE)
        steps(desk, lambda: bool(desk.runs) and desk.runs[-1].ended, "the chain")
        assert desk.runs[-1].duration > 0.0, desk.runs[-1].status
    finally:
        own.close()
