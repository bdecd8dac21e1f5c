"""What RViz and robot_state_publisher need of a robot: tf, joint_states, robot_description."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.nodes.messages import stamp_of
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.robot.description import Robot
from ator_ros.simulation.urdf import WHEEL_NAMES, Wheels, robot_urdf
from ator_ros.world.state import World

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # ROS without tf
    TFMessage = None


WORLD = "world"
"""The frame in which robots of one simulation begin."""


class Embodiment:
    """Publishes, as a base's driver would; the names are relative, so that each namespace has its own.

    Robots of one node have `tf` in common, in which a frame `world` holds their frames together.

    Publishes
        tf (tf2_msgs/TFMessage): from the frame of odometry to the robot's own, where there are subscribers.
        tf_static (tf2_msgs/TFMessage, transient local), with a prefix: from `world` to the frame of odometry.
        joint_states (sensor_msgs/JointState): the wheels, where there are subscribers.
        robot_description (std_msgs/String, transient local): URDF.

    Parameters
    ----------
    node : Node
        Who publishes.
    robot : Robot
        What is described.
    frame, robot_frame : str
        The frame of odometry, and the robot's own.
    prefix : str
        Put before the names of all topics but tf.
    """

    def __init__(self, node: Node, robot: Robot, *, frame: str, robot_frame: str, prefix: str = "") -> None:
        self._frame, self._robot_frame = frame, robot_frame
        self._wheels = Wheels(robot)
        self._joints = node.create_publisher(JointState, f"{prefix}joint_states", RESULTS)
        self._tf = None if TFMessage is None else node.create_publisher(TFMessage, "tf", RESULTS)
        if TFMessage is not None and prefix:
            self._fixed = node.create_publisher(TFMessage, "tf_static", LATCHED)
            beginning = transform_of(0.0, Pose(0.0, 0.0, 0.0), frame=WORLD, child=frame)
            self._fixed.publish(TFMessage(transforms=[beginning]))
        self._description = node.create_publisher(String, f"{prefix}robot_description", LATCHED)
        self._description.publish(String(data=robot_urdf(robot)))

    def publish(self, world: World) -> None:
        """Publish where the robot is, and how its wheels have turned."""
        state = world.robot
        self._wheels.roll(world.time, state.v, state.w)
        if self._tf is not None and self._tf.get_subscription_count():
            there = transform_of(world.time, state.pose, frame=self._frame, child=self._robot_frame)
            self._tf.publish(TFMessage(transforms=[there]))
        if self._joints.get_subscription_count():
            message = JointState(name=list(WHEEL_NAMES), position=list(self._wheels.angles))
            message.header.stamp = stamp_of(world.time)
            self._joints.publish(message)


def transform_of(time: float, pose: Pose, *, frame: str, child: str) -> TransformStamped:
    """Write the pose of the frame `child` in `frame` at `time` (s) as a transform."""
    message = TransformStamped(child_frame_id=child)
    message.header.stamp, message.header.frame_id = stamp_of(time), frame
    transform = message.transform
    transform.translation.x, transform.translation.y = float(pose.x), float(pose.y)
    turn = transform.rotation
    turn.x, turn.y, turn.z, turn.w = quaternion_from_yaw(pose.yaw)
    return message
