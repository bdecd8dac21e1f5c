"""What a view draws, edits and plays, without its page and without ROS."""

from __future__ import annotations

import math

import numpy as np
import pytest
from in_process_stage import InProcessStage

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.simulation.urdf import Wheels
from ator_ros.tools.work import view
from ator_ros.viewing import panel
from ator_ros.viewing.chain_picture import picture_of
from ator_ros.viewing.desk import NAIVE, REFINED, Desk
from ator_ros.viewing.inbox import Inbox
from ator_ros.viewing.ring import rings_of, times_by_heading
from ator_ros.viewing.runs import Race, Run
from ator_ros.viewing.shapes import Arrow, Segments
from ator_ros.viewing.surroundings import surroundings

ROBOT = SOCCER.robot()


def desk_and_stage() -> tuple[Desk, InProcessStage]:
    stage = InProcessStage(SOCCER, ROBOT)
    desk = Desk(stage, SOCCER, stage.libraries)
    desk.step()
    return desk, stage


def test_the_ring_is_nearest_where_the_chain_is_fastest_and_marks_the_chosen_heading() -> None:
    desk, _ = desk_and_stage()
    assert desk.advice is not None
    [curve] = desk.advice.curves
    headings, costs = times_by_heading(curve)
    ring, chosen = rings_of(desk.advice.chain, curve)
    centre = desk.advice.chain.calls[0].goal.pose
    radii = np.hypot(*(ring.points[:, 0] - (centre.x, centre.y)).T)
    assert len(headings) >= 36
    assert np.all(np.diff(headings) > 0.0)
    assert np.argmin(radii) == np.argmin(costs)
    assert np.argmax(radii) == np.argmax(costs)
    assert ring.colours[np.argmin(costs)] == pytest.approx((0.0, 0.8, 0.0))
    # The mark lies behind the subgoal, on the side that the robot comes from.
    across = chosen.points[0, 1] - (centre.x, centre.y)
    assert math.atan2(*-across[::-1]) == pytest.approx(centre.yaw)
    step = np.diff(headings).max()  # the search looks between these headings as well
    assert headings[np.argmin(costs)] == pytest.approx(centre.yaw, abs=step)


def test_without_searched_headings_there_is_no_ring() -> None:
    desk, _ = desk_and_stage()
    assert desk.advice is not None
    speeds = SubgoalCurve(0, ("speed",), np.array([[0.0], [0.5], [1.0]]), np.array([3.0, 2.0, 4.0]))
    assert rings_of(desk.advice.chain, speeds) == ()
    endless = SubgoalCurve(0, ("yaw",), np.zeros((4, 1)), np.full(4, np.inf))
    assert rings_of(desk.advice.chain, endless) == ()


def test_naive_is_grey_and_the_chain_to_execute_is_coloured() -> None:
    desk, _ = desk_and_stage()
    assert desk.advice is not None
    assert desk.advice.refined
    shapes = {shape.name: shape for shape in picture_of(desk.draft.world.robot.pose, desk.advice)}
    grey, blue = shapes["naive/subgoal0"], shapes["chain/subgoal0"]
    assert isinstance(grey, Arrow)
    assert isinstance(blue, Arrow)
    assert np.ptp(grey.colour) < 0.1 < np.ptp(blue.colour)
    assert (grey.pose, blue.pose) == tuple(
        chain.calls[0].goal.pose for chain in (desk.advice.naive, desk.advice.chain)
    )
    legs = shapes["chain/legs"]
    assert isinstance(legs, Segments)
    assert len(legs.points) == 2


def test_surroundings_hold_area_bays_and_the_domains_lines() -> None:
    names = [shape.name for shape in surroundings(SOCCER, ROBOT)]
    assert names == ["area", "line0", "line1", "bay0", "bay1"]


def test_a_moved_object_takes_its_subgoal_along_and_refinement_follows() -> None:
    desk, stage = desk_and_stage()
    asked, edition = len(stage.asked), desk.edition
    desk.step([lambda: desk.move_object("ball", 1.0, 0.5)])
    first, last = desk.draft.chain.calls
    assert first.goal.pose[:2] == (1.0, 0.5)
    assert last.goal == stage.asked[0].chain.calls[1].goal
    assert stage.state.objects["ball"].x == 1.0
    assert len(stage.asked) == asked + 1
    assert desk.edition > edition
    assert desk.problem == ""


