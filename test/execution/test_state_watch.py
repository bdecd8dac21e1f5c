"""Goals whose states arrive late, or whose objects are seen where they cannot be."""

import math
from collections.abc import Callable, Sequence

import pytest
from executions import LIBRARY, ROBOT, chain, execution
from faulty_base import KinematicBase

from ator_ros.domains.soccer.field import BALL
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.execution.state_watch import DelayWatch, ObjectWatch, Timeliness
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopChain
from ator_ros.world.delay import Delay
from ator_ros.world.inputs import Inputs
from ator_ros.world.state import STOP, ObjectState, RobotState, World

WIDE = Fence(-100.0, -100.0, 100.0, 100.0)
START = Pose(-3.5, 0.0, 0.0)
FAR = chain(("goToPose", Pose(3.5, 0.0, 0.0)))


def drive(
    plan: TopChain, delay: Callable[[float], float], fence: Fence, *, slower: bool = False
) -> tuple[Supervisor, KinematicBase, Sequence[float]]:
    """Drive with states that are delayed by `delay` s at a time in s, for at most 20 s.

    Return also the real times in s at which the robot was paused because of the delay.

    `slower`: the base's clock becomes slower instead, as in a simulation.
    """
    base, inputs = KinematicBase(ROBOT, START), Inputs({})
    run = execution(plan, fence=fence, now=4.0, delay=inputs.delay)
    watch = MotionWatch(ROBOT, 0.0)
    paused, waiting, real, due = [], list[tuple[float, float, RobotState]](), 0.0, 0.0
    while run.phase is not Phase.ENDED and real < 20.0:
        if base.time >= due:
            due += 0.05
            late = delay(base.time)
            arrival = max(base.time + late, waiting[-1][0] if waiting else 0.0)  # in order
            waiting.append((arrival, base.time, base.state()))
        arrived = [state for state in waiting if state[0] <= real + 1e-9]
        if arrived:
            waiting = [state for state in waiting if state[0] > real + 1e-9]
            _, stamp, robot = arrived[-1]
            world = inputs.robot(stamp, robot, real)
            if world is not None and real >= 4.0:
                fault = watch.fault(stamp, robot, real)
                command = run.tick(world, real, fault=fault) or STOP
                if "old when they are read" in run.reason:
                    paused.append(real)
                watch.sent(stamp, command, real)
                base.command(command)
            else:
                base.command(STOP)
        real += 0.01
        while base.time < (real - delay(base.time) if slower else real):
            base.step()
    return run, base, paused


def growing(most: float) -> Callable[[float], float]:
    return lambda time: min(max(0.0, 0.3 * (time - 5.0)), most)


@pytest.mark.parametrize("most", [1.0, 2.0])
def test_a_growing_delay_ends_the_goal_inside_the_fence(most: float) -> None:
    fence = Fence(-5.0, -2.0, -1.5, 2.0)
    for area in (fence, WIDE):
        run, base, _ = drive(FAR, growing(most), area)
        assert run.ending in (Ending.INPUT_LOST, Ending.OUT_OF_BOUNDS), run.reason
        if area is WIDE:
            assert "odom is late: expected states that are at most 0.3 s old" in run.reason
        for _ in range(200):  # until the base's watchdog has stopped it
            base.step()
        assert area.outside(base.pose.x, base.pose.y) == 0.0
        assert base.pose.x < 0.0


def test_a_clock_that_becomes_slower_only_pauses_the_robot() -> None:
    goal = chain(("goToPose", Pose(0.0, 0.0, 0.0)))
    run, base, paused = drive(goal, growing(3.0), WIDE, slower=True)
    assert run.ending is Ending.SUCCEEDED, run.reason
    assert base.pose.x == pytest.approx(0.0, abs=0.05)
    assert 0 < len(paused) < 30


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_a_constant_delay_ends_no_goal(late: float) -> None:
    goal = chain(("goToPose", Pose(-1.0, 0.0, 0.0)))
    run, _, paused = drive(goal, lambda _: late, WIDE)
    assert paused == []
    assert run.ending in (Ending.SUCCEEDED, Ending.BASE_FAULT), run.reason


