"""A ball that moves during a chain: following, loss, and fetching."""

from collections.abc import Callable
from typing import Any

import pytest
from refinement_fakes import LIBRARY, ROBOT, call

from ator_ros.actions.base import Status, Step
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.execution.chain_executor import ChainExecutor, Ending
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import CONTROL_PERIOD

HEADING = 0.4

Disturb = Callable[[Simulation, ChainExecutor, Step], bool]


APPROACH = TopChain((call("goToBall", 0.0, 0.0, HEADING),))
DRIBBLE = TopChain((*APPROACH.calls, call("dribbleBall", 2.0, 0.5, 0.3)))


class Drive:
    """A chain executed in the simulation and disturbed until `disturb` returns true."""

    def __init__(self, chain: TopChain, disturb: Disturb, **options: Any) -> None:
        self.executor = ChainExecutor(LIBRARY, chain, **options)
        self.steps: list[Step] = []
        self.speeds: list[float] = []
        self.disturbed: list[float] = []
        with Simulation(ROBOT) as simulation:
            simulation.place_robot(Pose(-2.0, 0.0, 0.0))
            simulation.place_object(BALL, 0.0, 0.0)
            while not self.steps or self.steps[-1].status is Status.RUNNING:
                self._tick(simulation, disturb)
            self.world = simulation.world()

    def _tick(self, simulation: Simulation, disturb: Disturb) -> None:
        self.steps.append(self.executor.step(simulation.world()))
        self.speeds.append(simulation.world().robot.vx)
        simulation.command(self.steps[-1].command)
        simulation.tick()
        if disturb(simulation, self.executor, self.steps[-1]):
            self.disturbed.append(simulation.time)

    @property
    def status(self) -> Status:
        return self.steps[-1].status

    @property
    def tops(self) -> list[tuple[str, Ending]]:
        return [(record.top, record.ending) for record in self.executor.records]


def once(index: int, after: float, move: Callable[[Simulation], None]) -> Disturb:
    """Move the ball once, in step `index`, `after` s from its start."""
    done = False

    def disturb(simulation: Simulation, executor: ChainExecutor, step: Step) -> bool:
        nonlocal done
        since = sum(record.duration for record in executor.records)
        if done or executor.index != index or executor.elapsed - since < after:
            return False
        done = True
        move(simulation)
        return True

    return disturb


def away(simulation: Simulation) -> None:
    ball = ball_of(simulation.world())
    simulation.place_object(BALL, ball.x, ball.y + (1.0 if ball.y < 0.5 else -1.0))


def test_a_displaced_ball_is_followed_without_a_stop() -> None:
    drive = Drive(
        APPROACH, once(0, 1.0, lambda simulation: simulation.place_object(BALL, 0.3, 0.5))
    )
    assert drive.status is Status.SUCCEEDED
    assert drive.tops == [("goToBall", Ending.PREEMPTED), ("goToBall", Ending.SUCCEEDED)]
    goal = drive.executor.chain.calls[0].goal
    assert (goal.pose.x, goal.pose.y) == pytest.approx((0.3, 0.5), abs=0.02)
    assert goal.pose.yaw == HEADING
    assert min(drive.speeds[15:30]) > 0.3
    assert drive.executor.records[0].chain.calls[0].goal == APPROACH.calls[0].goal
    assert drive.executor.records[1].start.robot.vx > 0.3
    total = sum(record.duration for record in drive.executor.records)
    assert total == pytest.approx(drive.executor.elapsed)


def test_a_rolling_ball_is_approached_where_it_comes_to_rest() -> None:
    drive = Drive(
        APPROACH,
        once(0, 0.5, lambda simulation: simulation.place_object(BALL, 0.0, 0.0, vx=0.3, vy=-0.9)),
    )
    assert drive.status is Status.SUCCEEDED
    assert ball_of(drive.world).y < -0.3
    assert drive.executor.chain.calls[0].goal.pose.y == pytest.approx(
        ball_of(drive.world).y, abs=0.15
    )


def test_the_robot_stops_for_a_ball_on_its_path() -> None:
    def into_the_path(simulation: Simulation) -> None:
        ahead = simulation.world().robot.pose.ahead(0.75)
        simulation.place_object(BALL, ahead.x, ahead.y)

    drive = Drive(APPROACH, once(0, 1.5, into_the_path))
    assert drive.status is Status.SUCCEEDED
    assert "stopping" in {step.message.partition(",")[0] for step in drive.steps}
    assert drive.executor.records[1].start.robot.vx == pytest.approx(0.0, abs=0.02)


def test_an_approach_that_follows_the_ball_has_one_time_limit() -> None:
    def aside(simulation: Simulation, executor: ChainExecutor, step: Step) -> bool:
        moves = round(simulation.time / CONTROL_PERIOD) % 8 == 7
        if moves:
            ball = ball_of(simulation.world())
            simulation.place_object(BALL, 0.3, 0.5 if ball.y < 0.25 else 0.0)
        return moves

    drive = Drive(APPROACH, aside, time_limit=1.0)
    assert drive.steps[-1].message == "goToBall took longer than 1 s"
    assert drive.executor.elapsed == pytest.approx(1.05)
    assert [record.ending for record in drive.executor.records[:2]] == [Ending.PREEMPTED] * 2


def test_a_lost_ball_is_fetched_again() -> None:
    drive = Drive(DRIBBLE, once(1, 1.0, away), fetches=1)
    assert drive.status is Status.SUCCEEDED
    assert [record.index for record in drive.executor.records] == [0, 1, 0, 1]
    assert drive.executor.fetch_count == 1
    lost = drive.executor.records[1]
    assert lost.lost
    assert lost.end.time - drive.disturbed[0] < 0.11
    fetch = drive.executor.records[2]
    there = fetch.chain.calls[0].goal.pose
    assert there.yaw == HEADING
    assert there.distance(lost.chain.calls[1].goal.pose) > 0.8
    assert abs(fetch.start.robot.vx) < 0.02
    assert drive.executor.records[3].position_error < 0.06