def test_goals_that_lie_at_no_object_can_be_moved() -> None:
    desk, _ = desk_and_stage()
    assert list(desk.draft.movable_goals) == [1]
    desk.step([lambda: desk.move_goal(1, Pose(0.5, 0.25, 1.0))])
    assert desk.advice is not None
    assert desk.advice.chain.calls[1].goal.pose == Pose(0.5, 0.25, 1.0)


def test_what_is_committed_to_is_not_refined() -> None:
    desk, _ = desk_and_stage()
    desk.step([lambda: desk.open(0, "yaw", is_open=False), lambda: desk.open(0, "speed", is_open=False)])
    assert desk.advice is not None
    assert not desk.advice.refined
    assert "nothing is open" in desk.advice.reason


def test_what_counts_is_what_refinement_is_asked_for() -> None:
    desk, stage = desk_and_stage()
    desk.step([lambda: desk.weigh("accuracy", 10.0), lambda: desk.weigh("duration", 0.5)])
    expected = {"duration": 0.5, "success": SOCCER.time_limit, "accuracy": 10.0}
    assert dict(stage.asked[-1].objective.weights) == expected
    assert desk.problem == ""
    desk.situation(seed=3)  # stays
    desk.step([lambda: desk.weigh("accuracy", 0.0), lambda: desk.weigh("success", 0.0)])
    desk.step([lambda: desk.weigh("duration", 0.0)])
    assert "at least one weight above 0" in desk.problem
    assert dict(desk.draft.objective.weights) == {
        "duration": 0.5,
        "success": 0.0,
        "accuracy": 0.0,
    }


def test_of_alternatives_the_best_is_chosen_told_and_executed() -> None:
    desk, stage = desk_and_stage()
    far = desk.draft.chain.calls[1].goal.pose
    near = Pose(*desk.draft.chain.calls[0].goal.pose[:2], 0.0).ahead(0.6)
    desk.step([desk.keep_alternative, lambda: desk.move_goal(1, near)])
    desk.step([desk.keep_alternative, lambda: desk.move_goal(1, far)])
    assert desk.advice is not None
    assert len(desk.draft.alternatives) == 2
    durations = [each.duration for each in desk.advice.candidates]
    assert len(durations) == 3
    assert desk.advice.chosen == int(np.argmin(durations)) == 2
    assert desk.advice.chain.calls[1].goal.pose == near
    told = panel.gate(desk.advice, "")
    assert f"- **chosen:** alternative 2 {durations[2]:.2f} s" in told
    desk.play(REFINED)
    desk.step()
    assert stage.executed[0].calls[1].goal.pose == near
    desk.step([lambda: desk.move_object("ball", 0.3, 0.3)])
    assert {chain.calls[0].goal.pose[:2] for chain in desk.draft.alternatives} == {(0.3, 0.3)}
    desk.step([desk.forget_alternatives])
    assert desk.advice is not None
    assert desk.advice.candidates == ()


def test_a_race_gives_two_times_from_the_same_start() -> None:
    desk, stage = desk_and_stage()
    desk.play(NAIVE, REFINED)
    assert desk.playing
    for _ in range(4):
        desk.step()
    assert not desk.playing
    assert desk.race is not None
    naive, refined = desk.runs
    assert 0.0 < refined.duration < naive.duration
    assert desk.race.verdict.startswith(f"naive {naive.duration:.2f} s, refined {refined.duration:.2f} s")
    assert desk.advice is not None
    assert stage.executed == [desk.advice.naive, desk.advice.chain]


def test_who_drags_robot_or_goal_on_does_not_disturb_a_race() -> None:
    desk, _ = desk_and_stage()
    desk.play(NAIVE, REFINED)
    draft = desk.draft
    desk.step([lambda: desk.move_robot(Pose(2.0, 2.0, 1.0)), lambda: desk.move_goal(1, Pose(0.0, 0.0, 0.0))])
    assert desk.draft is draft
    assert len(desk.runs) == 1
    desk.step()
    desk.step()
    assert desk.race is not None
    assert desk.race.verdict.startswith("naive ")


