"""A view of nodes that run already, or cease to: what it follows, and what it survives."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import signal
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from in_process_stage import InProcessStage, desk_in_control

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.viewing import panel
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.desk import NAIVE, Desk
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.stage import AbsentError, StageError
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = SOCCER.robot()


class RunningStage(InProcessStage):
    """A robot that stands somewhere, beside the ball; its refinement may be `absent`."""

    def __init__(self) -> None:
        super().__init__(SOCCER, ROBOT)
        self.absent = False
        self.see(10.0, Pose(-1.0, 1.5, 0.5), (2.0, -0.5))

    def see(self, time: float, pose: Pose, ball: tuple[float, float]) -> None:
        self.state = World(time, RobotState(pose), {"ball": ObjectState(*ball)})

    def refine(self, draft: Draft, *, as_given: bool = False) -> Advice:
        if self.absent:
            raise AbsentError("expected the service refine_subgoal, it is not there")
        return super().refine(draft, as_given=as_given)


@pytest.fixture
def stage() -> RunningStage:
    return RunningStage()


@pytest.fixture
def desk(stage: RunningStage) -> Desk:
    return desk_in_control(stage)


def test_a_robot_that_runs_is_followed_and_not_moved(desk: Desk, stage: RunningStage) -> None:
    assert stage.calls == []
    assert desk.draft.world.robot.pose == Pose(-1.0, 1.5, 0.5)
    assert desk.draft.chain.calls[0].goal.pose[:2] == (2.0, -0.5)
    asked = len(stage.asked)
    for number in range(1, 11):
        stage.see(10.0 + 0.1 * number, Pose(-1.0 + 0.1 * number, 1.5, 0.5), (2.0, -0.5))
        desk.step()
    assert desk.draft.world.robot.pose.x == pytest.approx(0.0, abs=0.25)
    assert 3 <= len(stage.asked) - asked <= 6  # not at each step
    stage.see(12.0, stage.state.robot.pose._replace(yaw=1.5), (2.0, -0.5))
    desk.step()
    assert desk.draft.world.robot.pose.yaw == 1.5  # it turned on the spot
    stage.state = dataclasses.replace(stage.state, time=13.0, objects={})
    desk.step()
    assert desk.draft.world.objects == {}


def test_it_is_followed_until_something_is_moved_or_played(desk: Desk, stage: RunningStage) -> None:
    desk.step([lambda: desk.move_object("ball", 1.0, 1.0)])
    stage.see(20.0, Pose(0.0, 0.0, 0.0), (1.0, 1.0))
    desk.step()
    assert desk.draft.world.robot.pose == Pose(-1.0, 1.5, 0.5)
    assert stage.calls == []

    desk.control(stage)
    desk.step()
    assert desk.draft.world.robot.pose == Pose(0.0, 0.0, 0.0)
    desk.play(NAIVE)
    desk.step()
    assert stage.executed
    assert "place" not in stage.calls  # it begins where it is
    desk.back()
    desk.step()
    assert "place" in stage.calls


def test_another_robot_is_played_from_where_it_is_also_at_once(desk: Desk, stage: RunningStage) -> None:
    other = RunningStage()
    other.see(10.0, Pose(1.0, -1.0, 2.0), (0.5, 0.75))
    desk.step([lambda: desk.control(other), lambda: desk.play(NAIVE)])
    [chain] = other.executed
    assert chain.calls[0].goal.pose[:2] == (0.5, 0.75)
    assert desk.problem == ""


class RefusingStage(RunningStage):
    """Places nothing."""

    def place(self, world: World) -> None:
        super().place(world)
        raise StageError("place_robot: off the floor")


def test_a_start_that_is_refused_is_told_and_tried_once() -> None:
    stage = RefusingStage()
    desk = Desk(stage, SOCCER, stage.libraries)
    for _ in range(5):
        desk.step()
    assert stage.calls == ["place"]
    assert desk.problem == "place_robot: off the floor"
    desk.play(NAIVE)
    desk.step()
    assert not desk.playing
    assert not stage.executed


def test_refinement_that_comes_back_is_asked_again(desk: Desk, stage: RunningStage) -> None:
    stage.absent = True
    desk.step([lambda: desk.move_goal(1, Pose(0.5, 0.25, 1.0))])
    assert desk.advice is None
    assert "it is not there" in desk.problem
    stage.absent = False
    for _ in range(30):
        desk.step()
    assert desk.advice is not None
    assert desk.problem == ""


WISHES: dict[str, Callable[[Desk], object]] = {
    "a step that is no more": lambda desk: desk.move_goal(7, Pose(0.0, 0.0, 0.0)),
    "a variable of such a step": lambda desk: desk.open(7, "yaw", is_open=True),
    "an unknown action set": lambda desk: desk.use_actions("chess"),
    "an unknown chain": lambda desk: desk.situation(chain="chess"),
    "a seed that is no number": lambda desk: desk.situation(seed=int(math.inf)),
    "a seed that is nothing": lambda desk: desk.situation(seed=int(None)),  # type: ignore[arg-type]
    "a negative number": lambda desk: desk.situation(index=-5),
    "a negative seed": lambda desk: desk.situation(seed=-5),
    "an unknown measure": lambda desk: desk.weigh("fun", 1.0),
    "a weight that is no number": lambda desk: desk.weigh("duration", math.nan),
}


@pytest.mark.parametrize("wish", WISHES)
def test_a_wish_that_makes_no_sense_is_told_and_the_view_goes_on(
    desk: Desk, stage: RunningStage, wish: str
) -> None:
    desk.step([lambda: WISHES[wish](desk)])
    assert desk.problem
    desk.step([lambda: desk.situation(chain="dribble", seed=3)])
    assert desk.advice is not None
    assert desk.problem == ""


def test_silence_is_told() -> None:
    world = World(3.0, RobotState(Pose(0.0, 0.0, 0.0)))
    assert panel.clock(world, paused=False, status="drives", silence=1.0) == "**3.00 s** · drives"
    assert (
        panel.clock(world, paused=False, status="drives", silence=7.3)
        == "**3.00 s** · no word of the robot for 7 s"
    )
    assert panel.clock(world, paused=True, status="waits", silence=7.3) == "**3.00 s** (paused) · waits"


def test_why_something_was_not_moved_is_told() -> None:
    world = World(3.0, RobotState(Pose(0.0, 0.0, 0.0)))
    told = panel.clock(world, paused=False, status="drives", refused="ball: off [it]")
    assert told == "**3.00 s** · drives\n\n**not moved:** ball: off \\[it\\]"


def test_a_view_that_cannot_be_set_up_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("viser", reason="needs viser: docs/install.md")
    from ator_ros.nodes.parameters import SetupError
    from ator_ros.tools import view
    from ator_ros.tools.work import view as work

    def fail(*_: object) -> None:
        raise SetupError("cart is to come from tf: expected the package tf2_msgs, got none")

    monkeypatch.setattr(work, "_serve", fail)
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # the view takes Ctrl-C from the tests
    assert view.main(["--attach"]) == 1
    assert (
        capsys.readouterr().err == "view: cart is to come from tf: expected the package tf2_msgs, got none\n"
    )


def test_the_nodes_of_a_view_outlast_a_pause_and_a_busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser", reason="needs viser: docs/install.md")
    from ator_ros.tools import processes

    class Nodes:
        def start(self, name: str, parameters: dict[str, object], folder: object = None) -> None:
            started[name] = parameters

    @contextlib.contextmanager
    def own_nodes() -> Iterator[Nodes]:
        yield Nodes()

    from ator_ros.tools.work import view as work

    started: dict[str, dict[str, object]] = {}
    monkeypatch.setattr(processes, "own_nodes", own_nodes)
    with processes.all_nodes(1.0, work._SIMULATED, work._EXECUTED):
        assert started["simulation"]["lockstep"] is True
        assert started["executor"]["odom_timeout"] == 60.0


def test_a_pointer_that_meets_no_floor_moves_nothing() -> None:
    pytest.importorskip("viser", reason="needs viser: docs/install.md")
    from ator_ros.page.grips import on_floor

    camera = np.array([0.0, 0.0, 2.0])
    assert on_floor(camera, np.array([0.5, 0.0, 1.0]), 0.0) == pytest.approx((1.0, 0.0))
    assert on_floor(camera, np.array([0.5, 0.0, 3.0]), 0.0) is None
    assert on_floor(camera, np.array([0.5, math.nan, 1.0]), 0.0) is None
    assert on_floor(camera, np.array([math.inf, 0.0, 1.0]), 0.0) is None
    assert on_floor(np.full(3, math.nan), np.array([0.5, 0.0, 1.0]), 0.0) is None
