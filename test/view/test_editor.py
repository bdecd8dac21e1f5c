"""The editor of the view: edits, executions, running robots, and chains of other clients."""

import pytest
from view.in_process import InProcessBackend, record_of

from ator_interfaces.msg import Outcome
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.network import NodesError, UnavailableError
from ator_ros.view.draft import Draft, situation_draft
from ator_ros.view.editor import NAIVE, REFINED, Editor
from ator_ros.view.runs import OTHERS, Run
from ator_ros.world.state import World


@pytest.fixture
def backend() -> InProcessBackend:
    return InProcessBackend()


@pytest.fixture
def editor(backend: InProcessBackend) -> Editor:
    return backend.editor()


# Edits


def test_a_moved_object_takes_its_subgoal_along_and_refinement_follows(
    editor: Editor, backend: InProcessBackend
) -> None:
    before, edition = len(backend.refined), editor.edition
    editor.step([lambda: editor.move_object("ball", Pose(1.0, 0.5, 0.0))])
    first, last = editor.draft.chain.calls
    assert first.goal.pose[:2] == (1.0, 0.5)
    assert last.goal == backend.refined[0].chain.calls[1].goal
    assert backend.state.objects["ball"].x == 1.0
    assert len(backend.refined) == before + 1
    assert editor.edition > edition
    assert editor.problem == ""


def test_commitments_are_not_refined(editor: Editor) -> None:
    editor.step(
        [
            lambda name=name: editor.edit(lambda draft: draft.with_open(0, name, is_open=False))
            for name in ("yaw", "speed")
        ]
    )
    assert not editor.answer.refined
    assert "nothing is open" in editor.answer.reason


def test_the_best_alternative_is_chosen_and_executed(
    editor: Editor, backend: InProcessBackend
) -> None:
    ball = editor.draft.world.objects["ball"]
    near, far = (Pose(share * ball.x, share * ball.y, 0.0) for share in (0.6, -1.0))
    editor.step([lambda: editor.move_goal(1, near), lambda: editor.edit(Draft.with_alternative)])
    editor.step([lambda: editor.move_goal(1, far)])
    assert [chain.calls[1].goal.pose for chain in backend.refined[-1].alternatives] == [near]
    assert editor.answer.chosen == 1
    editor.execute(NAIVE)
    editor.step()
    assert backend.executed[-1].calls[1].goal.pose == near


def test_weights_are_those_of_all_situations(editor: Editor, backend: InProcessBackend) -> None:
    editor.step([lambda: editor.edit(Draft.with_weight, "duration", 0.0)])
    assert "expected at least one weight above 0" in editor.problem
    editor.step([lambda: editor.edit(Draft.with_weight, "duration", 2.0), editor.reset])
    editor.step([lambda: editor.situation(seed=3)])
    assert backend.refined[-1].weights == {"duration": 2.0}
    assert editor.problem == ""


def test_an_invalid_command_is_reported_and_the_next_one_executed(editor: Editor) -> None:
    editor.step([lambda: editor.situation(seed=-5)])
    assert editor.problem
    editor.step([lambda: editor.situation(chain="dribble", seed=3)])
    assert editor.answer is not None
    assert editor.problem == ""


# Executions


def test_a_race_gives_two_times_from_the_same_start(
    editor: Editor, backend: InProcessBackend
) -> None:
    editor.execute(NAIVE, REFINED)
    draft = editor.draft
    drags = [
        lambda: editor.move_robot(Pose(2.0, 2.0, 1.0)),
        lambda: editor.move_goal(1, Pose(0.0, 0.0, 0.0)),
    ]
    for _ in range(4):
        assert editor.draft is draft  # drags during executions have no effect
        editor.step(drags if editor.executing else [])
    assert not editor.executing
    naive, refined = editor.runs
    assert 0.0 < refined.duration < naive.duration
    assert editor.verdict.startswith(
        f"naive {naive.duration:.2f} s, refined {refined.duration:.2f} s"
    )
    assert backend.executed == [editor.answer.naive, editor.answer.chain]

    backend.calls.clear()
    editor.step(
        [lambda: editor.move_object("ball", Pose(0.5, 0.5, 0.0))]
    )  # starts at the draft's start again
    assert backend.calls == ["place", "go on"]
    assert backend.state.robot.pose == editor.draft.world.robot.pose
    assert not editor.runs


def test_a_race_with_a_failure_has_no_gain(editor: Editor) -> None:
    outcomes = {NAIVE: Outcome.SUCCEEDED, REFINED: Outcome.FAILED}
    editor.runs = [
        Run(label, record_of(code=code, duration=4.0)) for label, code in outcomes.items()
    ]
    assert editor.verdict == "refined failed"


def test_an_invalid_plan_is_reported_and_not_executed(
    editor: Editor, backend: InProcessBackend
) -> None:
    editor.situation(chain="shoot", seed=5)
    editor.step([lambda: editor.move_goal(0, Pose(0.0, 0.0, 0.0))])  # goToBall, away from the ball
    assert editor.answer is None
    assert "goToBall" in editor.problem
    editor.execute(NAIVE)
    editor.step()
    assert not editor.executing
    assert not backend.executed


def test_a_rejected_start_is_reported_and_tried_once(backend: InProcessBackend) -> None:
    class Refusing(InProcessBackend):
        def place(self, world: World) -> None:
            super().place(world)
            raise NodesError("place_robot: off the floor")

    backend = Refusing()
    editor = backend.editor()
    for _ in range(5):
        editor.step()
    assert backend.calls == ["place"]
    assert editor.problem == "place_robot: off the floor"
    editor.execute(NAIVE)
    editor.step()
    assert not editor.executing
    assert not backend.executed


