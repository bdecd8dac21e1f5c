"""What RViz and robot_state_publisher need of a robot: tf, joint_states, robot_description."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from ator_ros.geometry import quaternion_from_yaw
from ator_ros.nodes.conversions import stamp_of
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.robot.description import Robot
from ator_ros.robot.wheels import WHEEL_NAMES, Wheels
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.world.state import World

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # ROS without tf
    TFMessage = None


class Embodiment:
    """Publishes, as a base's driver would; the names are relative, so that each namespace has its own.

    Publishes
        tf (tf2_msgs/TFMessage): from the frame of odometry to the robot's own, where somebody listens.
        joint_states (sensor_msgs/JointState): the wheels, where somebody listens.
        robot_description (std_msgs/String, transient local): URDF.

    Parameters
    ----------
    node : Node
        Who publishes.
    robot : Robot
        What is described.
    frame, robot_frame : str
        The frame of odometry, and the robot's own.
    """

    def __init__(self, node: Node, robot: Robot, *, frame: str, robot_frame: str) -> None:
        self._frame, self._robot_frame = frame, robot_frame
        self._wheels = Wheels(robot)
        self._joints = node.create_publisher(JointState, "joint_states", RESULTS)
        self._tf = None if TFMessage is None else node.create_publisher(TFMessage, "tf", RESULTS)
        self._description = node.create_publisher(String, "robot_description", LATCHED)
        self._description.publish(String(data=robot_urdf(robot)))

    def publish(self, world: World) -> None:
        """Publish where the robot is, and how its wheels have turned."""
        state = world.robot
        self._wheels.roll(world.time, state.v, state.w)
        if self._tf is not None and self._tf.get_subscription_count():
            self._tf.publish(TFMessage(transforms=[self._transform(world)]))
        if self._joints.get_subscription_count():
            message = JointState(name=list(WHEEL_NAMES), position=list(self._wheels.angles))
            message.header.stamp = stamp_of(world.time)
            self._joints.publish(message)

    def _transform(self, world: World) -> Any:
        pose = world.robot.pose
        message = TransformStamped(child_frame_id=self._robot_frame)
        message.header.stamp, message.header.frame_id = stamp_of(world.time), self._frame
        transform = message.transform
        transform.translation.x, transform.translation.y = float(pose.x), float(pose.y)
        turn = transform.rotation
        turn.x, turn.y, turn.z, turn.w = quaternion_from_yaw(pose.yaw)
        return message
