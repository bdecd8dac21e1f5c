"""Requests to a planner server that executes one goal at a time, as Nav2's, beside drives."""

import importlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from chain_client import call
from conftest import Host
from geometry_msgs.msg import PoseStamped
from maps import hall_map
from nav2_interfaces import provide_nav2_msgs
from rclpy.action import ActionClient, ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from refinement_requests import refine
from ros_client import Client, SentGoal

from ator_interfaces.srv import PredictDurations, RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of, situation_of
from ator_ros.nodes.path_planner import PlannerClient
from ator_ros.nodes.qos import LATCHED
from ator_ros.refinement import RefinementError
from ator_ros.world.grid_map import PlannerBusyError, save_map
from ator_ros.world.readers import pose_from
from ator_ros.world.state import RobotState, World

pytestmark = pytest.mark.node
CLIENT = {"silent": True}
PLANNER = "compute_path_to_pose"
OURS = Pose(-3.0, 1.0, 0.0)
FOREIGN = Pose(-1.0, -1.0, 0.0)
WITHHELD = "routes by our search on the map, as /navigate_to_pose executes a goal"


class PlannerServer:
    """Plans straight paths, one at a time; of two requests that wait the older one is aborted."""

    def __init__(self, client: Client, takes: float = 0.02) -> None:
        self.kind = importlib.import_module("nav2_msgs.action").ComputePathToPose
        self.starts: list[Pose] = []  # of all requests, in the order of their execution
        self._client, self._takes = client, takes
        self._is_planning, self._waiting = False, Future()
        self._server = client.within(
            lambda: ActionServer(client.node, self.kind, PLANNER, self._plan)
        )

    async def _plan(self, handle: ServerGoalHandle) -> Any:
        result = self.kind.Result()
        if self._is_planning:
            if not self._waiting.done():
                self._waiting.set_result(False)
            self._waiting = Future()
            if not await self._waiting:
                handle.abort()
                return result
        self._is_planning = True
        planned = Future()
        timer = self._client.node.create_timer(
            self._takes, lambda: planned.done() or planned.set_result(None)
        )
        await planned
        self._client.node.destroy_timer(timer)
        ends = handle.request.start, handle.request.goal
        self.starts.append(pose_from(ends[0].pose, "pose"))
        result.path.poses = [PoseStamped(pose=end.pose) for end in ends]
        handle.succeed()
        self._is_planning = False
        if not self._waiting.done():
            self._waiting.set_result(True)
        return result

    def close(self) -> None:
        self._client.within(self._server.destroy)


class Drives:
    """The status of navigate_to_pose, as Nav2 publishes it."""

    def __init__(self, client: Client) -> None:
        self._client = client
        topic = "navigate_to_pose/_action/status"
        self._status = client.node.create_publisher(GoalStatusArray, topic, LATCHED)

    def report(self, status: int) -> None:
        """Report the status of a goal, and wait until it has been received."""
        info = GoalInfo()
        info.goal_id.uuid = [7] * 16
        array = GoalStatusArray(status_list=[GoalStatus(goal_info=info, status=status)])
        self._status.publish(array)
        time.sleep(0.2)

    def end(self) -> None:
        """End without a last message, as a killed server does."""
        self._client.within(lambda: self._client.node.destroy_publisher(self._status))
        time.sleep(0.2)


@pytest.fixture
def planner(client: Client, monkeypatch: pytest.MonkeyPatch) -> Iterator[PlannerServer]:
    provide_nav2_msgs(monkeypatch)
    made = PlannerServer(client)
    yield made
    made.close()


@pytest.fixture
def refinement(client: Client, planner: PlannerServer, host: Host, tmp_path: Path) -> None:
    """Start refinement with the planner, and wait until it can be called."""
    save_map(hall_map("map.yaml"), tmp_path)
    host(
        "refinement", domain="pursuit", map=tmp_path / "map.yaml", frame="map", planner=PLANNER,
        deadline=20.0,
    )  # fmt: skip
    client.call(RefineSubgoal, "refine_subgoal", RefineSubgoal.Request())
    assert planner.starts == [], "a start of refinement asks the planner"


def request() -> RefineSubgoal.Request:
    sent = RefineSubgoal.Request()
    sent.situation.robot = pose_of(OURS)
    middle = call("visit", Pose(-1.0, 1.0, 0.0), opened=("yaw",))
    sent.chain.calls = [middle, call("visit", Pose(-1.0, 3.0, math.pi / 2))]
    return sent


