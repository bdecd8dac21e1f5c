"""Chains, worlds and executions for the tests of the executor node's core."""

from ator_ros.actions.base import Goal
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.field import objects_of
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.supervisor import Deadlines, Supervisor
from ator_ros.geometry import Pose
from ator_ros.performance.path_times import path_time_model
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.delay import Delay
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)


def chain(*steps: tuple[str, Pose], opened: frozenset[str] = frozenset()) -> TopChain:
    return TopChain(
        tuple(
            TopCall(LIBRARY[top], Goal(pose, 0.0, LIBRARY[top].point), opened)
            for top, pose in steps
        )
    )


FORWARD = chain(("goToPose", Pose(1.0, 0.0, 0.0)))
FORWARD_LEFT = chain(("goToPose", Pose(1.0, 1.0, 0.0)))


def path_times(library: TopLibrary) -> Predictor:
    models = {
        name: path_time_model(name, library.action_set, library.robot)
        for name in {top.action for top in library.values()}
    }
    return Predictor(library.robot, models)


def execution(
    plan: TopChain,
    *others: TopChain,
    refine: bool = False,
    fetches: int = 0,
    predictor: Predictor | None = None,
    library: TopLibrary = LIBRARY,
    deadlines: Deadlines | None = None,
    fence: Fence | None = None,
    again_after: float = 0.15,
    now: float = 100.0,
    delay: Delay | None = None,
) -> Supervisor:
    return Supervisor(
        library,
        plan,
        refine=refine,
        again_after=again_after,
        now=now,
        predictor=predictor or path_times(library),
        deadlines=deadlines or Deadlines(),
        fence=fence or Fence.around(library.robot),
        fetches=fetches,
        alternatives=others,
        delay=delay,
    )


def world(time: float = 1.0, *, v: float = 0.0, ball: ObjectState | None = None) -> World:
    return World(time, RobotState(Pose(0.0, 0.0, 0.0), v), objects_of(ball))
