"""Requests to the `refinement` node, and small models for it."""

from collections.abc import Callable
from pathlib import Path

from chain_client import call
from experience_rows import synthetic_model
from ros_client import Client

from ator_interfaces.msg import ObjectState
from ator_interfaces.srv import RefineSubgoal
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import save_model
from ator_ros.refinement.refiner import LONGEST_CHAIN


def save_small_models(
    folder: Path, changed: Callable[[PerformanceModel], PerformanceModel] = lambda model: model
) -> None:
    """Write small performance models, learned from synthetic experience."""
    robot = load_robot()
    for action in ("goToPose", "dribbleBall", "shoot"):
        save_model(folder / f"{action}.json", changed(synthetic_model(action, robot)))


def request_of_the_paper(yaw: float = 0.0) -> RefineSubgoal.Request:
    """Return a request for the approach angle before a dribble, compared with `yaw`.

    Failures, which the small models often predict, have no cost.
    """
    request = RefineSubgoal.Request(want_curve=True, as_given=True)
    request.objective.success = 0.0
    request.situation.robot = pose_of(Pose(-2.0, 0.0, 0.0))
    request.situation.objects = [ObjectState(name="ball")]
    request.chain.calls = [
        call("goToBall", Pose(0.0, 0.0, yaw), opened=("yaw",)),
        call("dribbleBall", Pose(0.5, 2.0, 1.5)),
    ]
    return request


def worst_request() -> RefineSubgoal.Request:
    """Return a request for all free variables of the longest chain, the most expensive one."""
    request = RefineSubgoal.Request(situation=request_of_the_paper().situation)
    for step in range(LONGEST_CHAIN):
        goal = Pose(0.1 * ((step + 1) // 2), 0.0, 0.3)
        request.chain.calls.append(
            call("dribbleBall" if step % 2 else "goToBall", goal, opened=("*",))
        )
    return request


def refine(client: Client, request: RefineSubgoal.Request) -> RefineSubgoal.Response:
    return client.call(RefineSubgoal, "refine_subgoal", request)
