"""The node `waypoints`: Nav2's FollowWaypoints and NavigateThroughPoses, executed as refined chains."""

from __future__ import annotations

import importlib
import itertools
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome
from ator_interfaces.msg import TopChain as ChainMessage
from ator_ros.geometry import Pose
from ator_ros.nodes.diagnostics import STEADY, WARNING_PERIOD
from ator_ros.nodes.inputs import Subscriptions
from ator_ros.nodes.maps import follow_map
from ator_ros.nodes.messages import chain_of, pose_of, stamp_of
from ator_ros.nodes.parameters import (
    DOMAIN,
    FENCE,
    FRAME,
    MAP,
    ROBOT,
    ROBOT_FRAME,
    STATE,
    Parameter,
    declare_parameters,
    domain_and_robot,
    driving_top,
    fence_of,
)
from ator_ros.nodes.remote_messages import action_type
from ator_ros.nodes.running import run_node, spin_out
from ator_ros.printable import printable, quoted
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.grid_map import GridMap
from ator_ros.world.messages import FrameError, MessageError, expect_frame, plain_frame, pose_from
from ator_ros.world.state import RobotState

_MOST_STEPS = 8  # of a chain: the search of more takes longer than refinement's default deadline
_PERIOD = 0.1  # real s between two checks of awaited conditions
_TF_PATIENCE = 1.0  # real s until the frame of a pose counts as unknown
_SERVER_PATIENCE = 3.0  # real s until the executor counts as missing; DDS may still be connecting it
_LONGEST_REASON = 500
_FREE = frozenset({"yaw"})

# Error codes of Nav2 since Kilted; Jazzy has constants for some of them. 0 means no error.
_UNKNOWN, _NO_WAYPOINTS, _STOPPED = 600, 602, 603  # of FollowWaypoints
_UNKNOWN_OF_ONE, _TF_OF_ONE = 9000, 9002  # of NavigateToPose, for a missed waypoint
_UNKNOWN_OF_ALL, _NO_TREE, _TF_OF_ALL = 9100, 9101, 9102  # of NavigateThroughPoses
_FAILED = 3  # a WaypointStatus; 0 means pending, 1 completed

_CANCELED, _SHUTDOWN = "canceled by the client", "the node waypoints was ended"

ACTIONS = {"FollowWaypoints": "~/follow_waypoints", "NavigateThroughPoses": "~/navigate_through_poses"}
PARAMETERS = (
    FRAME,
    ROBOT_FRAME,
    STATE,
    DOMAIN,
    ROBOT,
    FENCE,
    MAP,
    Parameter(
        "keep_headings",
        [-1],
        "indices of waypoints that keep their heading, below 0 from the end; the end of a tour always does",
        live=True,
    ),
    Parameter("stop_on_failure", True, "whether follow_waypoints ends at the first missed one", live=True),
)