def predicted(client: Client, x: float) -> PredictDurations.Response:
    """Return the duration of a drive to another place for each `x`, so that no path is cached."""
    world = World(0.0, RobotState(OURS))
    calls = [call("visit", Pose(x, 2.0, 0.0))]
    sent = PredictDurations.Request(situations=[situation_of(world, frame="map")], calls=calls)
    answer = client.call(PredictDurations, "predict_durations", sent)
    assert answer.accepted, answer.reason
    assert math.isfinite(answer.durations[0])
    return answer


class ForeignClient:
    """Another client of the planner, such as the navigator during a drive."""

    def __init__(self, client: Client, planner: PlannerServer) -> None:
        self._client, self._kind = client, planner.kind
        self._action = client.within(lambda: ActionClient(client.node, planner.kind, PLANNER))
        assert self._action.wait_for_server(5.0)

    def ask(self) -> SentGoal:
        ends = [PoseStamped(pose=pose_of(pose)) for pose in (FOREIGN, Pose(-1.0, 1.0, 0.0))]
        goal = self._kind.Goal(start=ends[0], goal=ends[1], use_start=True)
        return SentGoal(self._client, self._action, goal)


@pytest.mark.usefixtures("refinement")
def test_while_a_drive_runs_routes_come_from_the_map_and_answers_say_so(
    client: Client, planner: PlannerServer
) -> None:
    drives = Drives(client)
    drives.report(GoalStatus.STATUS_EXECUTING)
    foreign = ForeignClient(client, planner)
    statuses = []
    for number in range(5):
        asked = foreign.ask()
        assert WITHHELD in predicted(client, -2.0 + 0.3 * number).reason
        statuses.append(asked.response().status)
    answer = refine(client, request())
    assert answer.accepted, answer.reason
    assert WITHHELD in answer.reason
    assert statuses == 5 * [GoalStatus.STATUS_SUCCEEDED]
    assert planner.starts == 5 * [FOREIGN]

    drives.report(GoalStatus.STATUS_SUCCEEDED)
    answer = refine(client, request())
    assert "our search" not in answer.reason
    assert planner.starts[5:] == [OURS, Pose(-1.0, 1.0, 0.0)]


@pytest.mark.usefixtures("refinement")
def test_requests_wait_for_those_of_other_clients_and_interrupt_none(
    client: Client, planner: PlannerServer
) -> None:
    foreign = ForeignClient(client, planner)
    for number in range(5):
        asked = foreign.ask()
        answer = predicted(client, -2.0 + 0.3 * number)
        assert "our search" not in answer.reason
        assert asked.response().status == GoalStatus.STATUS_SUCCEEDED
    assert planner.starts == 5 * [FOREIGN, OURS]


@pytest.mark.usefixtures("refinement")
def test_a_navigator_that_was_killed_during_a_drive_does_not_drive(
    client: Client, planner: PlannerServer
) -> None:
    drives = Drives(client)
    drives.report(GoalStatus.STATUS_EXECUTING)
    assert WITHHELD in predicted(client, -2.0).reason
    drives.end()
    assert "our search" not in predicted(client, -1.0).reason
    assert planner.starts == [OURS]


@pytest.fixture
def context(domain: int) -> Iterator[None]:
    """Initialize rclpy as tools do."""
    rclpy.init(args=[], domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()


@pytest.mark.usefixtures("context")
def test_training_waits_for_the_end_of_a_drive_and_then_reports_it(
    client: Client, planner: PlannerServer
) -> None:
    drives = Drives(client)
    drives.report(GoalStatus.STATUS_EXECUTING)
    names = f"/{PLANNER}", "map", 5.0, ["/navigate_to_pose"]
    patient, impatient = PlannerClient(*names, 0.3), PlannerClient(*names)
    ends = OURS[:2], FOREIGN[:2]
    with pytest.raises(
        RefinementError, match=r"expected /navigate_to_pose to be idle within 0.3 s"
    ):
        patient(*ends)
    with pytest.raises(PlannerBusyError):
        impatient(*ends)
    assert planner.starts == []
    drives.report(GoalStatus.STATUS_SUCCEEDED)
    assert patient(*ends) is not None
    assert planner.starts == [OURS]
