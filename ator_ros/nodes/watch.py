"""The node `watch`: estimates and learns from the drives that any client commands, as of Nav2."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from action_msgs.msg import GoalStatusArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from ator_interfaces.msg import ActionPerformance, DriveEstimate, Outcome, WatchedDrives
from ator_interfaces.msg import Saving as SavingMessage
from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.bases.drive_parts import parts_of_drive
from ator_ros.domains.domain import Domain
from ator_ros.experience.server_drives import ODOM, TF
from ator_ros.experience.server_goals import (
    FEEDBACK_SUFFIX,
    GOAL_POSE,
    PLAN,
    STATUS_SUFFIX,
    ServerGoal,
    remote_calls,
    through_servers,
)
from ator_ros.experience.table import Episode
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.files import FileError
from ator_ros.learning.drive_monitor import DriveMonitor, EndedDrive
from ator_ros.learning.estimates import Estimate
from ator_ros.learning.savings import Round, Rounds, Saving
from ator_ros.learning.watch_tally import TALLY, drives_elsewhere, read_tally, save_tally
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health, Warnings
from ator_ros.nodes.main_loop import run_node
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.messages import (
    call_of,
    gain_of,
    performance_of,
    pose_of,
    situation_of,
    stamp_of,
)
from ator_ros.nodes.models import LEARNED, LearnedSets
from ator_ros.nodes.nav2_setup import DRIVING_NODES, FOLDER
from ator_ros.nodes.parameters import (
    FRAME,
    MODELS,
    PLANNER,
    STATE,
    WORLD,
    Parameter,
    SetupError,
    declare_parameters,
    domain_and_robot,
)
from ator_ros.nodes.qos import ALL_SENSOR_DATA, LATCHED, LATCHED_BY_MANY, RESULTS
from ator_ros.nodes.remote_messages import RemoteError, action_type
from ator_ros.nodes.round_savings import RoundSavingsQueue
from ator_ros.nodes.subscriptions import PolledTopic
from ator_ros.printable import one_line
from ator_ros.refinement.gate import MeasuredGain
from ator_ros.tops.chain import TopCall
from ator_ros.tops.library import TopLibrary
from ator_ros.world.readers import MessageError
from ator_ros.world.state import RobotState, World

WATCHED = Parameter(
    "watched",
    "",
    f"folder of the paths and the tally of watched drives; empty: {FOLDER}",
)
PARAMETERS = (
    FRAME,
    *WORLD,
    STATE,
    MODELS,
    LEARNED,
    WATCHED,
    PLANNER,
    Parameter("odometry", "odom", "topic of odometry (nav_msgs/Odometry)"),
    Parameter(
        "others",
        ["navigate_through_poses"],
        "further action servers, whose goals are estimated by length and turns of their path; of "
        "one that drives through poses, each leg is learned from if the action can pass",
    ),
)
_PERIOD = 0.5  # real s between two estimates of a drive
_TEXT_HEIGHT = 0.3  # m, of the estimate in RViz
_TEXT_ABOVE = 0.5  # m above the floor
_OUTCOMES = {"succeeded": Outcome.SUCCEEDED, "aborted": Outcome.FAILED}
_LOGGED = (1, 5, 10)  # drives after which the tally is logged, and after every ten


def watched_folder(name: str) -> Path:
    """Return the folder that the parameter `watched` names."""
    return Path(name or FOLDER).expanduser()


class WatchNode(Node):
    """Watches the drives of an action server such as Nav2's, whoever commands them.

    It sends no goal and no command. Its paths are those that the server publishes. `planner` is
    only asked for those of other orders of rounds, while the server is idle.

    Subscribes to
        SERVER/_action/status (action_msgs/GoalStatusArray), SERVER/_action/feedback, of the
        domain's remote actions, of servers that drive through poses for them, and of the servers
        `others`. plan (nav_msgs/Path), goal_pose
        (geometry_msgs/PoseStamped), the topic of odometry (nav_msgs/Odometry), /tf, /tf_static.
        The topic of a map (nav_msgs/OccupancyGrid, transient local), if `map` names one.
        /parameter_events (rcl_interfaces/ParameterEvent): changes of how Nav2 drives, after which
        drives are not learned from.
    Publishes
        ~/estimates (ator_interfaces/DriveEstimate): twice a second for each running goal, the first
        one with the first path. ~/markers (visualization_msgs/MarkerArray): the remaining times, at
        the goals. ~/action (ator_interfaces/ActionPerformance): each drive that has ended by
        itself, for the node `learning`. ~/drives (ator_interfaces/WatchedDrives, transient local):
        what drives have shown so far.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    Calls
        the action that `planner` names (nav2_msgs/ComputePathToPose), at most once a second.
    Writes
        the folder `watched`: the paths of drives, and the tally.
    """

    def __init__(self) -> None:
        super().__init__("watch", automatically_declare_parameters_from_overrides=True)
        settings = declare_parameters(self, PARAMETERS)
        domain, robot = domain_and_robot(settings)
        self._frame = settings["frame"]
        self._calls = remote_calls(domain)
        if not self._calls:
            raise SetupError(
                f"parameter domain: expected an action of a server, {domain.name} has none"
            )
        self._folder = watched_folder(settings["watched"])
        self._warn = Warnings(self)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            paths = WatchedPaths(self._folder / PATHS)
            self._tally, damage = read_tally(self._folder / TALLY)
        except (FileError, OSError) as error:
            raise SetupError(f"parameter watched: {error}") from error
        if damage:
            self._warn(damage)
        self._monitor = DriveMonitor(
            robot,
            domain,
            self._frame,
            paths,
            robot_in_tf=settings["robot_from"] == "tf",
            others=settings["others"],
        )
        self._tops = {top.action: top for top in domain.tops}
        self._robot = robot
        self._servers = {name: call.server for name, call in self._calls.items()}
        self._through = through_servers(domain)
        self._servers |= {name: name for name in (*settings["others"], *self._through)}
        self._libraries = self._libraries_on_map()
        self._sets = LearnedSets(self, self._monitor.domain, self._libraries, settings)
        self._used: object = None  # models
        self._reported: object = None  # gains
        self._map = FollowedMap(self, settings, domain, robot, self._take_map)
        self._estimates = self.create_publisher(DriveEstimate, "~/estimates", RESULTS)
        self._markers = self.create_publisher(MarkerArray, "~/markers", LATCHED)
        self._records = self.create_publisher(ActionPerformance, "~/action", RESULTS)
        self._drives = self.create_publisher(WatchedDrives, "~/drives", LATCHED)
        self._published: set[bytes] = set()
        self._rounds = Rounds()
        try:
            self._savings = RoundSavingsQueue(self, settings["planner"], self._frame, paths)
        except RemoteError as error:
            raise SetupError(f"parameter planner: {error}") from error
        self._feedback: dict[str, PolledTopic] = {}
        self._changed = ""  # a parameter of Nav2 that was changed since the start
        self.create_subscription(
            ParameterEvent, "/parameter_events", self._take_parameters, RESULTS
        )
        self._subscribe(settings["odometry"])
        self.create_timer(_PERIOD, self._update, clock=STEADY)
        Diagnostics(self, self._health)
        self._use_models()
        servers = ", ".join(self._servers.values())
        self.get_logger().info(
            f"watching {servers} for {robot.name} (domain {domain.name}, ROS domain "
            f"{self.context.get_domain_id()}); {self._summary()}"
        )
        former = drives_elsewhere(self._folder)
        if former and not self._tally.drives:
            self.get_logger().warning(
                f"{former} drives with other parameters of Nav2, in {self._folder.parent}, do not "
                "count"
            )

    def _subscribe(self, odometry: str) -> None:
        """Subscribe to all inputs: first to the status of goals, which must come before paths."""
        for server in self._servers.values():
            role = f"{server}{STATUS_SUFFIX}"
            take = partial(self._take, role)
            self.create_subscription(GoalStatusArray, role, take, LATCHED_BY_MANY)
        for call in self._calls.values():
            role = f"{call.server}{FEEDBACK_SUFFIX}"
            try:
                kind = action_type(call.type).Impl.FeedbackMessage
            except RemoteError as error:
                raise SetupError(f"parameter domain: {error}") from error
            self._feedback[role] = PolledTopic(self, kind, role)
        for server, (_, kind_name) in self._through.items():
            role = f"{server}{FEEDBACK_SUFFIX}"
            with suppress(RemoteError):  # then corners of paths are no poses
                kind = action_type(kind_name).Impl.FeedbackMessage
                self._feedback[role] = PolledTopic(self, kind, role)
        for role, kind, topic, qos in (
            (ODOM, Odometry, odometry, ALL_SENSOR_DATA),
            (TF[1], TFMessage, "/tf_static", LATCHED_BY_MANY),
            (TF[0], TFMessage, "/tf", RESULTS),
            (GOAL_POSE, PoseStamped, "goal_pose", RESULTS),
            (PLAN, PathMessage, "plan", RESULTS),
        ):
            self.create_subscription(kind, topic, partial(self._take, role), qos)

    def _take_parameters(self, event: ParameterEvent) -> None:
        """Notice that Nav2 drives otherwise from now on."""
        namespace = self.get_namespace().rstrip("/")
        name = event.node.removeprefix(f"{namespace}/")
        changed = [item.name for item in event.changed_parameters]
        if name in DRIVING_NODES and changed and not self._changed:
            self._changed = f"{name}: {changed[0]} was changed"
            advice = "drives may take other times; launch again to learn them"
            self.get_logger().warning(one_line(f"{self._changed}: {advice}"))

    def _libraries_on_map(self) -> dict[str, TopLibrary]:
        domain = self._monitor.domain
        robot = domain.equip(self._robot)
        return {name: domain.library(robot, name) for name in domain.action_sets}

    def _take_map(self, domain: Domain, _: Robot) -> None:
        self._monitor.on_map(domain)
        self._libraries = self._libraries_on_map()
        self._sets.load(self._monitor.domain, self._libraries)

    def _take(self, role: str, message: Any) -> None:
        if role == PLAN or role.endswith(STATUS_SUFFIX):
            self._take_feedback()  # what came before
        self._add(role, message)
        if role.endswith(STATUS_SUFFIX):
            self._take_ended()
        if role == PLAN or role.endswith(STATUS_SUFFIX):
            waiting = (
                goal.path is not None and goal.goal_id not in self._published
                for goal in self._monitor.watch.active
            )
            if any(waiting):
                self._publish_estimates()  # the first one

    def _add(self, role: str, message: Any) -> None:
        try:
            self._monitor.watch.add(role, message)
        except MessageError as error:
            self._warn(f"ignored: {error}")

    def _take_feedback(self) -> None:
        """Add the newest feedback of each server: Nav2 sends it a hundred times a second."""
        for role, topic in self._feedback.items():
            message = topic.take()
            if message is not None:
                self._add(role, message)

    @property
    def _digest(self) -> str:
        return "" if self._sets.present[DEFAULT_SET].absent else self._sets.gains.models

    @property
    def _refined(self) -> MeasuredGain:
        """What refining chains has gained with the present models."""
        return self._sets.gains.of(DEFAULT_SET).measured

    def _summary(self) -> str:
        return one_line(self._tally.summary(self._digest, self._refined))

    def _use_models(self) -> None:
        """Use the present models, and report their measured gain, if they are others."""
        present = self._sets.present[DEFAULT_SET]
        gains = self._sets.gains
        if present is not self._used or gains is not self._reported:
            self._used = present
            self._reported = gains
            self._monitor.use(present.models, self._digest)
            self._publish_tally()

    def _update(self) -> None:
        self._take_feedback()
        self._lose_goals()
        self._use_models()
        self._publish_estimates()
        self._monitor.watch.forget()
        self._compare_rounds()

    def _lose_goals(self) -> None:
        """End the goals of servers that are gone: nobody else would."""
        lost = {goal.action for goal in self._monitor.watch.active}
        for action in lost:
            if not self.count_publishers(f"{self._servers[action]}{STATUS_SUFFIX}"):
                self._monitor.watch.lose(action)
                self._take_ended()

    def _compare_rounds(self) -> None:
        """Compare rounds that have ended with what refinement would have changed."""
        watch = self._monitor.watch
        if not watch.active and self._rounds.is_over(watch.now):
            self._add_round(self._rounds.close())
        present = self._sets.present[DEFAULT_SET]
        found = self._savings.update(
            self._libraries[DEFAULT_SET],
            {} if present.absent else present.models,
            is_busy=bool(watch.active),
            may_pass=any(call.passes for call in self._calls.values()),
        )
        if found is not None:
            self._tally.add_savings(found, _today())
            self._save_tally()

    def _add_round(self, found: Round | None) -> None:
        if found is not None:
            self._savings.add(found)

    def _publish_estimates(self) -> None:
        found = self._monitor.estimates()
        for goal, estimate in found:
            self._published.add(goal.goal_id)
            self._estimates.publish(self._estimate_message(goal, estimate))
        if found:
            self._markers.publish(MarkerArray(markers=[*_markers(found)]))

    def _estimate_message(self, goal: ServerGoal, estimate: Estimate) -> DriveEstimate:
        message = DriveEstimate(
            server=self._servers[goal.action],
            goal_id=goal.goal_id.hex(),
            elapsed=estimate.elapsed,
            remaining=estimate.remaining,
            spread=estimate.spread,
            bound=estimate.bound,
            total=estimate.total,
            basis=estimate.basis,
        )
        message.header.stamp = stamp_of(self._monitor.watch.now)
        message.header.frame_id = goal.frame
        if goal.pose is not None:
            message.goal.header = message.header
            message.goal.pose = pose_of(goal.pose)
        return message

    def _take_ended(self) -> None:
        try:
            ended = self._monitor.ended()
        except OSError as error:
            self._warn(f"watched: {error}")
            return
        if self._changed:
            ended = [replace(drive, episode=None, reason=self._changed) for drive in ended]
        for drive in ended:
            self._published.discard(drive.goal.goal_id)
            if drive.episode is not None and not drive.is_held_up:
                self._records.publish(self._record(drive, drive.episode))
            self._count(drive)
        if ended and not self._monitor.watch.active:
            self._markers.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))

    def _count(self, drive: EndedDrive) -> None:
        """Count a drive, and report the tally."""
        before = self._tally.drives
        self._tally.add(drive, _today())
        self._add_round(self._rounds.add(drive))
        self._save_tally()
        drives = self._tally.drives
        if drives > before and (drives in _LOGGED or drives % 10 == 0):
            self.get_logger().info(self._summary())
        if drive.reason:
            self.get_logger().info(one_line(f"a drive is not learned from: {drive.reason}"))

    def _save_tally(self) -> None:
        try:
            save_tally(self._folder / TALLY, self._tally)
        except OSError as error:
            self._warn(f"watched: {error}")
        self._publish_tally()

    def _record(self, drive: EndedDrive, episode: Episode) -> ActionPerformance:
        """Return the record of a drive, as the executor publishes those of its own."""
        situation = episode.situation
        top = self._tops[situation.action]
        frame = drive.goal.frame
        start = World(drive.goal.begin, situation.robot, situation.objects)
        pose = drive.goal.final_pose or situation.goal.pose
        end = World(drive.goal.end, RobotState(pose), {})
        duration = episode.duration
        samples = episode.samples
        parts = {}
        if samples is not None:
            parts = parts_of_drive(samples[:, 0], samples[:, 4], duration)._asdict()
        predicted = {}
        if drive.first is not None:
            first = drive.first
            predicted = {
                "duration": first.total,
                "spread": first.spread,
                "bound": first.bound,
            }
        code = Outcome.SUCCEEDED if episode.success else _OUTCOMES[drive.goal.status]
        actual = {
            "duration": duration,
            "spread": 0.0,
            "bound": duration,
            "success": float(episode.success),
            "accuracy": episode.position_error,
        }
        ended = situation_of(end, frame=frame)
        return ActionPerformance(
            header=ended.header,
            chain_id=drive.goal.goal_id.hex(),
            steps=1,
            action=situation.action,
            action_set=DEFAULT_SET,
            call=call_of(TopCall(top, situation.goal), frame=frame),
            start=situation_of(start, frame=frame),
            end=ended,
            predicted=performance_of(predicted),
            actual=performance_of(actual),
            stopped=not drive.goal.is_passed,
            **parts,
            heading_error=episode.heading_error,
            outcome=Outcome(code=code, reason=episode.reason),
        )

    def _publish_tally(self) -> None:
        tally = self._tally
        message = WatchedDrives(
            server=next(iter(self._servers.values())),
            drives=tally.drives,
            held_up=tally.held_up,
            recovered=tally.recovered,
            ended_early=tally.ended_early,
            models=self._digest,
            estimated=len(tally.estimate_errors),
            estimate_error=tally.estimate_error,
            server_error=tally.server_error,
            driven=tally.driven,
            refined=gain_of(measured=self._refined, models=self._digest),
        )
        savings = tally.savings
        message.headings = _saving_of(savings.headings)
        message.passing = _saving_of(savings.passing)
        message.order = _saving_of(savings.order)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = self._frame
        self._drives.publish(message)

    def _health(self) -> Health:
        missing = [
            call.server
            for call in self._calls.values()
            if not self.count_publishers(f"{call.server}{STATUS_SUFFIX}")
        ]
        absent = ""
        if missing:
            absent = f"{', '.join(missing)}: expected an action server, got none; start Nav2"
        elif math.isnan(self._monitor.watch.now):
            absent = "expected odometry, got none: check the parameters odometry and robot_from"
        values = self._sets.diagnostics()
        values["drives"] = self._summary()
        problems = (absent, self._changed, self._map.problem, self._sets.problem)
        return Health("; ".join(filter(None, problems)), values=values)


def _saving_of(found: Saving) -> SavingMessage:
    low = found.seconds - found.half
    high = found.seconds + found.half
    return SavingMessage(saving=found.seconds, low=low, high=high)


def _today() -> str:
    return time.strftime("%Y-%m-%d")


def _markers(found: list[tuple[ServerGoal, Estimate]]) -> Iterator[Marker]:
    """Yield the remaining time of each drive as text at its goal."""
    yield Marker(action=Marker.DELETEALL)
    for number, (goal, estimate) in enumerate(found):
        marker = Marker(type=Marker.TEXT_VIEW_FACING, id=number, ns="estimates")
        marker.header.frame_id = goal.frame
        if goal.pose is not None:
            marker.pose = pose_of(goal.pose)
        marker.pose.position.z = _TEXT_ABOVE
        marker.scale.z = _TEXT_HEIGHT
        marker.color.r = marker.color.g = marker.color.b = marker.color.a = 1.0
        marker.text = f"{estimate.remaining:.0f} s ± {estimate.spread:.0f} s"
        yield marker


main = partial(run_node, WatchNode, PARAMETERS)
