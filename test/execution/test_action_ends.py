"""Each started action is ended once, with the reason.

External actions cause no velocity commands.
"""

import itertools
from collections.abc import Callable

import pytest
from executions import ROBOT, execution

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.execution.chain_executor import ChainExecutor, Ending
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.execution.supervisor import LONGEST_STOP_TIME, Deadlines, Phase
from ator_ros.experience.records import ENDED
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.inputs import Inputs
from ator_ros.world.state import STOP, Command, ObjectState, RobotState, World

VISIT = Top(
    "visit",
    "carried",
    Condition((Term("mark.x", "goal.x", 0.1), Term("mark.y", "goal.y", 0.1))),
    Condition(),
)
CALL = TopCall(VISIT, Goal(Pose(2.0, 0.0, 0.0)))


class ActionLog:
    """Actions that run on an external server, with a log of their starts and ends."""

    def __init__(self) -> None:
        self.starts: list[Goal] = []
        self.ends: list[tuple[Goal, str]] = []
        self.outcome, self.refuses = Status.RUNNING, False

    def library(self) -> TopLibrary:
        actions = self

        class External(Action):
            name = "carried"

            def start(self, world: World, goal: Goal) -> None:
                if actions.refuses:
                    raise ActionError("no server")
                self._goal = goal
                actions.starts.append(goal)

            def step(self, world: World) -> Step:
                return Step(None, actions.outcome, f"carried: {actions.outcome.value}")

            def end(self, reason: str) -> None:
                actions.ends.append((self._goal, reason))

        return TopLibrary(ROBOT, "carried", tops=(VISIT,), actions={"carried": External})


class DrivenGoal:
    """One goal on a robot that an external server moves, in ticks of 1/20 s."""

    def __init__(self, actions: ActionLog, chain: TopChain, *, refine: bool = False) -> None:
        self.execution = execution(
            chain,
            refine=refine,
            again_after=0.0,
            now=0.0,
            library=actions.library(),
            deadlines=Deadlines(action=1.0),
        )
        self.sent: list[Command | None] = []
        self._ticks = itertools.count()
        self.now = 0.0

    def tick(self, *, v: float = 0.0, mark: float = 2.0) -> None:
        self.now = 0.05 * next(self._ticks)
        objects = {"mark": ObjectState(mark, 0.0)}
        self.sent.append(
            self.execution.tick(
                World(self.now, RobotState(Pose(0.0, 0.0, 0.0), v), objects), self.now
            )
        )


def started_goal(actions: ActionLog) -> DrivenGoal:
    goal = DrivenGoal(actions, TopChain((CALL,)))
    goal.tick()
    goal.tick()
    assert actions.starts == [CALL.goal]
    return goal


NOTE = TopCall(Top("note", "carried", Condition(), Condition()), Goal(Pose(1.0, 0.0, 0.0)))


class Carried(Action):
    """An action that succeeds in its first step."""

    name = "carried"

    def start(self, world: World, goal: Goal) -> None: ...

    def step(self, world: World) -> Step:
        return finished(Status.SUCCEEDED, "done")


def library_of(action: type[Action]) -> TopLibrary:
    return TopLibrary(ROBOT, "default", tops=[NOTE.top], actions={"carried": action})


def succeed(actions: ActionLog, goal: DrivenGoal) -> None:
    actions.outcome = Status.SUCCEEDED
    goal.tick()


def take_too_long(actions: ActionLog, goal: DrivenGoal) -> None:
    for _ in range(22):
        goal.tick()


def lose_the_object(actions: ActionLog, goal: DrivenGoal) -> None:
    for _ in range(2):
        goal.now += 0.05
        goal.execution.tick(World(goal.now, RobotState(Pose(0.0, 0.0, 0.0))), goal.now)


def cancel(actions: ActionLog, goal: DrivenGoal) -> None:
    goal.execution.end(Ending.CANCELED, "by the client")


