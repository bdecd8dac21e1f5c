"""Mock nodes for the view, in the test's process."""

from typing import Any

from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, GoalResponse
from ros_client import Client
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Outcome
from ator_interfaces.srv import PlaceObject, PlaceRobot, RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import object_odometry_of, odometry_of
from ator_ros.nodes.qos import LATCHED, NEWEST, RESULTS, SERVICES
from ator_ros.nodes.simulation import transform_of
from ator_ros.world.state import ObjectState, RobotState

_PERIOD = 0.05
_FLOOR = 4.0
_OFF = 0.1


class MockNodes:
    """Mocks of simulation, refinement, and an executor whose goals never end.

    With `from_tf` the robot's state is on tf only, as the executor reports. `accepts` is whether the
    executor accepts goals.
    """

    def __init__(self, domain: int, *, from_tf: bool = False) -> None:
        self.paused, self.robot = False, Pose(0.5, 0.25, 1.0)
        self._ball: tuple[float, float] | None = None
        self._time, self._from_tf, self._sign = 0.0, from_tf, 1.0
        self.accepts = False
        self._goals: list[Any] = []
        self._own = Client(domain, name="executor", silent=True)
        node = self._own.node
        node.declare_parameter("robot_from", "tf" if from_tf else "odom")
        node.declare_parameter("robot_frame", "base")
        node.declare_parameter("frame", "odom")
        for kind, name, answer in (
            (PlaceRobot, "place_robot", self._place_robot),
            (PlaceObject, "place_ball", self._place_ball),
            (SetBool, "pause", self._pause),
            (RefineSubgoal, "refine_subgoal", lambda _, response: response),
        ):
            node.create_service(kind, name, answer, qos_profile=SERVICES)
        answers = (GoalResponse.REJECT, GoalResponse.ACCEPT)
        self._server = ActionServer(
            node, ExecuteChain, "execute_chain", lambda _: None,
            goal_callback=lambda _: answers[self.accepts], handle_accepted_callback=self._goals.append,
        )  # fmt: skip
        self._odom = node.create_publisher(Odometry, "odom", NEWEST)
        self._balls = node.create_publisher(Odometry, "ball", NEWEST)
        self._tf = node.create_publisher(TFMessage, "/tf", RESULTS)
        self._status = node.create_publisher(ChainPerformance, "chain_under_way", LATCHED)
        node.create_timer(_PERIOD, self._publish)
        self.close = self._own.close

    def vanish(self) -> None:
        """Stop publishing the status of goals, as an executor that has ended."""
        self._goals.clear()
        self._own.within(lambda: self._own.node.destroy_publisher(self._status))

    def restart(self) -> None:
        """Publish no status of former goals, as an executor that was killed and restarted."""
        self._goals.clear()
        self._own.within(
            lambda: self._own.node.create_publisher(ChainPerformance, "chain_under_way", LATCHED)
        )

    def _publish(self) -> None:
        for goal in self._goals:
            name = bytes(goal.goal_id.uuid).hex()
            self._status.publish(ChainPerformance(chain_id=name, outcome=Outcome(reason="executing")))
        self._time += 0.0 if self.paused else _PERIOD
        if self._from_tf:
            transform = transform_of(self._time, self.robot, frame="odom", child="base")
            self._tf.publish(TFMessage(transforms=[transform]))
        else:
            message = odometry_of(self._time, RobotState(self.robot), frame="odom", child="base")
            self._odom.publish(message)
        if self._ball is not None:
            self._sign = -self._sign  # noise with a constant absolute error
            noisy = ObjectState(self._ball[0] + self._sign * _OFF, self._ball[1])
            self._balls.publish(object_odometry_of(self._time, noisy, frame="odom", height=0.1))

    def _place_robot(self, request: PlaceRobot.Request, response: Any) -> Any:
        at = request.pose.pose.position
        response.success, response.message = abs(at.x) < _FLOOR, "off the floor"
        if response.success:
            self.robot = Pose(at.x, at.y, 0.0)
        return response

    def _place_ball(self, request: PlaceObject.Request, response: Any) -> Any:
        at = request.position.point
        response.success, response.message = abs(at.x) < _FLOOR, "off the floor"
        if response.success:
            self._ball = None if request.remove else (at.x, at.y)
        return response

    def _pause(self, request: SetBool.Request, response: Any) -> Any:
        self.paused = request.data
        response.success = True
        return response
