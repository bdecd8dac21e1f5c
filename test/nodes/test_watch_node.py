"""The node `watch` beside an action server that another client commands."""

import importlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Host
from documentation import ROOT
from geometry_msgs.msg import PoseStamped
from nav2_interfaces import provide_nav2_msgs
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from process import PATIENCE
from profiles import assert_profile
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from ros_client import Client, SentGoal

from ator_interfaces.msg import ActionPerformance, DriveEstimate, Outcome, WatchedDrives
from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.files import save
from ator_ros.geometry import Pose
from ator_ros.learning.gains import ChainGain, Gains, add_chains
from ator_ros.learning.sets import digest_of_start
from ator_ros.learning.watch_tally import KIND, Tally
from ator_ros.nodes.messages import odometry_of, pose_of, stamp_of
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.world.state import RobotState

CLIENT = {"silent": True}
TICK, SPEED, PACE = 0.05, 0.5, 5.0
"""s of a tick and m/s of the robot; how many times as fast as real time it drives."""


class Nav2:
    """Drives along x to each goal at 0.5 m/s, with the topics of Nav2."""

    def __init__(self, client: Client) -> None:
        self.kind = importlib.import_module("nav2_msgs.action").NavigateToPose
        self.client, node = client, client.node
        self.time, self.x, self.goals = 100.0, 0.0, 0
        self.recoveries = 0
        self._goal: ServerGoalHandle | None = None
        self._ended = Future()
        self._odom = node.create_publisher(Odometry, "odom", RESULTS)
        self._plan = node.create_publisher(PathMessage, "plan", RESULTS)
        self._server: ActionServer | None = ActionServer(
            node, self.kind, "navigate_to_pose", self._drive,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        self._sender = ActionClient(node, self.kind, "navigate_to_pose")
        node.create_timer(TICK / PACE, self._tick)

    def send(self, x: float) -> SentGoal:
        goal = self.kind.Goal()
        goal.pose.header.frame_id, goal.pose.pose = "odom", pose_of(Pose(x, 0.0, 0.0))
        self._sender.wait_for_server(10.0)
        return SentGoal(self.client, self._sender, goal)

    def close(self) -> None:
        """End the server, once."""
        self._goal = None
        if self._server is not None:
            self.client.within(self._server.destroy)
            self._server = None

    async def _drive(self, handle: ServerGoalHandle) -> Any:
        self._goal, self._ended = handle, Future()
        self.goals += 1
        path = PathMessage()
        path.header.frame_id, path.header.stamp = "odom", stamp_of(self.time)
        path.poses = [PoseStamped(pose=pose_of(Pose(self.x, 0.0, 0.0))), handle.request.pose]
        self._plan.publish(path)
        await self._ended
        self._goal = None
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.succeed()
        return self.kind.Result()

    def _tick(self) -> None:
        speed = 0.0
        if self._goal is not None and not self._ended.done():
            if self._goal.is_cancel_requested or self._goal.request.pose.pose.position.x < self.x:
                self._ended.set_result(None)
            else:
                speed = SPEED
                self._give_feedback(self._goal)
        self.time, self.x = self.time + TICK, self.x + TICK * speed
        state = RobotState(Pose(self.x, 0.0, 0.0), speed, 0.0)
        self._odom.publish(odometry_of(self.time, state, frame="odom", child="base_link"))

    def _give_feedback(self, handle: ServerGoalHandle) -> None:
        """Publish feedback as often as Nav2, a hundred times in a simulated second."""
        feedback = self.kind.Feedback(number_of_recoveries=self.recoveries)
        feedback.estimated_time_remaining.sec = 3
        for _ in range(5):
            handle.publish_feedback(feedback)


@pytest.fixture
def nav2(client: Client, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nav2]:
    provide_nav2_msgs(monkeypatch)
    made = Nav2(client)
    yield made
    made.close()


def await_watching(nav2: Nav2, client: Client) -> None:
    """Wait until the node receives all topics: goals from before are no drives."""
    topics = ("odom", "plan", "navigate_to_pose/_action/status")
    client.eventually(lambda: all(map(client.node.count_subscribers, topics)), "subscriptions")
    began = nav2.time
    client.eventually(lambda: nav2.time > began + PACE, "a second of odometry")


def test_drives_are_estimated_recorded_and_counted_but_never_commanded(
    nav2: Nav2, client: Client, host: Host, tmp_path: Path
) -> None:
    save(tmp_path / "watch.json", KIND, Tally(drives=4))
    estimates = client.listen(DriveEstimate, "watch/estimates", RESULTS)
    records = client.listen(ActionPerformance, "watch/action", RESULTS)
    tallies = client.listen(WatchedDrives, "watch/drives", LATCHED)
    config = ROOT / "config"
    models, learned = tmp_path / "models", tmp_path / "learned"
    models.mkdir()
    learned.mkdir()
    node = host(
        "watch", domain=config / "nav2" / "stations.yaml", watched=tmp_path,
        models=models, learned=learned, robot=config / "building" / "courier.yaml",
    )  # fmt: skip
    client.eventually(lambda: tallies, "a tally")
    assert tallies[-1].drives == 4  # of before the restart
    assert math.isnan(tallies[-1].refined.measured)
    chains = [ChainGain(refined, gain=2.0, excess=0.5) for refined in (True, True, False, False)]
    add_chains(learned, Gains(digest_of_start(models, [DEFAULT_SET])), *chains)
    client.eventually(lambda: tallies[-1].refined.refined == 2, "the gain of two chains")
    assert tallies[-1].refined.measured == pytest.approx(2.0)
    await_watching(nav2, client)
    sent = nav2.send(4.0)
    goal = bytes(sent.handle.goal_id.uuid).hex()
    sent.response()
    client.eventually(lambda: records and tallies[-1].drives == 5, "a record")
    first, *others = [each for each in estimates if each.goal_id == goal]
    assert first.elapsed <= 0.5 * PACE  # 0.5 s of real time
    assert first.server == "navigate_to_pose"
    assert first.goal.pose.position.x == 4.0
    assert first.total == pytest.approx(4.0 / 0.75, abs=2.0)  # the fastest path
    assert first.basis == "path time, corrected by 0 drives"
    assert others[-1].total > first.total
    (record,) = records
    assert record.outcome.code == Outcome.SUCCEEDED
    assert record.actual.duration == pytest.approx(4.0 / SPEED, abs=1.0)
    assert record.start.robot.position.x == pytest.approx(0.0, abs=0.1)
    assert record.predicted.duration == pytest.approx(first.total)

    canceled = nav2.send(9.0)
    client.eventually(lambda: estimates[-1].goal.pose.position.x == 9.0, "an estimate")
    assert canceled.cancel()
    client.eventually(lambda: tallies[-1].ended_early == 1, "a canceled drive")
    assert (tallies[-1].drives, len(records)) == (5, 1)
    assert tallies[-1].driven > 8.0
    assert tallies[-1].server_error > 0.0

    nav2.recoveries = 1
    nav2.send(nav2.x + 2.0).response()
    client.eventually(lambda: tallies[-1].recovered == 1, "a drive with a recovery")
    assert (tallies[-1].drives, len(records)) == (5, 1)

    events = client.node.create_publisher(ParameterEvent, "/parameter_events", RESULTS)
    client.eventually(events.get_subscription_count, "a subscription to parameter events")
    event = ParameterEvent(node="/controller_server")
    event.changed_parameters = [ParameterMessage(name="FollowPath.desired_linear_vel")]
    events.publish(event)
    warning = "controller_server: FollowPath.desired_linear_vel was changed: drives may take other"
    client.eventually(lambda: warning in node.output, "a warning")
    nav2.send(nav2.x + 2.0).response()
    reason = "a drive is not learned from: controller_server: FollowPath.desired_linear_vel"
    client.eventually(lambda: reason in node.output, "a drive with other parameters")
    assert (tallies[-1].drives, len(records)) == (5, 1)

    nav2.send(nav2.x + 20.0)
    client.eventually(lambda: estimates[-1].goal.pose.position.x > nav2.x + 10.0, "an estimate")
    nav2.close()
    client.eventually(lambda: tallies[-1].ended_early == 2, "a drive whose server is gone")

    assert nav2.goals == 5  # none but the client's
    names = [name for name, _ in node.node.get_client_names_and_types_by_node("watch", "/")]
    assert not names


def test_former_drives_with_other_parameters_do_not_count(
    nav2: Nav2, client: Client, host: Host, tmp_path: Path
) -> None:
    former, now = tmp_path / "1f0c", tmp_path / "2e1d"
    for folder in (former, now):
        folder.mkdir()
    save(former / "watch.json", KIND, Tally(drives=70))
    tallies = client.listen(WatchedDrives, "watch/drives", LATCHED)
    config = ROOT / "config"
    node = host(
        "watch", domain=config / "nav2" / "stations.yaml", watched=now,
        robot=config / "building" / "courier.yaml",
    )  # fmt: skip
    text = "70 drives with other parameters of Nav2, in "
    client.eventually(lambda: text in node.output, "a warning")
    client.eventually(lambda: tallies, "a tally")
    assert tallies[-1].drives == 0


def test_it_uses_exactly_what_its_profile_allows(nav2: Nav2, client: Client, host: Host) -> None:
    config = ROOT / "config"
    host(
        "watch", domain=config / "nav2" / "stations.yaml", planner="compute_path_to_pose",
        robot=config / "building" / "courier.yaml", map="map", robot_from="tf",
    )  # fmt: skip
    assert_profile(client, "watch")


def test_the_page_finds_what_it_shows_by_the_node(
    nav2: Nav2, client: Client, host: Host, domain: int, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    watched_page = pytest.importorskip("ator_ros.view.watched", reason="needs viser")
    save(tmp_path / "watch.json", KIND, Tally(drives=4, estimate_errors=[0.5, 0.25]))
    WatchedPaths(tmp_path / PATHS).save((0.0, 0.0), (2.0, 0.0), np.array([(0.0, 0.0), (2.0, 0.0)]))
    config = ROOT / "config"
    (tmp_path / "models").mkdir()
    host(
        "watch", domain=config / "nav2" / "stations.yaml", watched=tmp_path,
        models=tmp_path / "models", robot=config / "building" / "courier.yaml",
    )  # fmt: skip
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    page = watched_page.WatchClient(timeout=PATIENCE)
    try:
        end = time.monotonic() + 2.0 * PATIENCE
        while page.watched().report is None:
            assert time.monotonic() < end
            page.spin(0.1)
        await_watching(nav2, client)
        nav2.send(20.0)
        while not page.watched().estimates:
            assert time.monotonic() < end
            page.spin(0.1)
        watched = page.watched()
    finally:
        page.close()
    assert page.robot.name == "courier"
    assert watched.report.drives == 4
    assert watched.estimates[0].goal.pose.position.x == 20.0
    assert watched.tally.estimate_errors == [0.5, 0.25]
    assert watched.paths[0].tolist()[-1] == [2.0, 0.0]
    assert "navigate_to_pose:\ntime = " in watched.rules