# Running robots


@pytest.fixture
def running(backend: InProcessBackend) -> Editor:
    backend.observe(10.0, Pose(-1.0, 1.5, 0.5), (2.0, -0.5))
    return backend.attached()


def test_a_running_robot_is_followed_until_something_is_moved_or_executed(
    running: Editor, backend: InProcessBackend
) -> None:
    assert backend.calls == []
    assert running.draft.world.robot.pose == Pose(-1.0, 1.5, 0.5)
    assert running.draft.chain.calls[0].goal.pose[:2] == (2.0, -0.5)
    before = len(backend.refined)
    for number in range(1, 11):
        backend.observe(10.0 + 0.1 * number, Pose(-1.0 + 0.1 * number, 1.5, 0.5), (2.0, -0.5))
        running.step()
    assert running.draft.world.robot.pose.x == pytest.approx(0.0, abs=0.25)
    assert 3 <= len(backend.refined) - before <= 6  # not at each step
    backend.observe(12.0, backend.state.robot.pose._replace(yaw=1.5), (2.0, -0.5))
    running.step()
    assert running.draft.world.robot.pose.yaw == 1.5

    running.step([lambda: running.move_object("ball", Pose(1.0, 1.0, 0.0))])
    start = running.draft.world.robot.pose
    backend.observe(20.0, Pose(0.0, 0.0, 0.0), (1.0, 1.0))
    running.step()
    assert running.draft.world.robot.pose == start
    running.select(backend)
    running.step()
    running.execute(NAIVE)
    running.step()
    assert backend.executed
    assert "place" not in backend.calls  # it starts at its current pose
    running.reset()
    running.step()
    assert "place" in backend.calls


def test_refinement_is_called_again_when_it_is_available(
    running: Editor, backend: InProcessBackend
) -> None:
    backend.fails = UnavailableError("expected the service refine_subgoal, it is not there")
    running.step([lambda: running.move_goal(1, Pose(0.5, 0.25, 1.0))])
    assert running.answer is None
    assert "it is not there" in running.problem
    backend.fails = None
    for _ in range(30):
        running.step()
    assert running.answer is not None
    assert running.problem == ""


# Goals of other clients


@pytest.fixture
def goal(backend: InProcessBackend) -> Run:
    """Return a goal of another client that waits for refinement."""
    draft = situation_draft(SOCCER, backend.libraries["default"], "dribble", seed=3, index=1)
    return Run(OTHERS, record_of(reason="waiting for refinement"), draft)


def test_an_external_goal_becomes_the_draft(
    running: Editor, backend: InProcessBackend, goal: Run
) -> None:
    backend.external = goal
    running.step()
    assert running.draft.chain is goal.draft.chain
    answer = running.answer
    assert answer.naive != answer.chain
    assert len(answer.curves) == 1
    assert running.runs == [goal]
    assert running.executing

    goal.draft = Draft(goal.draft.world, answer.chain, goal.draft.action_set)
    goal.record = record_of(duration=0.5, refined=True, refinement="gain of 1.2 s")
    before = len(backend.refined)
    for number in range(5):
        backend.observe(20.0 + 0.1 * number, Pose(-2.0 + 0.1 * number, 0.0, 0.0), (1.0, 0.0))
        running.step()
    answer = running.answer
    assert (answer.chain, answer.refined, answer.reason) == (
        goal.draft.chain,
        True,
        "gain of 1.2 s",
    )
    assert answer.naive.calls[0].goal != answer.chain.calls[0].goal
    assert len(answer.before) == len(answer.after) == 2
    assert len(backend.refined) == before + 1
    assert goal.worlds[-1].robot.pose == Pose(-1.6, 0.0, 0.0)

    goal.record = record_of(code=Outcome.SUCCEEDED, duration=5.0)
    running.step()
    # the editor follows the robot again
    assert running.draft.world.robot.pose == Pose(-1.6, 0.0, 0.0)
    assert backend.calls == []  # nothing was placed or stopped


def test_an_unrefined_chain_is_compared_with_itself(
    running: Editor, backend: InProcessBackend, goal: Run
) -> None:
    backend.external = goal
    goal.record = record_of(duration=0.5, refinement="not requested")
    running.step()
    assert backend.as_given[-1]
    assert [call.goal for call in running.answer.naive.calls] == [
        call.goal for call in goal.draft.chain.calls
    ]


def test_an_external_goal_blocks_edits_and_own_chains_cancel_it(
    running: Editor, backend: InProcessBackend, goal: Run
) -> None:
    backend.external = goal
    running.step()
    before = running.draft
    running.step(
        [
            lambda: running.move_robot(Pose(0.0, 0.0, 0.0)),
            lambda: running.move_goal(1, before.movable_goals[1]),
        ]
    )
    assert running.draft == before
    assert backend.calls == []
    running.step([lambda: running.execute(REFINED)])
    assert backend.calls[0] == "stop"
    assert [run.label for run in running.runs] == [REFINED]


@pytest.mark.parametrize("error", [UnavailableError("not there"), NodesError("no plan")])
def test_without_refinement_it_has_no_predictions(
    running: Editor, backend: InProcessBackend, goal: Run, error: NodesError
) -> None:
    backend.fails, backend.external = error, goal
    running.step()
    assert (running.answer.chain, running.answer.before) == (goal.draft.chain, ())
    assert running.problem == ""


def test_an_ended_external_goal_is_not_shown(
    running: Editor, backend: InProcessBackend, goal: Run
) -> None:
    goal.record = record_of(code=Outcome.FAILED)
    backend.external = goal
    draft = running.draft
    running.step()
    assert running.draft is draft
    assert running.runs == []