def peak(middle: float) -> Callable[[float], float]:
    """Return a delay that rises to 0.38 s for 0.2 s around the time `middle` (s)."""
    return lambda time: min(0.38, max(0.0, 0.47 - 0.9 * abs(time - middle)))


def test_a_delay_that_is_over_before_it_is_certain_only_pauses_the_robot() -> None:
    goal = chain(("goToPose", Pose(0.0, 0.0, 0.0)))
    run, base, paused = drive(goal, peak(6.5), WIDE)
    assert run.ending is Ending.SUCCEEDED, run.reason
    assert base.pose.x == pytest.approx(0.0, abs=0.05)
    assert 0 < len(paused) < 10


def test_a_short_delay_does_not_end_the_protection_against_later_ones() -> None:
    def delay(time: float) -> float:
        return peak(5.5)(time) + min(max(0.0, 0.3 * (time - 6.5)), 2.0)

    run, _, _ = drive(FAR, delay, WIDE)
    assert run.ending is Ending.INPUT_LOST, run.reason
    assert "odom is late: expected states that are at most 0.3 s old" in run.reason


class GivenDelay(Delay):
    value = 0.0  # s

    @property
    def seconds(self) -> float:
        return self.value


def test_the_greatest_delay_counts_until_states_are_in_time() -> None:
    delay = GivenDelay()
    watch = DelayWatch(ROBOT, 0.3, delay)

    def judge(tick: int, late: float) -> Timeliness:
        delay.value = late
        return watch.judge(World(0.05 * tick, RobotState(START, 0.5)))

    assert judge(0, 0.8) is Timeliness.DOUBTFUL
    assert judge(1, 0.1) is Timeliness.IN_TIME
    assert watch.greatest == 0.0
    assert judge(2, 0.6) is Timeliness.DOUBTFUL
    found = [judge(tick, 0.4) for tick in range(3, 12)]
    assert found[-1] is Timeliness.LATE
    assert watch.greatest == 0.6


def place(there: Pose) -> tuple[Ending | None, str, float]:
    """Execute goToBall with the ball always at `there` in the robot's frame.

    Return ending, reason and the distance in m that was driven.
    """
    base = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0))
    run = execution(chain(("goToBall", Pose(3.0, 0.0, 0.0))), now=0.0)
    while run.phase is not Phase.ENDED and base.time < 8.0:
        pose = base.pose
        ball = pose.compose(there) if base.time > 1.0 else Pose(3.0, 0.0, 0.0)
        world = World(base.time, base.state(), {BALL: ObjectState(ball.x, ball.y)})
        base.command(run.tick(world, base.time) or STOP)
        for _ in range(5):
            base.step()
    return run.ending, run.reason, math.hypot(base.pose.x, base.pose.y)


@pytest.mark.parametrize("there", [Pose(0.0, 0.0, 0.0), Pose(-0.1, 0.05, 0.0)])
def test_an_object_that_is_seen_inside_the_robot_ends_the_goal(there: Pose) -> None:
    ending, reason, driven = place(there)
    assert ending is Ending.INPUT_LOST
    assert reason.startswith("the ball cannot be at the robot: expected it outside")
    assert driven < 1.5


@pytest.mark.parametrize("there", [Pose(0.6, 0.0, 0.0), Pose(0.4, 0.5, 0.0), Pose(-0.5, 0.0, 0.0)])
def test_an_object_that_moves_with_the_robot_ends_the_goal(there: Pose) -> None:
    ending, reason, driven = place(there)
    assert ending is Ending.INPUT_LOST
    assert reason.startswith("the ball moves with the robot: expected another place beside it")
    assert f"{there.x:.2f} m ahead of the middle of the axle" in reason
    assert driven < 4.5


@pytest.mark.parametrize(
    "there",
    [Pose(0.22, 0.15, 0.0), Pose(0.3, 0.1, 0.0), Pose(0.4, -0.14, 0.0), Pose(0.45, 0.0, 0.0),
     Pose(0.4, 0.0, 0.0), Pose(0.5, 0.05, 0.0)],
)  # fmt: skip
def test_an_object_that_moves_with_the_front_ends_the_goal(there: Pose) -> None:
    ending, reason, driven = place(there)
    assert ending is Ending.INPUT_LOST, reason
    assert reason.startswith(("the ball moves with the robot", "the ball cannot be at the robot"))
    assert f"{there.x:.2f} m ahead of the middle of the axle" in reason
    assert driven < 3.0


