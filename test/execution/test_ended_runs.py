"""Runs of passed steps that end before their last step: canceled, preempted, late, out or stuck."""

from collections.abc import Sequence
from typing import Any

import pytest
from executions import ROBOT, execution

from ator_ros.actions.base import Action, Goal, Status, Step
from ator_ros.actions.goal_variables import STOP, STOPS
from ator_ros.execution.chain_executor import ActionRecord, Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.supervisor import Deadlines, Phase, Supervisor
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP as STANDING
from ator_ros.world.state import RobotState, World

VISIT = Top("visit", "drive", Condition(), Condition((Term("robot.x", "goal.x", 0.3),)))
SPEED = 0.5
PERIOD = 0.1
INSIDE = Fence(-9.0, -9.0, 9.0, 9.0)


class Server:
    """An action server: the places (m) it drives to, those it was sent, and whether it hangs."""

    def __init__(self) -> None:
        self.places: tuple[float, ...] = ()
        self.sent: list[tuple[float, ...]] = []
        self.hangs = False

    def send(self, places: tuple[float, ...]) -> None:
        self.places = places
        self.sent.append(places)


class Early(Action):
    """Sends each goal as soon as the one before is passed."""

    name = "drive"

    def __init__(self, server: Server) -> None:
        super().__init__(ROBOT)
        self.server = server
        self.places: tuple[float, ...] = ()
        self.is_sent = False

    def start(self, world: World, goal: Goal) -> None:
        self.places = (goal.pose.x,)

    def take_over(self, former: Action) -> None:
        assert isinstance(former, Early)
        former.is_sent = False

    def step(self, world: World) -> Step:
        if not self.is_sent:
            self.server.send(self.places)
        self.is_sent = True
        if self.server.hangs:
            return Step(STANDING, Status.FAILED, "drive is gone or hangs")
        arrived = abs(world.robot.pose.x - self.places[0]) < 0.05
        return Step(None, Status.SUCCEEDED if arrived else Status.RUNNING, "driving")

    def end(self, reason: str) -> None:
        if self.is_sent:
            self.server.places = ()


class Through(Early):
    """Sends a run of goals as one."""

    def followed_by(self, goals: Sequence[Goal]) -> None:
        self.places += tuple(goal.pose.x for goal in goals)

    @property
    def drives_on(self) -> bool:
        return len(self.places) > 1

    def take_over(self, former: Action) -> None:
        super().take_over(former)
        self.is_sent = True


class Drive:
    """A goal of the executor whose robot drives along x, as long as the server drives it."""

    def __init__(self, kind: type[Early], **options: Any) -> None:
        self.server = Server()
        self.time = self.x = 0.0
        self.library = TopLibrary(
            ROBOT,
            "default",
            tops=(VISIT,),
            actions={"drive": lambda _: kind(self.server)},
            goal_variables={"drive": (STOPS,)},
        )
        self.options = options
        self.begin((1.0, 0.0), (2.0, 0.0), (3.0, 1.0))

    def begin(self, *stations: tuple[float, float]) -> None:
        """Begin a chain of stations (m), each with whether the robot stops there (1 or 0)."""
        calls = [
            TopCall(VISIT, Goal(Pose(x, 0.0, 0.0), values={STOP: stop})) for x, stop in stations
        ]
        options = {"fence": INSIDE, **self.options}
        self.run: Supervisor = execution(
            TopChain(tuple(calls)), library=self.library, now=self.time, **options
        )

    def until(self, x: float = 99.0, *, speed: float = SPEED, longest: float = 60.0) -> None:
        """Drive to x (m), until the goal ends, or for some seconds."""
        end = self.time + longest
        while self.x < x and self.run.phase is not Phase.ENDED and self.time < end:
            self.time += PERIOD
            v = speed if self.server.places else 0.0
            self.x += PERIOD * v
            state = RobotState(Pose(self.x, 0.0, 0.0), v)
            command = self.run.tick(World(self.time, state), self.time)
            if self.run.phase is not Phase.EXECUTING:
                assert command == STANDING

    @property
    def records(self) -> list[ActionRecord]:
        return self.run.executor.records

    def legs(self) -> list[tuple[int, Ending]]:
        return [(record.index, record.ending) for record in self.records]


kinds = pytest.mark.parametrize("kind", [Early, Through])


