"""A goal whose action an external server executes, and a log of the calls of its actions."""

import itertools

from executions import ROBOT, execution

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.execution.fence import Fence
from ator_ros.execution.supervisor import Deadlines
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Region, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import Command, ObjectState, RobotState, World

VISIT = Top(
    "visit", "carried", Condition((Term("mark.x", "goal.x", 0.1), Term("mark.y", "goal.y", 0.1))), Condition()
)
CALL = TopCall(VISIT, Goal(Pose(2.0, 0.0, 0.0)))
HELD = Condition(tuple(Term(f"hold.{axis}", f"cup.{axis}", 0.12) for axis in "xy"))
CARRY = Top("carry", "carried", HELD, HELD)
ROLL = Top("roll", "carried", Condition(), Condition((Region("mark.x", 3.0, 0.0, 1.0),)), settles=1.0)


class ActionLog:
    """Actions that run on an external server, with a log of their calls."""

    def __init__(self) -> None:
        self.log: list[str] = []
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
                actions.log.append("start")

            def step(self, world: World) -> Step:
                return Step(None, actions.outcome, f"carried: {actions.outcome.value}")

            def end(self, reason: str) -> None:
                actions.ends.append((self._goal, reason))
                actions.log.append("end")

        return TopLibrary(ROBOT, "carried", tops=(VISIT, CARRY, ROLL), actions={"carried": External})


class DrivenGoal:
    """One goal on a robot that an external server moves, in ticks of 1/20 s."""

    def __init__(
        self, actions: ActionLog, chain: TopChain, fence: Fence | None = None, *, refine: bool = False
    ) -> None:
        self.execution = execution(
            chain,
            refine=refine,
            again_after=0.0,
            now=0.0,
            library=actions.library(),
            deadlines=Deadlines(action=1.0),
            fence=fence,
        )
        self.sent: list[Command | None] = []
        self._ticks = itertools.count()
        self.now = 0.0

    def tick(self, *, x: float = 0.0, v: float = 0.0, mark: float = 2.0, cup: float = ROBOT.hold) -> None:
        self.now = 0.05 * next(self._ticks)
        objects = {"mark": ObjectState(mark, 0.0), "cup": ObjectState(cup, 0.0)}
        self.sent.append(
            self.execution.tick(World(self.now, RobotState(Pose(x, 0.0, 0.0), v), objects), self.now)
        )


def started_goal(actions: ActionLog, fence: Fence | None = None, steps: int = 1) -> DrivenGoal:
    goal = DrivenGoal(actions, TopChain((CALL,) * steps), fence)
    goal.tick()
    goal.tick()
    assert actions.starts == [CALL.goal]
    return goal
