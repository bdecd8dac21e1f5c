"""Two scenes of a team of three in one simulation, over ROS: a ball for the goal, and deliveries.

In the first each robot has the node `team`, and they take roles (docs/roles.md). In the second the
node `plan_team` divides random pick-ups and deliveries among them (docs/team.md).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from ator_interfaces.action import PlanTeam
from ator_interfaces.msg import Situation, Teammate, TeamMember, TopCall
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.domains.soccer.field import BALL, field_of
from ator_ros.files import atomic_write
from ator_ros.geometry import Pose
from ator_ros.nodes.client_node import ClientNode
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.network import NodesError
from ator_ros.nodes.qos import LATCHED_BY_MANY, SENSOR_DATA
from ator_ros.nodes.subscriptions import TfListener
from ator_ros.nodes.team import TEAMMATES
from ator_ros.resources import resource_path
from ator_ros.tools.floor_plan import draw_floor
from ator_ros.tools.own_nodes import NodeProcesses, unused_domain
from ator_ros.world.readers import pose_from_placement
from ator_ros.world.transforms import Placement

_STARTS = {
    "ann": Pose(-2.0, 0.5, 0.0),
    "bob": Pose(-2.5, -1.3, 0.0),
    "eve": Pose(-0.5, 1.8, -1.5),
}
_COLORS = dict(zip(_STARTS, ("#1f5fa8", "#d9791a", "#2e7d4f"), strict=True))
_BALL_START = (0.5, -0.8)  # m
_WORLD = "world"  # the frame in which the robots of one simulation start
_PACE = 0.5  # of real time: three robots decide five times a second each, on two cores
_LONGEST_SCENE = 60.0  # simulated s
_START_TIMEOUT = 240.0  # real s; the first start compiles code
_ROUND_TIMEOUT = 300.0  # real s
_ODOM_TIMEOUT = 5.0  # real s; longer than on a robot, for busy machines
_DELIVERIES = 4
_SPACING = 0.9  # m, least distance of stations from each other and from the edges


@dataclass(frozen=True)
class Scene:
    """What a scene has shown.

    Attributes
    ----------
    title : str
        What happened, in a line.
    paths : dict of str to list
        x and y in m of each robot on its way, by name.
    texts : dict of str to str
        A robot's name, with its role or its stations in their order.
    ball : list
        x and y in m of the ball on its way; empty without a ball.
    stations : list of Pose
        The stations of a round as sent, without their headings.
    """

    domain: Domain
    robot: Robot
    title: str
    paths: dict[str, list[tuple[float, float]]]
    texts: dict[str, str]
    ball: list[tuple[float, float]]
    stations: list[Pose]


class _Observer(ClientNode):
    """Follows the robots of a simulation; raises NodesError if one of the `nodes` ends."""

    def __init__(self, nodes: NodeProcesses) -> None:
        super().__init__("team_demo", ros_domain=nodes.domain, check=nodes.check)
        self.now = 0.0  # simulated s
        self.paths: dict[str, list[tuple[float, float]]] = {name: [] for name in _STARTS}
        self.ball: list[tuple[float, float]] = []
        self.roles: dict[str, str] = {}
        self._tf = TfListener(self.node)
        for name in _STARTS:
            self._tf.follow(_WORLD, f"{name}/base_link", partial(self._take_robot, name))
        self.node.create_subscription(Odometry, f"ann/{BALL}", self._take_ball, SENSOR_DATA)
        self.node.create_subscription(Teammate, TEAMMATES, self._take_mate, LATCHED_BY_MANY)

    def _take_robot(self, name: str, stamp: float, placement: Placement) -> None:
        self.now = max(self.now, stamp)
        pose = pose_from_placement(placement, name)
        self.paths[name].append((pose.x, pose.y))

    def _take_ball(self, message: Odometry) -> None:
        place = message.pose.pose.position
        self.ball.append((place.x, place.y))

    def _take_mate(self, message: Teammate) -> None:
        self.roles[message.name] = message.role

    def answer(self, future: Future, what: str, timeout: float) -> Any:
        """Return the result of a future."""
        self.until(future.done, what, timeout)
        return future.result()


@contextmanager
def _team(domain: Domain, *, has_roles: bool, pace: float) -> Iterator[_Observer]:
    """Yield an observer of three robots of a domain, whose nodes are ready."""
    starts = [value for pose in _STARTS.values() for value in pose]
    with unused_domain() as nodes:
        simulated = {
            "domain": domain.name,
            "robots": list(_STARTS),
            "robot_start": starts,
            "real_time_factor": pace,
            "command_wait": 1.0,
        }
        if has_roles:
            simulated["ball_start"] = list(_BALL_START)
        nodes.start("simulation", simulated)
        for name in _STARTS:
            own = {"domain": domain.name, "frame": f"{name}/odom"}
            moving = {**own, "robot_frame": f"{name}/base_link"}
            nodes.start("executor", {**moving, "odom_timeout": _ODOM_TIMEOUT}, namespace=name)
            if has_roles:
                roles = resource_path("config", "team/soccer.yaml")
                nodes.start("team", {**moving, "roles": roles}, namespace=name)
            else:
                nodes.start("refinement", own, namespace=name)
        if not has_roles:
            nodes.start("plan_team", {})
        print(f"{domain.name}: three robots start on ROS domain {nodes.domain} …", flush=True)
        with closing(_Observer(nodes)) as observer:
            wanted = {f"/{name}/execute_chain/_action/send_goal" for name in _STARTS}
            if not has_roles:
                wanted |= {f"/{name}/refine_subgoal" for name in _STARTS}
            found = observer.node.get_service_names_and_types
            observer.until(
                lambda: wanted <= {name for name, _ in found()}, "the nodes", _START_TIMEOUT
            )
            yield observer


def play_soccer() -> Scene:
    """Let three robots play until the ball is in the goal; raises NodesError."""
    domain = find_domain("soccer")
    robot = domain.robot()
    goal_x, _ = field_of(robot).goal_center()
    with _team(domain, has_roles=True, pace=_PACE) as team:
        team.until(
            lambda: team.ball and set(team.roles) == set(_STARTS) and all(team.roles.values()),
            "a ball, and roles of all robots",
            _START_TIMEOUT,
        )
        for name in _STARTS:
            client = AsyncParameterClient(team.node, f"/{name}/team")
            team.until(client.services_are_ready, f"the parameters of /{name}/team", _START_TIMEOUT)
            set_to = client.set_parameters([Parameter("execute", value=True)])
            team.answer(set_to, f"an answer of /{name}/team", _START_TIMEOUT)
        began = team.now
        roles = dict(team.roles)
        print(_roles_text(0.0, roles), flush=True)

        def is_over() -> bool:
            nonlocal roles
            if team.roles != roles:
                roles = dict(team.roles)
                print(_roles_text(team.now - began, roles), flush=True)
            return team.ball[-1][0] > goal_x or team.now - began > _LONGEST_SCENE

        team.until(is_over, "the end of the scene", 4.0 * _LONGEST_SCENE / _PACE)
        scored = "goal" if team.ball[-1][0] > goal_x else "no goal"
        title = f"soccer: {scored} after {team.now - began:.1f} s"
        texts = {name: f"{name}: {role or 'no role'}" for name, role in team.roles.items()}
        return Scene(domain, robot, title, team.paths, texts, team.ball, [])


def _roles_text(now: float, roles: dict[str, str]) -> str:
    parts = (f"{name} {roles[name] or 'no role'}" for name in sorted(roles))
    return f"{now:6.1f} s: {', '.join(parts)}"


def play_round(seed: int, pace: float) -> Scene:
    """Let three robots drive random deliveries; raises NodesError."""
    domain = find_domain("drive")
    robot = domain.robot()
    stations = random_deliveries(robot, seed)
    goal = PlanTeam.Goal(execute=True)
    for name, pose in _STARTS.items():
        situation = Situation(robot=pose_of(pose))
        situation.header.frame_id = _WORLD
        goal.robots.append(TeamMember(name=name, situation=situation))
    for index, pose in enumerate(stations):
        call = TopCall(top="goToPose", open=["yaw", "order"])
        call.goal.header.frame_id = _WORLD
        call.goal.pose = pose_of(pose)
        if index % 2:  # the delivery of what was picked up at the station before
            call.after = [index - 1]
        goal.round.calls.append(call)
    with _team(domain, has_roles=False, pace=pace) as team:
        client = ActionClient(team.node, PlanTeam, "plan_team")
        team.until(client.server_is_ready, "the action plan_team", _START_TIMEOUT)
        handle = team.answer(client.send_goal_async(goal), "an answer of plan_team", _START_TIMEOUT)
        answer = team.answer(handle.get_result_async(), "the end of the round", _ROUND_TIMEOUT)
        result = answer.result
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            raise NodesError(f"plan_team: {result.outcome.reason}")
        print(f"drive: {result.outcome.reason}", flush=True)
        texts = {
            part.robot: f"{part.robot}: {', '.join(str(index + 1) for index in part.order)}"
            for part in result.chains
        }
        driven = max(part.actual.duration for part in result.chains)
        title = f"{_DELIVERIES} deliveries (1 to 2, 3 to 4, …): {driven:.1f} s"
        return Scene(domain, robot, title, team.paths, texts, [], stations)


def random_deliveries(robot: Robot, seed: int) -> list[Pose]:
    """Draw places apart from each other; a pick-up comes before its delivery."""
    rng = np.random.default_rng(seed)
    area = robot.scene.area
    half = np.array([area.length, area.width]) / 2.0 - _SPACING
    while True:
        places = rng.uniform(-half, half, (2 * _DELIVERIES, 2))
        if all(math.dist(*pair) > _SPACING for pair in itertools.combinations(places, 2)):
            return [area.at(x, y) for x, y in places]


def save_scenes(file: Path, scenes: list[Scene]) -> None:
    """Draw the paths of each scene in a panel, and write a PNG file."""
    figure = Figure(figsize=(7.0 * len(scenes), 5.2), layout="constrained")
    for number, scene in enumerate(scenes, start=1):
        _draw(figure.add_subplot(1, len(scenes), number), scene)
    with atomic_write(file) as temporary:
        figure.savefig(temporary, format="png", dpi=130)


def _draw(axes: Axes, scene: Scene) -> None:
    draw_floor(axes, scene.domain, scene.robot)
    if scene.ball:
        axes.plot(*np.transpose(scene.ball), ":", color="black", lw=1.2, label="ball")
    for name, path in scene.paths.items():
        axes.plot(*np.transpose(path), color=_COLORS[name], lw=1.8, label=scene.texts.get(name))
        axes.plot(*path[0], "o", color=_COLORS[name], ms=5)
    for number, pose in enumerate(scene.stations, start=1):
        axes.plot(pose.x, pose.y, "+", color="black", ms=7)
        axes.annotate(
            str(number), (pose.x, pose.y), xytext=(4.0, 4.0), textcoords="offset points", fontsize=9
        )
    axes.axis("off")
    axes.set_title(scene.title, fontsize=11)
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4)