ENDINGS: dict[str, tuple[Callable[[ActionLog, DrivenGoal], None], Ending, str]] = {
    "success": (succeed, Ending.SUCCEEDED, "carried: succeeded"),
    "time limit": (take_too_long, Ending.FAILED, "visit took longer than 1 s"),
    "object": (lose_the_object, Ending.INPUT_LOST, "mark is missing"),
    "cancel": (cancel, Ending.CANCELED, "by the client"),
}


@pytest.mark.parametrize("how", ENDINGS)
def test_an_action_is_ended_once_with_the_reason(how: str) -> None:
    act, ending, reason = ENDINGS[how]
    actions = ActionLog()
    goal = started_goal(actions)
    act(actions, goal)
    goal.execution.end(Ending.SHUTDOWN, "too late")
    goal.tick()
    assert goal.execution.ending is ending
    assert [(of, reason in given) for of, given in actions.ends] == [(CALL.goal, True)]
    assert goal.sent[-1] == STOP


def goal_in(phase: Phase, actions: ActionLog) -> DrivenGoal:
    goal = DrivenGoal(actions, TopChain((CALL,)), refine=phase is Phase.REFINING)
    ticks = {Phase.WAITING: 0, Phase.REFINING: 1}.get(phase, 2)
    for _ in range(ticks):
        goal.tick()
    if phase is Phase.STOPPING:
        actions.outcome = Status.SUCCEEDED
        goal.tick(v=0.5)
    assert goal.execution.phase is phase
    return goal


@pytest.mark.parametrize("cause", [Ending.CANCELED, Ending.INPUT_LOST, Ending.BASE_FAULT, None])
@pytest.mark.parametrize("phase", [Phase.WAITING, Phase.REFINING, Phase.EXECUTING, Phase.STOPPING])
def test_a_goal_may_end_in_each_phase(phase: Phase, cause: Ending | None) -> None:
    actions = ActionLog()
    goal = goal_in(phase, actions)
    execution = goal.execution
    if cause is Ending.INPUT_LOST:
        execution.watch(goal.now + 3.0)
    elif cause is Ending.BASE_FAULT:
        execution.base_fault("it does not move")
    elif cause is not None:
        execution.end(cause, "asked for")
    expected = cause
    if phase is Phase.STOPPING and cause is not Ending.BASE_FAULT:
        expected = Ending.SUCCEEDED  # it had already ended
    assert execution.ending is expected
    execution.end(Ending.SHUTDOWN, "the end")
    execution.drop()
    assert execution.phase is Phase.ENDED
    assert execution.ending is (expected or Ending.SHUTDOWN)
    assert len(actions.starts) == len(actions.ends)


def test_an_action_that_failed_to_start_is_not_ended() -> None:
    actions = ActionLog()
    actions.refuses = True
    goal = DrivenGoal(actions, TopChain((CALL,)))
    goal.tick()
    goal.tick()
    assert goal.execution.ending is Ending.FAILED
    assert actions.ends == []


def test_a_goal_that_the_server_rejects_is_no_experience() -> None:
    actions = ActionLog()
    goal = started_goal(actions)
    actions.outcome = Status.REFUSED
    goal.tick()
    assert goal.execution.ending is Ending.FAILED
    (record,) = goal.execution.executor.records
    assert record.ending is Ending.REFUSED
    assert record.ending.value not in ENDED


def test_a_robot_that_another_program_moves_is_stopped_and_reported() -> None:
    """As by Nav2's controller server after its navigator was killed, while the robot stood."""
    actions = ActionLog()
    goal = started_goal(actions)
    actions.outcome = Status.FAILED
    for _ in range(3):
        goal.tick()
    while goal.execution.phase is not Phase.ENDED:
        goal.tick(v=0.55)
        assert goal.sent[-1] == STOP
    assert goal.now > LONGEST_STOP_TIME
    assert "carried: failed; the robot still moves at 0.55 m/s" in goal.execution.reason


def test_a_moved_goal_ends_the_action_of_the_previous_goal() -> None:
    actions = ActionLog()
    goal = started_goal(actions)
    goal.tick(mark=2.5)
    assert [start.pose.x for start in actions.starts] == [2.0, 2.5]
    assert actions.ends == [(CALL.goal, "another goal took over")]