def test_after_a_run_a_drag_begins_at_the_drafts_start() -> None:
    desk, stage = desk_and_stage()
    desk.play(NAIVE)
    desk.step()
    stage.calls.clear()
    desk.step([lambda: desk.move_object("ball", 0.5, 0.5)])
    assert stage.calls == ["place", "go on"]
    assert stage.state.robot.pose == desk.draft.world.robot.pose
    assert not desk.runs


def test_a_plan_that_is_none_is_told_and_not_played() -> None:
    desk, stage = desk_and_stage()
    desk.situation(chain="shoot", seed=5)
    desk.step([lambda: desk.move_goal(0, Pose(0.0, 0.0, 0.0))])  # goToBall, away from the ball
    assert desk.advice is None
    assert "goToBall" in desk.problem
    desk.play(NAIVE)
    desk.step()
    assert not desk.playing
    assert not stage.executed


def test_of_wishes_with_the_same_key_the_newest_counts() -> None:
    inbox, done = Inbox(), list[int]()
    for number in range(3):
        inbox.put("drag", lambda number=number: done.append(number))
    inbox.put("press", lambda: done.append(10))
    for wish in inbox.take():
        wish()
    assert done == [2, 10]
    assert inbox.take() == []


def test_the_ghost_is_where_the_first_run_was_as_long_after_its_start() -> None:
    first, second = Run(NAIVE), Run(REFINED)
    for tick in range(5):
        first.saw(10.0 + tick, Pose(tick, 0.0, 0.0))
    assert first.pose_at(2.0) == Pose(2, 0.0, 0.0)
    assert first.pose_at(99.0) == Pose(4, 0.0, 0.0)
    assert second.pose_at(0.0) is None
    first.ended = second.ended = True
    first.duration = 4.0
    assert Race(first, second).verdict == "refined failed"


def test_the_panel_tells_times_reason_and_the_rule_with_this_situations_numbers() -> None:
    desk, stage = desk_and_stage()
    assert desk.advice is not None
    run = Run(NAIVE, actual=[4.5], duration=9.25)
    table = panel.times(desk.advice, [run]).splitlines()
    assert table[0] == "| s | goToBall | dribbleBall | chain |"
    assert table[-1] == "| naive, driven | 4.50 | - | 9.25 |"
    assert panel.gate(desk.advice, "").startswith("**refined:** predicted gain")
    assert panel.gate(None, "no service") == "**not refined:** no service"
    told = panel.rules(desk.draft.world, desk.advice.chain, ROBOT, stage.refiner.models)
    assert told.count("here time = ") == 2
    predicted = float(told.split("here time = ")[1].split(" ")[0])
    assert predicted == pytest.approx(desk.advice.after[0], abs=0.01)


def test_wheels_roll_with_the_base() -> None:
    wheels = Wheels(ROBOT)
    wheels.roll(0.0, 1.0, 0.0)
    wheels.roll(0.1, 0.5, 0.0)
    assert wheels.angles == pytest.approx([0.05 / ROBOT.wheel_radius] * 2)
    wheels.roll(0.2, 0.0, 1.0)
    turn = 0.1 * ROBOT.track / 2.0 / ROBOT.wheel_radius
    assert wheels.angles[1] - wheels.angles[0] == pytest.approx(2.0 * turn)
    before = list(wheels.angles)
    wheels.roll(0.1, 1.0, 0.0)  # a clock that goes back
    assert wheels.angles == before


class Enough(Exception):  # noqa: N818 (no error)
    """The loop has run long enough."""


def test_a_drag_is_refined_at_half_the_rate_at_which_it_is_shown_and_to_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("viser", reason="needs viser: docs/install.md")
    desk, stage = desk_and_stage()
    asked, rounds = len(stage.asked), iter(range(31))

    class Shown:
        inbox = Inbox()

        def update(self, *_: object) -> None:
            pass

    def drag() -> None:
        number = next(rounds, None)
        if number is None:
            raise Enough
        if number < 25:  # a second
            Shown.inbox.put("ball", lambda: desk.move_object("ball", 0.01 * number, 0.5))

    monkeypatch.setattr("ator_ros.page.page.Page", Shown)
    with pytest.raises(Enough):
        view._loop(desk, Shown(), Wheels(ROBOT), drag)
    assert len(stage.asked) - asked == 13
    assert stage.asked[-1].world.objects["ball"].x == pytest.approx(0.24)
