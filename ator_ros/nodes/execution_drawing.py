"""The chain and the path that the executor drives, as topics for RViz and the view."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from ator_interfaces.msg import ChainPerformance
from ator_ros.domains.domain import Domain
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.drawn import Drawn
from ator_ros.nodes.goal_run import GoalRun
from ator_ros.nodes.markers import marker_array, object_array
from ator_ros.nodes.messages import pose_of, stamp_of
from ator_ros.nodes.qos import LATCHED
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.viewing.chain_picture import goals_of, picture_under_way
from ator_ros.viewing.surroundings import surroundings
from ator_ros.world.state import World

_PERIOD = 0.2
"""Time in s, on odometry's clock, between two updates of the way, which an action may replan in each tick."""
_OBJECTS_PERIOD = 0.1
_ROUNDING = 1e-6
_TELL_PERIOD = 0.5
_MOST_POSES = 60
NO_WAY = np.zeros((0, 3))


class ExecutionDrawing:
    """Publishes what is under way, all of it transient local.

    Publishes
        planned_path (nav_msgs/Path): the way that the action under way has planned; empty where it has none.
        chain_markers (visualization_msgs/MarkerArray): the chain under way; its present subgoal in orange.
        object_markers (visualization_msgs/MarkerArray): the objects, ten times a second to who listens.
        chain_under_way (ator_interfaces/ChainPerformance): the chain under way, at each change and twice a
            second, as far as it is known; predictions are not, and its outcome has code 0 until it ends.
        scene_markers (visualization_msgs/MarkerArray): area, bays, and the domain's lines.

    Parameters
    ----------
    node : Node
        Who publishes.
    domain, robot : Domain, Robot
        With the surroundings.
    frame : str
        The frame of odometry.
    """

    def __init__(self, node: Node, domain: Domain, robot: Robot, frame: str) -> None:
        self._scene, self._frame = robot.scene, frame
        self._path = Drawn(node, Path, "planned_path")
        self._chain = Drawn(node, MarkerArray, "chain_markers")
        self._objects = node.create_publisher(MarkerArray, "object_markers", LATCHED)
        self._surroundings = Drawn(node, MarkerArray, "scene_markers")
        self._surroundings.offer(lambda: marker_array(surroundings(domain, robot), "scene", frame))
        self._under_way = Drawn(node, ChainPerformance, "chain_under_way")
        self._told: tuple[tuple[object, ...], float] = ((), -math.inf)
        self._drawn: tuple[TopChain | None, int] = (None, 0)
        self._way, self._looked, self._shown = NO_WAY, -math.inf, -math.inf

    def follow(self, run: GoalRun, world: World | None) -> None:
        """Tell of the goal under way, and draw its chain until it ends; `world` is the newest state."""
        if world is not None:
            self._tell(run, world)
        self._draw(run.supervisor, world)

    def _tell(self, run: GoalRun, world: World) -> None:
        told, when = self._told
        if run.stage != told or abs(world.time - when) >= _TELL_PERIOD:
            self._told = run.stage, world.time
            self._under_way.offer(partial(run.so_far, world))

    def _draw(self, run: Supervisor, world: World | None) -> None:
        under_way = run.phase is Phase.EXECUTING and world is not None
        drawn = (run.executor.chain if under_way else None, run.executor.index)
        now = 0.0 if world is None else world.time
        if drawn == self._drawn and abs(now - self._looked) < _PERIOD:
            return
        self._looked = now
        if drawn != self._drawn:
            self._drawn, start = drawn, run.start
            pose = Pose(0.0, 0.0, 0.0) if start is None else start.robot.pose
            self._chain.offer(partial(self._chain_message, pose, *drawn))
        way = run.way()
        way = NO_WAY if way is None else way
        if not np.array_equal(way, self._way):
            self._way = way
            self._path.offer(partial(self._path_message, way, now))

    @property
    def watched(self) -> bool:
        """Whether somebody listens to the objects."""
        return bool(self._objects.get_subscription_count())

    def objects(self, world: World) -> None:
        """Draw the objects of the newest state, now and then."""
        if abs(world.time - self._shown) < _OBJECTS_PERIOD - _ROUNDING or not self.watched:
            return
        self._shown = world.time
        self._objects.publish(object_array(world.objects, self._scene, self._frame))

    def _chain_message(self, start: Pose, chain: TopChain | None, step: int) -> MarkerArray:
        shapes = [] if chain is None else picture_under_way(start, goals_of(chain), step)
        return marker_array(shapes, "chain", self._frame)

    def _path_message(self, way: FloatArray, now: float) -> Path:
        message = Path()
        message.header.frame_id, message.header.stamp = self._frame, stamp_of(now)
        kept = np.unique(np.linspace(0, max(len(way) - 1, 0), _MOST_POSES).round().astype(int))
        for row in way[kept[: len(way)]].tolist():
            message.poses.append(PoseStamped(header=message.header, pose=pose_of(Pose(*row))))
        return message