@kinds
def test_a_run_has_one_record_for_each_leg(kind: type[Early]) -> None:
    drive = Drive(kind)
    drive.until()
    assert drive.legs() == [(index, Ending.SUCCEEDED) for index in range(3)]
    assert [record.stopped for record in drive.records] == [False, False, True]
    assert [first.end for first in drive.records[:2]] == [last.start for last in drive.records[1:]]
    expected = {Early: [(1.0,), (2.0,), (3.0,)], Through: [(1.0, 2.0, 3.0)]}
    assert drive.server.sent == expected[kind]


@kinds
@pytest.mark.parametrize(("x", "legs"), [(0.4, 1), (0.9, 2), (1.5, 2), (2.2, 3)])
def test_a_canceled_run_stands_and_no_pose_is_driven_to_afterwards(
    kind: type[Early], x: float, legs: int
) -> None:
    drive = Drive(kind)
    drive.until(x)
    sent = list(drive.server.sent)
    drive.run.end(Ending.CANCELED, "canceled by the client")
    assert drive.server.places == ()
    drive.until()
    assert (drive.run.phase, drive.run.ending) == (Phase.ENDED, Ending.CANCELED)
    assert drive.server.sent == sent
    assert drive.x < x + SPEED * PERIOD
    endings = [Ending.SUCCEEDED] * (legs - 1) + [Ending.CANCELED]
    assert drive.legs() == list(enumerate(endings))


@kinds
def test_a_newer_goal_takes_over_from_a_run(kind: type[Early]) -> None:
    drive = Drive(kind)
    drive.until(1.5)
    former = drive.run
    former.end(Ending.PREEMPTED, "a newer goal took over")
    former.drop()
    assert former.phase is Phase.ENDED
    endings = [record.ending for record in former.executor.records]
    assert endings == [Ending.SUCCEEDED, Ending.PREEMPTED]
    sent = len(drive.server.sent)
    drive.begin((4.0, 0.0), (5.0, 1.0))
    drive.until()
    assert drive.legs() == [(0, Ending.SUCCEEDED), (1, Ending.SUCCEEDED)]
    assert {x for places in drive.server.sent[sent:] for x in places} == {4.0, 5.0}
    assert len(former.executor.records) == 2


@kinds
def test_each_leg_of_a_run_has_the_time_limit_of_a_step(kind: type[Early]) -> None:
    drive = Drive(kind, deadlines=Deadlines(action=3.0))
    drive.until()
    assert drive.run.executor.elapsed > 3.0
    assert drive.run.ending is Ending.SUCCEEDED

    drive = Drive(kind, deadlines=Deadlines(action=3.0))
    drive.until(1.5)
    drive.until(speed=0.0)
    assert drive.run.ending is Ending.FAILED
    assert drive.run.reason == "visit took longer than 3 s"
    assert drive.legs() == [(0, Ending.SUCCEEDED), (1, Ending.FAILED)]
    assert drive.server.places == ()


@kinds
def test_a_server_that_hangs_in_a_run_ends_it(kind: type[Early]) -> None:
    drive = Drive(kind)
    drive.until(1.5)
    sent = list(drive.server.sent)
    drive.server.hangs = True
    drive.until()
    assert (drive.run.ending, drive.run.reason) == (Ending.FAILED, "drive is gone or hangs")
    assert drive.legs() == [(0, Ending.SUCCEEDED), (1, Ending.FAILED)]
    assert (drive.server.places, drive.server.sent) == ((), sent)


@kinds
def test_a_run_that_leaves_the_fence_is_stopped(kind: type[Early]) -> None:
    drive = Drive(kind, fence=Fence(-9.0, -9.0, 1.6, 9.0))
    drive.until()
    assert drive.run.ending is Ending.OUT_OF_BOUNDS
    assert drive.x < 1.6
    assert drive.legs() == [(0, Ending.SUCCEEDED), (1, Ending.OUT_OF_BOUNDS)]
    assert drive.server.places == ()


@kinds
def test_a_station_beyond_the_fence_is_refused_and_never_passed(kind: type[Early]) -> None:
    fence = Fence(-9.0, -9.0, 0.9, 9.0)
    drive = Drive(kind, fence=fence)
    assert "calls[0].goal (visit)" in (fence.violation(drive.run.executor.chain, ROBOT) or "")
    drive.until()
    assert drive.run.ending is Ending.OUT_OF_BOUNDS
    assert "the robot would leave the fence" in drive.run.reason
    assert drive.x < 0.9
    assert drive.legs() == [(0, Ending.OUT_OF_BOUNDS)]
    assert drive.server.places == ()