class Tour:
    """A goal of one of the two actions, and its progress.

    A waypoint has an *index* in the list of poses. Its *position* also counts the waypoints of former loops.

    Attributes
    ----------
    loops : bool
        Whether the action is FollowWaypoints.
    poses : list of PoseStamped
        The waypoints as sent.
    goals : dict of int to Pose
        By index: the waypoints that can be driven to, in the node's frame, in m and rad.
    position, end : int
        The position that the robot drives to, and the one after the last.
    """

    def __init__(self, handle: ServerGoalHandle, kind: Any) -> None:
        goal = handle.request
        self.handle, self._kind = handle, kind
        self.loops = hasattr(goal, "number_of_loops")
        self.poses: list[PoseStamped] = list(getattr(goal.poses, "goals", goal.poses))
        self.goals: dict[int, Pose] = {}
        self.position = goal.goal_index if self.loops else 0
        self.end = len(self.poses) * (1 + goal.number_of_loops if self.loops else 1)
        self._missed: list[tuple[int, int, str]] = []
        self._began = math.nan  # s, by odometry's stamps
        self._pace = 0.0  # predicted s per m along straight lines, for the chains after this one
        self._answer = Future()
        self._chain: Any = None

    def index(self, position: int) -> int:
        """Return the index of the waypoint at a position."""
        return position % len(self.poses)

    def upcoming(self) -> list[int]:
        """Return the positions that the next chain drives to; none at the end."""
        ahead = (each for each in range(self.position, self.end) if self.index(each) in self.goals)
        return list(itertools.islice(ahead, _MOST_STEPS))

    def miss(self, index: int, reason: str, *, frame: bool = False) -> tuple[int, str]:
        """Record a missed waypoint; return error code and reason of a goal that ends there."""
        reason = printable(reason, _LONGEST_REASON)
        self._missed.append((index, _TF_OF_ONE if frame else _UNKNOWN_OF_ONE, reason))
        return _STOPPED if self.loops else _TF_OF_ALL if frame else _UNKNOWN_OF_ALL, reason

    # The chain that is executed

    def send(self, chains: ActionClient, chain: ChainMessage, report: Callable[[Any], None]) -> Future:
        """Send the next chain; return the future of its result."""
        self._answer, self._chain = Future(), None
        sent = chains.send_goal_async(ExecuteChain.Goal(chain=chain, refine=True), report)
        sent.add_done_callback(partial(self._accepted, self._answer))
        return self._answer

    def _accepted(self, answer: Future, sent: Future) -> None:
        self._chain = handle = sent.result()
        if not handle.accepted:
            self.give_up(Outcome.REFUSED, "the executor accepts no goal now; see its log")
            return
        handle.get_result_async().add_done_callback(
            lambda ended: answer.done() or answer.set_result(ended.result().result)
        )
        if answer.done() or self.handle.is_cancel_requested:
            self.cancel()

    def cancel(self) -> None:
        """Cancel the chain; without effect if it has ended."""
        if self._chain is not None and self._chain.accepted:
            self._chain.cancel_goal_async()

    def give_up(self, code: int, reason: str) -> None:
        """Cancel the chain if it has not ended, and replace its result by an outcome."""
        if not self._answer.done():
            self.cancel()
            self._answer.set_result(ExecuteChain.Result(outcome=Outcome(code=code, reason=reason)))

    # Feedback and result

    def publish_feedback(
        self, predicted: float, positions: Sequence[int], now: float, pose: Pose, frame_id: str
    ) -> None:
        """Publish the waypoint that the robot drives to, and the time and distance that remain.

        The chain to `positions` needs another `predicted` s, NaN if unknown. `pose` is the robot's in m and
        rad in the frame `frame_id`, `now` its stamp in s.
        """
        if self.loops:
            self.handle.publish_feedback(self._kind.Feedback(current_waypoint=self.index(self.position)))
            return
        self._began = now if math.isnan(self._began) else self._began
        places = [pose, *(self.goals[each] for each in range(self.position, self.end))]
        legs = [start.distance(end) for start, end in itertools.pairwise(places)]
        steps = positions[-1] + 1 - self.position
        chain, later = sum(legs[:steps]), sum(legs[steps:])
        if math.isnan(predicted):
            predicted = self._pace * chain
        elif self.position == positions[0] and chain > 0.0:
            self._pace = predicted / chain
        feedback = self._kind.Feedback(
            navigation_time=Duration(seconds=max(0.0, now - self._began)).to_msg(),
            estimated_time_remaining=Duration(seconds=max(0.0, predicted + self._pace * later)).to_msg(),
            distance_remaining=chain + later,
            number_of_poses_remaining=len(legs),
        )
        feedback.current_pose.header.stamp, feedback.current_pose.header.frame_id = stamp_of(now), frame_id
        feedback.current_pose.pose = pose_of(pose)
        self._write_statuses(feedback)
        self.handle.publish_feedback(feedback)

    def ended(self, code: int, reason: str) -> Any:
        """Put the goal into its final state and return its result; without a reason it has succeeded."""
        result = self._kind.Result(error_code=code, error_msg=reason)
        if self.loops:
            result.missed_waypoints = [self._missed_waypoint(*missed) for missed in self._missed]
        else:
            self._write_statuses(result)
        if self.handle.is_cancel_requested:
            self.handle.canceled()
        elif reason:
            self.handle.abort()
        else:
            self.handle.succeed()
        return result

    def _missed_waypoint(self, index: int, code: int, reason: str) -> Any:
        nav2, pose = importlib.import_module("nav2_msgs.msg"), self.poses[index]
        if hasattr(nav2, "MissedWaypoint"):  # Jazzy
            return nav2.MissedWaypoint(index=index, goal=pose, error_code=code)
        status = nav2.WaypointStatus(waypoint_status=_FAILED, waypoint_index=index, waypoint_pose=pose)
        status.error_code, status.error_msg = code, reason
        return status

    def _write_statuses(self, message: Any) -> None:
        """Write the state of each pose, where messages have it: since Kilted."""
        if not hasattr(message, "waypoint_statuses"):
            return
        status = importlib.import_module("nav2_msgs.msg").WaypointStatus
        failed = {missed[0]: self._missed_waypoint(*missed) for missed in self._missed}
        message.waypoint_statuses = [
            failed.get(index)
            or status(waypoint_status=int(index < self.position), waypoint_index=index, waypoint_pose=pose)
            for index, pose in enumerate(self.poses)
        ]


