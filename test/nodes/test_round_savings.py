"""Rounds are compared while the server is idle; the planner is asked for what no drive showed."""

import importlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav2_interfaces import provide_nav2_msgs
from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from refinement_fakes import FakeModel
from ros_client import Client

from ator_ros.domains.domain import find_domain
from ator_ros.experience.watched_paths import WatchedPaths
from ator_ros.geometry import Pose
from ator_ros.learning.savings import Round, RoundSavings
from ator_ros.nodes.round_savings import RoundSavingsQueue
from ator_ros.world.state import RobotState

CLIENT = {"silent": True}
DOMAIN = find_domain("pursuit")
LIBRARY = DOMAIN.library(DOMAIN.robot())
USED = frozenset({"x", "y", "xg", "yg"})
MODELS = {
    "pursue": FakeModel(lambda d: np.hypot(d["xg"] - d["x"], d["yg"] - d["y"]), USED),
}
PLANNER = "compute_path_to_pose"
FORTH_AND_BACK = Round(
    "pursue",
    RobotState(Pose(0.0, 0.0, 0.0)),
    (Pose(4.0, 0.0, 0.0), Pose(2.0, 0.0, 0.0), Pose(4.5, 1.0, 0.0)),
)


class Planner:
    """Plans straight paths; it refuses the first request."""

    def __init__(self, client: Client) -> None:
        self._kind = importlib.import_module("nav2_msgs.action").ComputePathToPose
        self.times: list[float] = []
        self._client = client
        self._server = client.within(
            lambda: ActionServer(client.node, self._kind, PLANNER, self._plan)
        )

    def _plan(self, handle: ServerGoalHandle) -> Any:
        self.times.append(time.monotonic())
        result = self._kind.Result()
        if len(self.times) == 1:
            handle.abort()
            return result
        ends = (handle.request.start, handle.request.goal)
        result.path.poses = [PoseStamped(pose=end.pose) for end in ends]
        handle.succeed()
        return result

    def close(self) -> None:
        self._client.within(self._server.destroy)


@pytest.fixture
def planner(client: Client, monkeypatch: pytest.MonkeyPatch) -> Iterator[Planner]:
    provide_nav2_msgs(monkeypatch)
    made = Planner(client)
    yield made
    made.close()


def updated(client: Client, queue: RoundSavingsQueue, *, is_busy: bool) -> RoundSavings | None:
    found: RoundSavings | None = client.within(
        lambda: queue.update(LIBRARY, MODELS, is_busy=is_busy, may_pass=False)
    )
    return found


@pytest.mark.long
def test_the_planner_is_asked_once_a_second_and_only_while_the_server_is_idle(
    client: Client, planner: Planner
) -> None:
    paths = WatchedPaths()
    places = [FORTH_AND_BACK.start.pose, *FORTH_AND_BACK.goals]
    for start in places[:3]:  # all but those from the last goal are known
        for goal in places:
            if start != goal:
                ends = start[:2], goal[:2]
                paths.add(*ends, np.array(ends))
    queue = client.within(lambda: RoundSavingsQueue(client.node, PLANNER, "map", paths))
    queue.add(FORTH_AND_BACK)
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        assert updated(client, queue, is_busy=True) is None
        time.sleep(0.2)
    assert planner.times == []

    found = client.eventually(
        lambda: time.sleep(0.1) or updated(client, queue, is_busy=False), "savings"
    )
    assert found.order.seconds == pytest.approx(4.0 + 2.0 + 2.7 - (2.0 + 2.0 + 1.1), abs=0.1)
    assert len(planner.times) == 3  # two legs, and the request that was refused
    assert np.diff(planner.times).min() > 0.9