def watched(commands: Sequence[tuple[int, float, float]], there: Pose) -> str | None:
    """Return the fault of goToBall with an object that a robot carries at `there`, or None.

    `commands`: numbers of messages at 20 Hz, with the speeds in m/s and rad/s meanwhile.
    """
    watch, top, pose, time, fault = ObjectWatch(ROBOT), LIBRARY["goToBall"], Pose(0, 0, 0), 0.0, ""
    for count, v, w in commands:
        for _ in range(count):
            pose = pose.compose(Pose(0.05 * v, 0.0, 0.05 * w))
            ball = pose.compose(there)
            time += 0.05
            objects = {BALL: ObjectState(ball.x, ball.y)}
            fault = fault or watch.fault(World(time, RobotState(pose, v, w), objects), top) or ""
    return fault or None


def test_a_ball_in_the_holder_is_pushed_forward_and_in_turns_but_not_pulled() -> None:
    hold = Pose(ROBOT.hold + 0.02, 0.03, 0.0)
    turn = [(40, 0.3, 0.0), (60, 0.8, 0.6), (20, 0.2, 0.0)]
    assert watched(turn, hold) is None
    assert "moves with the robot" in (watched([*turn, (12, -0.2, 0.0)], hold) or "")


def test_nothing_beside_the_holder_turns_with_the_robot() -> None:
    beside = Pose(ROBOT.front + 0.09, 0.13, 0.0)
    assert watched([(40, 0.3, 0.0), (40, 0.8, 0.0), (20, 0.2, 0.0)], beside) is None
    assert "moves with the robot" in (watched([(60, 0.8, 0.6)], beside) or "")


def test_a_ball_that_rolls_ahead_of_the_robot_does_not_move_with_it() -> None:
    """It has the robot's speed, and the place beside the robot changes by less than 5 cm."""
    watch, top = ObjectWatch(ROBOT), LIBRARY["goToBall"]
    for tick in range(80):
        pose = Pose(0.05 * tick, 0.0, 0.0)
        ball = ObjectState(0.0495 * tick + 1.0, 0.0, 0.99)
        assert watch.fault(World(0.05 * tick, RobotState(pose, 1.0), {BALL: ball}), top) is None


@pytest.mark.parametrize("turning", [True, False])
def test_a_robot_that_speeds_up_or_turns_leaves_the_objects_beside_it(turning: bool) -> None:
    watch, top, pose, faults = ObjectWatch(ROBOT), LIBRARY["goToBall"], Pose(0.0, 0.0, 0.0), []
    for tick in range(60):
        v = 1.0 if turning else 0.02 * tick
        w = 0.5 if turning else 0.0
        ball = pose.compose(Pose(0.5, 0.6, 0.0))
        objects = {BALL: ObjectState(ball.x, ball.y)}
        faults.append(watch.fault(World(0.05 * tick, RobotState(pose, v, w), objects), top))
        pose = pose.compose(Pose(0.05 * v, 0.0, 0.05 * w))
    assert faults[0] is None
    assert "moves with the robot" in (faults[-1] or "")
    assert "moves with the robot" not in (faults[20] or "")


def test_an_object_in_the_holder_is_where_it_can_be() -> None:
    ending, reason, _ = place(Pose(ROBOT.hold, 0.0, 0.0))
    assert ending is not Ending.INPUT_LOST, reason


def inside(*times: float) -> list[str | None]:
    """Return the faults of states at `times` in s that have a ball in the middle of the robot."""
    watch, top = ObjectWatch(ROBOT), LIBRARY["goToBall"]
    robot = RobotState(Pose(0.0, 0.0, 0.0))
    return [watch.fault(World(t, robot, {BALL: ObjectState(0.0, 0.0)}), top) for t in times]


def test_single_wrong_states_with_a_gap_between_them_are_ignored() -> None:
    assert inside(0.0, 10.0, 20.0) == [None] * 3
    assert inside(0.0, 10.0, 10.2, 10.4, 10.6)[-2:] != [None] * 2