def test_external_actions_cause_no_commands_and_no_base_fault() -> None:
    actions = ActionLog()
    goal = started_goal(actions)
    watch = MotionWatch(ROBOT, 0.1)
    x = 0.0
    for tick in range(60):
        moved = World(0.05 * tick, RobotState(Pose(x, 0.0, 0.0), 1.0))
        assert watch.fault(moved.time, moved.robot, 0.05 * tick) is None
        assert watch.foresight.punctual(moved.robot, None, 1.0) is None
        watch.sent(moved.time, None)
        x += 0.05
    assert goal.execution.phase is Phase.EXECUTING
    assert goal.sent[1:] == [None]


def test_an_action_is_set_up_once_and_each_start_is_ended_before_the_next() -> None:
    log: list[str] = []

    class CountingAction(Carried):
        def setup(self) -> None:
            log.append("setup")

        def start(self, world: World, goal: Goal) -> None:
            log.append("start")

        def end(self, reason: str) -> None:
            log.append("end")

    executor = ChainExecutor(library_of(CountingAction), TopChain((NOTE, NOTE)))
    for tick in range(2):
        executor.step(World(0.05 * tick, RobotState(Pose(0.0, 0.0, 0.0))))
    assert log == ["setup", "start", "end", "start", "end"]


def test_an_action_that_cannot_be_set_up_fails_its_step() -> None:
    class Broken(Carried):
        def setup(self) -> None:
            raise ActionError("expected a table, found none")

    executor = ChainExecutor(library_of(Broken), TopChain((NOTE,)))
    step = executor.step(World(0.0, RobotState(Pose(0.0, 0.0, 0.0))))
    assert (step.status, step.message) == (Status.FAILED, "expected a table, found none")


def test_an_action_that_raises_in_a_simulated_chain_is_ended() -> None:
    log: list[str] = []

    class Broken(Carried):
        def start(self, world: World, goal: Goal) -> None:
            log.append("start")

        def step(self, world: World) -> Step:
            raise RuntimeError("out of order")

        def end(self, reason: str) -> None:
            log.append(reason)

    with pytest.raises(RuntimeError, match="out of order"):
        run_chain(
            ROBOT,
            library_of(Broken),
            World(0.0, RobotState(Pose(0.0, 0.0, 0.0))),
            TopChain((NOTE,)),
        )
    assert log == ["start", "interrupted"]


def test_an_overdue_object_does_not_pause_an_external_action() -> None:
    goal = started_goal(ActionLog())
    state = World(goal.now + 0.05, RobotState(Pose(0.0, 0.0, 0.0)), {"mark": ObjectState(2.0, 0.0)})
    assert goal.execution.tick(state, state.time, overdue=frozenset({"mark"})) is None


def test_late_odometry_does_not_stop_an_external_action() -> None:
    goal = started_goal(ActionLog())
    assert not goal.execution.odometry_is_late(goal.now + 0.2)
    goal.execution.watch(goal.now + 0.4)
    assert goal.execution.phase is Phase.ENDED
    assert "odom is missing" in goal.execution.reason


def test_after_a_gap_the_robot_stops_before_the_goal_times_out() -> None:
    inputs, robot, slowdown = Inputs({}), RobotState(Pose(0.0, 0.0, 0.0)), 1.0
    for tick in range(80):
        inputs.robot(0.05 * tick, robot, 0.05 * tick + (3.0 if tick >= 60 else 0.0))
        slowdown = max(slowdown, inputs.slowdown)
    assert slowdown > 8.0
    goal = DrivenGoal(ActionLog(), TopChain((CALL,)))
    goal.tick()
    goal.execution.slowdown = slowdown
    assert not goal.execution.odometry_is_late(goal.now + 0.7)
    assert goal.execution.odometry_is_late(goal.now + 0.8)  # five times half of 0.3 s
    goal.execution.watch(goal.now + 1.2)
    assert goal.execution.phase is Phase.EXECUTING
