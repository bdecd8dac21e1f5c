"""A client of execute_chain, for tests."""

import math
from typing import Any

from geometry_msgs.msg import Twist
from process import PATIENCE
from rclpy.action import ActionClient
from ros_client import Client, SentGoal

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, ChainPerformance, GoalValue, Outcome, TopCall
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED, RESULTS, SENSOR_DATA


def call(top: str, pose: Pose, *, opened: tuple[str, ...] = (), **values: float) -> TopCall:
    """Return one step of a chain, with `values` of the goal variables that its action declares."""
    given = [GoalValue(name=name, value=value) for name, value in values.items()]
    message = TopCall(top=top, open=list(opened), values=given)
    message.goal.pose = pose_of(pose)
    return message


def chain_of_the_paper() -> list[TopCall]:
    """Return the chain goToBall, dribbleBall, shoot for a ball at (0, 0).

    The angle at the ball is free.
    """
    return [
        call("goToBall", Pose(0.0, 0.0, 0.5), opened=("yaw",)),
        call("dribbleBall", Pose(2.4, 0.3, -0.1)),
        call("shoot", Pose(4.0, 0.0, 0.0)),
    ]


# Takes minutes of simulated time, so that all events of a test occur before the chain's end: the
# simulation does not wait for the test's process.
PATROL = [call("goToPose", Pose(2.5, 1.5, 0.0)), call("goToPose", Pose(-2.5, 1.5, 3.1))] * 16


class SentChain(SentGoal):
    """An accepted goal of execute_chain."""

    def wait_for_status(self, words: str) -> None:
        self.client.eventually(lambda: any(words in each.status for each in self.feedback), words)

    def result(self, patience: float = 2 * PATIENCE) -> ExecuteChain.Result:
        return self.response(patience).result

    def outcome(self) -> Outcome:
        return self.result().outcome


class ChainClient:
    """Sends chains and subscribes to the executor's topics, and to cmd_vel if its type is given."""

    def __init__(self, client: Client, commands: type | None = Twist) -> None:
        self.ros = client
        self.actions: list[ActionPerformance] = client.listen(
            ActionPerformance, "performance/action", RESULTS
        )
        self.chains: list[ChainPerformance] = client.listen(
            ChainPerformance, "performance/chain", LATCHED
        )
        self.commands: list[Any] = []
        if commands is not None:
            self.commands = client.listen(commands, "cmd_vel", SENSOR_DATA)
        self._server = ActionClient(client.node, ExecuteChain, "execute_chain")
        self._known = False

    def wait_for_publishers(self) -> None:
        for topic in ("performance/action", "performance/chain", "cmd_vel"):
            self.ros.eventually(lambda name=topic: self.ros.node.count_publishers(name), topic)

    def place(self, robot: Pose) -> None:
        """Place the robot, and the ball at (0, 0), and wait until the executor received that."""
        self.ros.place(robot=robot, ball=(0.0, 0.0))
        self.ros.eventually(
            lambda: self.standing() and self.ros.robot().pose.distance(robot) < 0.01
            and math.hypot(self.ros.ball().x, self.ros.ball().y) < 0.01,
            "robot and ball are placed",
        )  # fmt: skip
        self.wait_for_newer_odometry()

    def wait_for_newer_odometry(self) -> None:
        """Wait for a few messages, so that no older ones remain in an executor's queue."""
        count = len(self.ros.robots)
        self.ros.eventually(lambda: len(self.ros.robots) > count + 3, "newer odometry")

    def send(self, calls: list[TopCall], **options: Any) -> SentChain:
        """Send a chain; options are fields of the goal."""
        assert self._server.wait_for_server(timeout_sec=PATIENCE), "execute_chain is missing"
        self.wait_for_publishers()
        if not self._known:
            self.ros.wait_for_discovery_by("execute_chain")
            self._known = True
        goal = ExecuteChain.Goal(**options)
        goal.chain.calls = calls
        return SentChain(self.ros, self._server, goal)

    def standing(self) -> bool:
        robot = self.ros.robot()
        return abs(robot.vx) < 0.03 and abs(robot.w) < 0.06

    def wait_until_moving(self) -> None:
        self.ros.eventually(lambda: self.ros.robot().vx > 0.2, "the robot drives")