class WaypointsNode(Node):
    """Drives along waypoints as Nav2 does, with headings that refinement chooses.

    The poses of a goal become chains of the domain's TOP that drives to a pose, of at most 8 steps each.
    All headings are free except those of `keep_headings` and that of the last pose.

    Parameters: see `PARAMETERS`; `keep_headings` and `stop_on_failure` can change while it runs.

    Action servers
        ~/follow_waypoints (nav2_msgs/FollowWaypoints), ~/navigate_through_poses
        (nav2_msgs/NavigateThroughPoses): one goal at a time; a newer one that can be used preempts it. Poses
        are in any frame that tf connects with `frame`. Those that are malformed, in unknown frames or outside
        the fence are missed before the robot moves.
    Subscribes to
        odom (nav_msgs/Odometry), or /tf and /tf_static: for feedback, and poses in other frames.
        the topic of a map (nav_msgs/OccupancyGrid, transient local), if `map` names one.
    Calls
        execute_chain (ator_interfaces/ExecuteChain).
    """

    def __init__(self) -> None:
        super().__init__("waypoints", automatically_declare_parameters_from_overrides=True)
        self._settings = settings = declare_parameters(self, PARAMETERS)
        kinds = [action_type(f"nav2_msgs/action/{name}") for name in ACTIONS]
        self._domain, self._robot = domain, robot = domain_and_robot(settings)
        self._library, self._fence = domain.library(robot), fence_of(settings, robot)
        self._top, self._frame = driving_top(self._library), settings["frame"]
        self._tour: Tour | None = None
        self._waiting: list[Future] = []
        self._here: tuple[float, Pose] | None = None  # stamp in s, and pose of the robot
        self._executors, self._shutting_down = 0, False
        subscribed = Subscriptions(
            self, settings, robot, (),
            take_robot=self._take_robot, take_object=lambda *_: None, warn=self._warn,
        )  # fmt: skip
        self._tf = subscribed.tf
        follow_map(self, settings, self._take_map)
        self._chains = ActionClient(self, ExecuteChain, "execute_chain")
        self._servers = [
            ActionServer(
                self, kind, name, partial(self._execute, kind),
                goal_callback=lambda _: GoalResponse.REJECT if self._shutting_down else GoalResponse.ACCEPT,
                cancel_callback=self._cancel,
            )
            for kind, name in zip(kinds, ACTIONS.values(), strict=True)
        ]  # fmt: skip
        self.create_timer(_PERIOD, self._watch, clock=STEADY)
        self.get_logger().info(
            f"waypoints in {self._frame} become chains of {self._top.name} (domain {domain.name}, ROS domain "
            f"{self.context.get_domain_id()})"
        )

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        self._here = stamp, robot.pose

    def _take_map(self, grid: GridMap) -> None:
        self._robot = self._domain.on_map(grid).equip(self._robot)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text, throttle_duration_sec=WARNING_PERIOD)

    def _watch(self) -> None:
        waiting, self._waiting = self._waiting, []
        for future in waiting:
            future.set_result(None)
        # DDS lists an executor that was killed for up to 20 s: with it, one that was restarted is the second.
        former, self._executors = self._executors, self.count_services("execute_chain/_action/send_goal")
        if self._tour is None:
            return
        if not self._chains.server_is_ready():
            self._tour.give_up(Outcome.INPUT_LOST, "the executor is gone: expected the action execute_chain")
        elif self._executors > max(former, 1):
            self._tour.give_up(Outcome.INPUT_LOST, "the executor was restarted, or another one was started")

    async def _until(self, holds: Callable[[], bool], patience: float) -> bool:
        """Wait until a condition holds, `patience` real s at most; return whether it does."""
        end = time.monotonic() + patience
        while not holds() and time.monotonic() < end:
            self._waiting.append(Future())
            await self._waiting[-1]
        return holds()

    async def _execute(self, kind: Any, handle: ServerGoalHandle) -> Any:
        tour = Tour(handle, kind)
        code, reason = await self._read(tour)
        if handle.is_cancel_requested:
            code, reason = 0, _CANCELED
        if not reason:
            former, self._tour = self._tour, tour
            code, reason = await self._follow(tour)
            self._tour = None if self._tour is tour else self._tour
            if former is not None:
                former.cancel()  # the executor continues its chain if it refused the new one
        self.get_logger().info(f"goal ended: {reason or 'all waypoints done'}")
        return tour.ended(code, reason)

    # Poses to chains

    async def _read(self, tour: Tour) -> tuple[int, str]:
        """Read the poses; return error code and reason if the goal cannot be used, else 0 and ""."""
        request, count = tour.handle.request, len(tour.poses)
        if getattr(request, "behavior_tree", ""):
            return _NO_TREE, f"behavior_tree: expected none, got {quoted(request.behavior_tree)}"
        if tour.position >= count:
            code = _NO_WAYPOINTS if tour.loops else _UNKNOWN_OF_ALL
            return code, f"poses: expected more than {tour.position}, got {count}"
        driven = {tour.index(each) for each in range(tour.position, min(tour.end, tour.position + count))}
        with suppress(MessageError):  # reading the pose reports it
            frames = {plain_frame(tour.poses[index].header.frame_id) for index in driven}
            frames -= {"", plain_frame(self._frame)}
            await self._until(lambda: all(self._tf.base(self._frame, each) for each in frames), _TF_PATIENCE)
        end = 0, ""
        for index in sorted(driven):
            try:
                tour.goals[index] = self._goal(tour.poses[index], f"poses[{index}]")
            except MessageError as error:
                self._warn(str(error))
                end = tour.miss(index, str(error), frame=isinstance(error, FrameError))
        return (0, "") if tour.goals and self._goes_on(tour) else end

    def _goes_on(self, tour: Tour) -> bool:
        """Return whether a goal continues after a missed waypoint."""
        return tour.loops and not self._settings["stop_on_failure"]

    def _goal(self, stamped: PoseStamped, where: str) -> Pose:
        """Read a pose into the node's frame; raises MessageError, also if it lies outside the fence."""
        pose, other = pose_from(stamped.pose, f"{where}.pose"), stamped.header.frame_id
        if (origin := self._tf.base(self._frame, other)) is not None:
            pose = origin.compose(pose)
        else:
            expect_frame(other, f"{where}.header.frame_id", expected=self._frame)
        violation = self._fence.violation(TopChain((self._call(pose),)), self._robot, where)
        if violation is not None:
            raise MessageError(violation)
        return pose

    def _call(self, pose: Pose, *, free: bool = False) -> TopCall:
        return TopCall(self._top, self._library.goal(self._top, pose), _FREE if free else frozenset())

    def _chain(self, tour: Tour, positions: Sequence[int]) -> ChainMessage:
        count, calls = len(tour.poses), []
        kept = {each % count for each in self._settings["keep_headings"] if -count <= each < count}
        for each in positions:
            index = tour.index(each)
            calls.append(self._call(tour.goals[index], free=index not in kept and each < tour.end - 1))
        return chain_of(TopChain(tuple(calls)), action_set="", frame=self._frame)

    # Execution

    async def _follow(self, tour: Tour) -> tuple[int, str]:
        """Execute a goal chain by chain; return error code and reason, or 0 and "" after the last chain."""
        unknown = _UNKNOWN if tour.loops else _UNKNOWN_OF_ALL
        while positions := tour.upcoming():
            if not await self._until(self._chains.server_is_ready, _SERVER_PATIENCE):
                return unknown, "expected the action execute_chain, it is not there"
            if self._shutting_down:  # nothing would cancel the chain
                return unknown, _SHUTDOWN
            if tour is self._tour and not tour.handle.is_cancel_requested:
                report = partial(self._report, tour, positions)
                result = await tour.send(self._chains, self._chain(tour, positions), report)
                if result.outcome.code == Outcome.SUCCEEDED:
                    tour.position = positions[-1] + 1
                    continue
            if tour is not self._tour:
                return unknown, "a newer goal took over"
            if tour.handle.is_cancel_requested:
                return 0, _CANCELED
            outcome, actions = result.outcome, result.record.actions
            if outcome.code == Outcome.REFUSED:
                return unknown, printable(outcome.reason, _LONGEST_REASON)
            reached = [each.step for each in actions if each.outcome.code == Outcome.SUCCEEDED]
            tour.position = positions[min(max(reached, default=-1) + 1, len(positions) - 1)]
            index = tour.index(tour.position)
            end = tour.miss(index, f"poses[{index}]: {outcome.reason}")
            if outcome.code != Outcome.FAILED or not self._goes_on(tour):
                return end
            tour.position += 1
        return 0, ""

    def _report(self, tour: Tour, positions: Sequence[int], message: Any) -> None:
        """Publish feedback when the executor does."""
        if tour is self._tour and tour.handle.is_active and self._here is not None:
            tour.position = positions[min(message.feedback.step, len(positions) - 1)]
            begun = message.feedback.elapsed > 0.0  # until then it predicts the chain as sent
            predicted = message.feedback.predicted_remaining if begun else math.nan
            tour.publish_feedback(predicted, positions, *self._here, self._frame)

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._tour is not None and self._tour.handle is handle:
            self._tour.cancel()
        return CancelResponse.ACCEPT

    def stop(self) -> None:
        """Cancel the chain and end the goal, before the node ends."""
        self._shutting_down = True
        if self._tour is not None:
            self._tour.give_up(Outcome.SHUTDOWN, _SHUTDOWN)
        spin_out(self)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(WaypointsNode, PARAMETERS, args)
