"""What the node `simulation` publishes for each of its robots."""

from __future__ import annotations

from nav_msgs.msg import Odometry
from rclpy.node import Node

from ator_ros.nodes import messages
from ator_ros.nodes.embodiment import Embodiment
from ator_ros.nodes.qos import STATES
from ator_ros.nodes.simulated_world import SimulatedRobot


class RobotTopics:
    """Publishes what one robot observes; its name is the namespace of its topics and of its frames.

    Parameters
    ----------
    node : Node
        Who publishes.
    robot : SimulatedRobot
        The robot.
    frame, robot_frame : str
        The frame of odometry and the robot's own, before the name is put before them.

    Attributes
    ----------
    frame, robot_frame : str
        These frames, with the name.
    objects : tuple of str
        The names of the objects that it may observe.
    """

    def __init__(self, node: Node, robot: SimulatedRobot, *, frame: str, robot_frame: str) -> None:
        self._robot = robot
        self._prefix = f"{robot.name}/" if robot.name else ""
        self.frame, self.robot_frame = self.resolved(frame), self.resolved(robot_frame)
        self._odom = node.create_publisher(Odometry, self.resolved("odom"), STATES)
        self._objects = {
            name: node.create_publisher(Odometry, self.resolved(name), STATES)
            for name in robot.robot.scene.objects
        }
        self.objects = tuple(self._objects)
        self._embodiment = Embodiment(
            node, robot.robot, frame=self.frame, robot_frame=self.robot_frame, prefix=self._prefix
        )

    def resolved(self, name: str) -> str:
        """Return the name of a topic, a service or a frame of this robot."""
        return f"{self._prefix}{name}"

    def publish(self) -> None:
        """Publish what is observed."""
        world = self._robot.observed
        # Objects come first, so that who acts on odom has the objects of the same tick.
        for name, there in world.objects.items():
            height = self._robot.robot.scene.radius(name)
            message = messages.object_odometry_of(world.time, there, frame=self.frame, height=height)
            self._objects[name].publish(message)
        odometry = messages.odometry_of(world.time, world.robot, frame=self.frame, child=self.robot_frame)
        self._odom.publish(odometry)
        self._embodiment.publish(world)
