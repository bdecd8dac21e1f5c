"""The node `waypoints`: Nav2's FollowWaypoints and NavigateThroughPoses as refined chains."""

from __future__ import annotations

import importlib
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache, partial
from typing import Any

from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome
from ator_interfaces.msg import TopChain as ChainMessage
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose
from ator_ros.nodes.chain_client import NO_EXECUTOR, ChainClient, SentChain
from ator_ros.nodes.diagnostics import Warnings
from ator_ros.nodes.main_loop import pause, run_node, spin_out
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.messages import chain_of, pose_of, stamp_of
from ator_ros.nodes.parameters import (
    FENCE,
    FRAMES,
    STATE,
    WORLD,
    Parameter,
    declare_parameters,
    domain_and_robot,
    driving_top,
    fence_of,
)
from ator_ros.nodes.qos import ACTION_QUEUES
from ator_ros.nodes.remote_messages import action_type
from ator_ros.nodes.subscriptions import Subscriptions
from ator_ros.nodes.waiting import Waiting
from ator_ros.printable import one_line, quoted
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.readers import (
    FrameError,
    MessageError,
    expect_frame,
    goal_pose_from,
    plain_frame,
)
from ator_ros.world.state import RobotState

_INPUT_TIMEOUT = 1.0  # real s until a map counts as missing, and the frame of a pose as unknown
_SERVER_TIMEOUT = 3.0  # real s until the executor counts as missing; DDS may still be connecting it
_MOST_WAYPOINTS = 2000  # a goal; three hours of drives of 5 s
_BLOCK = 50  # poses that are read at once: 5 ms, after which other messages are processed
GIVEN = "given"
OPEN = "open"
NEVER = "never"
THROUGH_POSES = "through_poses"
ALWAYS = "always"

# Nav2's error codes; Jazzy lacks constants for some of them. 0 means no error.
_FW_UNKNOWN, _FW_NO_VALID_WAYPOINTS, _FW_STOP_ON_MISSED_WAYPOINT = 600, 602, 603  # FollowWaypoints
_POSE_UNKNOWN, _POSE_TF_ERROR = 9000, 9002  # NavigateToPose, for a missed waypoint
# NavigateThroughPoses
_POSES_UNKNOWN = 9100
_POSES_FAILED_TO_LOAD_BEHAVIOR_TREE = 9101
_POSES_TF_ERROR = 9102

_PREEMPTED = "a newer goal took over"
_SHUTDOWN = "the node waypoints was ended"

ACTIONS = {
    "FollowWaypoints": "~/follow_waypoints",
    "NavigateThroughPoses": "~/navigate_through_poses",
}
PARAMETERS = (
    *FRAMES,
    *WORLD,
    STATE,
    FENCE,
    Parameter(
        "keep_headings",
        [-1],
        "indices of waypoints that keep their heading, below 0 from the end; "
        "the end of a tour always does",
        live=True,
    ),
    Parameter(
        "order",
        GIVEN,
        "open: refinement chooses the order of the waypoints, again in each round",
        choices=(GIVEN, OPEN),
        live=True,
    ),
    Parameter(
        "keep_last",
        True,
        "whether the last waypoint of a tour keeps its place if the order is open",
        live=True,
    ),
    Parameter(
        "passing",
        THROUGH_POSES,
        "which goals leave open whether the robot stops at their waypoints, if its action can pass",
        choices=(NEVER, THROUGH_POSES, ALWAYS),
        live=True,
    ),
    Parameter("return_home", False, "whether a tour ends at the pose in which it began", live=True),
    Parameter(
        "stop_on_failure", True, "whether follow_waypoints ends at the first missed one", live=True
    ),
)


class WaypointGoal:
    """A goal of FollowWaypoints (`is_follow_waypoints`) or NavigateThroughPoses, and its progress.

    A *leg* is the drive to one waypoint. The legs of all loops are numbered consecutively, as sent:
    `leg` is the current one, `first` the first one that is not done, `end` the one after the last,
    which leads to `home` if the robot shall return to where it began. `poses` are the waypoints as
    sent, `targets` by index those that can be driven to, in the node's frame. `pace` is the time in
    s per m along straight lines that is expected before the first prediction. A newer goal has a
    greater `number`.
    """

    def __init__(self, handle: ServerGoalHandle, kind: Any, *, pace: float, number: int) -> None:
        request = handle.request
        self.handle = handle
        self.number = number
        self._kind = kind
        self.is_follow_waypoints = loops = hasattr(request, "number_of_loops")
        self.poses: list[PoseStamped] = list(request.poses)
        self.targets: dict[int, Pose] = {}
        self.leg = self.first = request.goal_index if loops else 0
        self._done: set[int] = set()  # legs after the first one
        self.home: Pose | None = None
        self.end = len(self.poses) * (1 + request.number_of_loops if loops else 1)
        self._missed: dict[int, int] = {}  # error codes by index of the waypoint
        self._start_time = math.nan  # s, by odometry's stamps
        self._pace = pace  # predicted s per m along straight lines, for the chains after this one
        self._lengths: list[float] = []  # m along straight lines from the first pose to each
        self.chain = SentChain()
        """The current chain of the goal; before the first one, a chain that was never sent."""

    def waypoint_index(self, leg: int) -> int:
        """Return the index of the waypoint at the end of a leg."""
        return leg % len(self.poses)

    @property
    def unknown_error(self) -> int:
        """The error code for reasons without one of their own."""
        return _FW_UNKNOWN if self.is_follow_waypoints else _POSES_UNKNOWN

    def target(self, leg: int) -> Pose:
        """Return the pose at the end of a leg."""
        if leg == self.end and self.home is not None:
            return self.home
        return self.targets[self.waypoint_index(leg)]

    def next_legs(self, *, one_round: bool) -> list[int]:
        """Return the legs of the next chain; none at the end.

        With `one_round` a chain ends where the next round begins.
        """
        self._skip_done()
        count = len(self.poses)
        end = min(self.end, count * (self.first // count + 1)) if one_round else self.end
        left = (leg for leg in range(self.first, end) if not self._is_done(leg))
        legs = list(itertools.islice(left, LONGEST_CHAIN))
        if end == self.end and self.home is not None and self.end not in self._done:
            legs.append(self.end)
        return legs[:LONGEST_CHAIN]

    def finish_legs(self, legs: Iterable[int]) -> None:
        """Record legs that are not driven again."""
        self._done.update(legs)

    def _is_done(self, leg: int) -> bool:
        """Return whether a leg to a waypoint is not driven any more, or cannot be driven."""
        return leg in self._done or self.waypoint_index(leg) not in self.targets

    def _skip_done(self) -> None:
        """Let the first leg be one that can be driven, if there is any."""
        while self.first < self.end and self._is_done(self.first):
            self._done.discard(self.first)
            self.first += 1

    def miss(self, index: int, reason: str, *, frame: bool = False) -> tuple[int, str]:
        """Record a missed waypoint; return error code and reason of a goal that ends there.

        `frame` is true where tf does not connect the waypoint's frame.
        """
        reason = one_line(reason)
        self._missed[index] = _POSE_TF_ERROR if frame else _POSE_UNKNOWN
        if self.is_follow_waypoints:
            return _FW_STOP_ON_MISSED_WAYPOINT, reason
        return _POSES_TF_ERROR if frame else _POSES_UNKNOWN, reason

    def publish_feedback(
        self, legs: Sequence[int], executed: Any, now: float, pose: Pose, frame_id: str
    ) -> None:
        """Publish the current waypoint, and the time and distance that remain.

        `executed` is the feedback of the chain of `legs`, `pose` the robot's in `frame_id`, `now`
        its stamp.
        """
        order = [legs[index] for index in executed.order if index < len(legs)] or list(legs)
        self.leg = legs[min(executed.step, len(legs) - 1)]
        if self.is_follow_waypoints:
            last = min(self.leg, self.end - 1)  # also on the way home
            self.handle.publish_feedback(
                self._kind.Feedback(current_waypoint=self.waypoint_index(last))
            )
            return
        self._start_time = now if math.isnan(self._start_time) else self._start_time
        if not self._lengths:
            places = [self.targets[leg] for leg in range(self.end)]
            steps = (start.distance(end) for start, end in itertools.pairwise(places))
            self._lengths = list(itertools.accumulate(steps, initial=0.0))
        left = order[order.index(self.leg) :]
        stops = [pose, *map(self.target, left)]
        chain = sum(start.distance(end) for start, end in itertools.pairwise(stops))
        last = min(max(legs), self.end - 1)
        later = self._lengths[-1] - self._lengths[last]
        predicted = executed.predicted_remaining
        # at first it is that of the chain as sent
        if executed.elapsed == 0.0 or math.isnan(predicted):
            predicted = self._pace * chain
        elif self.leg == order[0] and chain > 0.0:
            self._pace = predicted / chain
        feedback = self._kind.Feedback(
            navigation_time=Duration(seconds=max(0.0, now - self._start_time)).to_msg(),
            estimated_time_remaining=Duration(
                seconds=max(0.0, predicted + self._pace * later)
            ).to_msg(),
            distance_remaining=chain + later,
            number_of_poses_remaining=self.end - 1 - last + sum(leg < self.end for leg in left),
        )
        feedback.current_pose.header.stamp = stamp_of(now)
        feedback.current_pose.header.frame_id = frame_id
        feedback.current_pose.pose = pose_of(pose)
        self.handle.publish_feedback(feedback)

    def summary(self) -> str:
        """Return how many waypoints were missed, in words."""
        return f"missed waypoints: {len(self._missed)}"

    def finish(self, code: int, reason: str) -> Any:
        """Put the goal into its final state and return its result.

        Without a reason it has succeeded.
        """
        result = self._kind.Result(error_code=code, error_msg=reason)
        if self.is_follow_waypoints:
            missed = importlib.import_module("nav2_msgs.msg").MissedWaypoint
            result.missed_waypoints = [
                missed(index=index, goal=self.poses[index], error_code=error)
                for index, error in self._missed.items()
            ]
        if self.handle.is_cancel_requested:
            self.handle.canceled()
        elif reason:
            self.handle.abort()
        else:
            self.handle.succeed()
        return result


class WaypointsNode(Node):
    """Drives along waypoints as Nav2 does, with headings that refinement chooses.

    The poses of a goal become one chain of the domain's TOP that drives to a pose, or several if
    they are very many. All headings are free except those of `keep_headings` and that of the last
    pose. With the parameter `order` their order is free, too, and with `passing` whether the robot
    stops there. Feedback and results count waypoints as they were sent.

    Action servers
        ~/follow_waypoints (nav2_msgs/FollowWaypoints), ~/navigate_through_poses
        (nav2_msgs/NavigateThroughPoses): one goal at a time; a newer valid one preempts it. Poses
        are in any frame that tf connects with `frame`. Malformed ones, and those in unknown frames
        or outside the fence, are missed before the robot moves.
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
        domain, self._robot = domain_and_robot(settings)
        self._library = domain.library(self._robot)
        self._fence = fence_of(settings, self._robot)
        self._top = driving_top(self._library)
        self._frame = settings["frame"]
        self._active: WaypointGoal | None = None
        self._numbers = itertools.count(1)
        self._arrived: dict[bytes, WaypointGoal] = {}  # by goal id, until they are executed
        self._newest_executed = 0  # number of a goal
        self._wait_for = Waiting(self).until
        self._robot_pose: tuple[float, Pose] | None = None  # with its stamp in s
        self._shutting_down = False
        self._warn = Warnings(self)
        subscribed = Subscriptions(
            self, settings, self._robot, (),
            take_robot=self._take_robot, take_object=lambda *_: None, warn=self._warn,
        )  # fmt: skip
        self._tf = subscribed.tf
        self._map = FollowedMap(self, settings, domain, self._robot, self._take_map)
        self._chains = ChainClient(self)
        self._servers = [
            ActionServer(
                self, kind, name, self._execute,
                goal_callback=self._response,
                handle_accepted_callback=partial(self._take_goal, kind),
                cancel_callback=self._cancel, **ACTION_QUEUES,
            )
            for kind, name in zip(kinds, ACTIONS.values(), strict=True)
        ]  # fmt: skip
        self.get_logger().info(
            f"waypoints in {self._frame} become chains of {self._top.name} (domain {domain.name}, "
            f"ROS domain {self.context.get_domain_id()})"
        )

    def _response(self, _: Any) -> GoalResponse:
        return GoalResponse.REJECT if self._shutting_down else GoalResponse.ACCEPT

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        self._robot_pose = stamp, robot.pose

    def _take_map(self, _: Domain, robot: Robot) -> None:
        self._robot = robot

    def _take_goal(self, kind: Any, handle: ServerGoalHandle) -> None:
        """Start to execute an accepted goal; the order of these calls decides which is newer."""
        self._arrived[bytes(handle.goal_id.uuid)] = WaypointGoal(
            handle, kind, pace=1.0 / self._robot.greatest_speed(), number=next(self._numbers)
        )
        handle.execute()

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        goal = self._arrived.pop(bytes(handle.goal_id.uuid))
        code, reason = await self._read(goal)
        if not reason and goal.number < self._newest_executed:
            code = goal.unknown_error
            reason = _PREEMPTED
        if not reason and not handle.is_cancel_requested:
            self._newest_executed = goal.number
            previous = self._active
            self._active = goal
            code, reason = await self._execute_chains(goal)
            if self._active is goal:
                self._active = None
            if previous is not None:
                # the executor continues its chain if it refused the new one
                previous.chain.cancel()
        if handle.is_cancel_requested:
            code = 0
            reason = "canceled by the client"
        self.get_logger().info(one_line(f"goal ended: {reason or goal.summary()}"))
        return goal.finish(code, reason)

    async def _read(self, goal: WaypointGoal) -> tuple[int, str]:
        """Read the poses.

        Return error code and reason if the goal cannot be used, else 0 and "".
        """
        request = goal.handle.request
        count = len(goal.poses)
        if getattr(request, "behavior_tree", ""):
            reason = f"behavior_tree: expected none, got {quoted(request.behavior_tree)}"
            return _POSES_FAILED_TO_LOAD_BEHAVIOR_TREE, reason
        if goal.leg >= count:
            code = _FW_NO_VALID_WAYPOINTS if goal.is_follow_waypoints else _POSES_UNKNOWN
            if not count:
                return code, "poses: expected at least 1 pose"
            return code, f"goal_index: expected less than {count}, got {goal.leg}"
        if count > _MOST_WAYPOINTS:
            reason = (
                f"poses: expected at most {_MOST_WAYPOINTS} poses, got {count}; send several goals"
            )
            return goal.unknown_error, reason
        if not await self._wait_for(lambda: not self._map.is_missing, _INPUT_TIMEOUT):
            return goal.unknown_error, one_line(self._map.problem)
        used = {
            goal.waypoint_index(leg) for leg in range(goal.leg, min(goal.end, goal.leg + count))
        }
        with suppress(MessageError):  # reading the pose reports it
            frames = {plain_frame(goal.poses[index].header.frame_id) for index in used}
            frames -= {"", plain_frame(self._frame)}
            await self._wait_for(
                lambda: all(self._tf.base(self._frame, each) for each in frames), _INPUT_TIMEOUT
            )
        origin_in = cache(partial(self._tf.base, self._frame))
        if self._settings["return_home"]:
            if not await self._wait_for(lambda: self._robot_pose is not None, _INPUT_TIMEOUT):
                return goal.unknown_error, "return_home: expected the robot's pose, got none"
            goal.home = None if self._robot_pose is None else self._robot_pose[1]
        keep_heading = self._kept_headings(goal)
        if self._is_kept(goal, goal.end - 1):
            keep_heading = keep_heading | {goal.waypoint_index(goal.end - 1)}
        previous = Pose(0.0, 0.0, 0.0) if self._robot_pose is None else self._robot_pose[1]
        end = 0, ""
        for number, index in enumerate(sorted(used), start=1):
            if number % _BLOCK == 0:
                await pause(self)
                if goal.handle.is_cancel_requested:
                    return goal.unknown_error, "canceled"
            source = None if index in keep_heading else previous
            try:
                previous = self._target(goal.poses[index], f"poses[{index}]", source, origin_in)
                goal.targets[index] = previous
            except MessageError as error:
                self._warn(str(error))
                end = goal.miss(index, str(error), frame=isinstance(error, FrameError))
        continues = (
            goal.targets and goal.is_follow_waypoints and not self._settings["stop_on_failure"]
        )
        return (0, "") if continues else end

    def _target(
        self,
        stamped: PoseStamped,
        where: str,
        previous: Pose | None,
        origin_in: Callable[[str], Pose | None],
    ) -> Pose:
        """Read a pose into the node's frame.

        `origin_in` returns the pose of another frame in it. If its heading does not count,
        `previous` is the pose before it: a heading that cannot be read becomes the direction from
        there. Raises MessageError, also if it lies outside the fence.
        """
        other = stamped.header.frame_id
        start = None
        try:
            pose = goal_pose_from(stamped.pose, f"{where}.pose")
        except MessageError:
            if previous is None:
                raise
            pose = goal_pose_from(PoseMessage(position=stamped.pose.position), where)
            start = previous
        if (origin := origin_in(other)) is not None:
            pose = origin.compose(pose)
        else:
            expect_frame(other, f"{where}.header.frame_id", expected=self._frame)
        if start is not None:
            pose = pose._replace(yaw=math.atan2(pose.y - start.y, pose.x - start.x))
        call = TopCall(self._top, self._library.goal(self._top, pose))
        violation = self._fence.violation(TopChain((call,)), self._robot, where)
        if violation is not None:
            raise MessageError(violation)
        return pose

    def _kept_headings(self, goal: WaypointGoal) -> set[int]:
        """Return the indices of the waypoints that keep their heading in each round."""
        count = len(goal.poses)
        return {
            index % count for index in self._settings["keep_headings"] if -count <= index < count
        }

    @property
    def _is_open(self) -> bool:
        """Whether the order of the waypoints is open."""
        return bool(self._settings["order"] == OPEN)

    def _is_kept(self, goal: WaypointGoal, leg: int) -> bool:
        """Return whether a leg ends the tour, and so keeps its place and its heading."""
        if leg == goal.end:
            return True
        is_last = leg == goal.end - 1 and goal.home is None
        return is_last and (self._settings["keep_last"] or not self._is_open)

    def _may_pass(self, goal: WaypointGoal) -> bool:
        """Return whether refinement may decide that the robot passes waypoints of a goal."""
        passing = self._settings["passing"]
        return passing == ALWAYS or (passing == THROUGH_POSES and not goal.is_follow_waypoints)

    def _chain(self, goal: WaypointGoal, legs: Sequence[int]) -> ChainMessage:
        calls = []
        kept = self._kept_headings(goal)
        ends_fixed = not self._is_open or self._is_kept(goal, legs[-1])
        for leg in legs:
            is_kept = self._is_kept(goal, leg)
            is_last = leg == goal.end - 1 and self._settings["keep_last"]
            call = self._library.station(
                self._top,
                goal.target(leg),
                keeps_place=is_kept or is_last or not self._is_open,
                keeps_heading=is_kept or goal.waypoint_index(leg) in kept,
                may_pass=self._may_pass(goal),
                passes=leg != legs[-1] and not goal.is_follow_waypoints,
                may_be_last=leg == legs[-1] or not ends_fixed,
            )
            calls.append(call)
        return chain_of(TopChain(tuple(calls)), action_set="", frame=self._frame)

    async def _execute_chains(self, goal: WaypointGoal) -> tuple[int, str]:
        """Execute a goal chain by chain.

        Return error code and reason, or 0 and "" after the last chain.
        """
        unknown = goal.unknown_error
        while legs := goal.next_legs(one_round=self._is_open):
            if not await self._wait_for(self._chains.is_ready, _SERVER_TIMEOUT):
                return unknown, NO_EXECUTOR
            if reason := self._interruption(goal):
                return unknown, reason
            chain = ExecuteChain.Goal(chain=self._chain(goal, legs), refine=True)
            goal.chain = self._chains.send(chain, partial(self._report, goal, legs))
            result = await goal.chain.result
            outcome = result.outcome
            if outcome.code == Outcome.SUCCEEDED:
                goal.finish_legs(legs)
                continue
            if reason := self._interruption(goal):
                return unknown, reason
            if outcome.code == Outcome.REFUSED:
                return unknown, one_line(outcome.reason)
            reached = {
                legs[each.step]
                for each in result.record.actions
                if each.outcome.code == Outcome.SUCCEEDED
            }
            order = [legs[index] for index in result.record.order] or legs
            goal.leg = next((leg for leg in order if leg not in reached), order[-1])
            if goal.leg == goal.end:
                return unknown, one_line(f"return_home: {outcome.reason}")
            index = goal.waypoint_index(goal.leg)
            end = goal.miss(index, f"poses[{index}]: {outcome.reason}")
            continues = goal.is_follow_waypoints and not self._settings["stop_on_failure"]
            if outcome.code != Outcome.FAILED or not continues:
                return end
            goal.finish_legs({*reached, goal.leg})
        return 0, ""

    def _interruption(self, goal: WaypointGoal) -> str:
        """Return why a goal ends though no waypoint was missed; empty if it continues."""
        if self._shutting_down:
            return _SHUTDOWN
        if goal is not self._active:
            return _PREEMPTED
        return "canceled" if goal.handle.is_cancel_requested else ""

    def _report(self, goal: WaypointGoal, legs: Sequence[int], executed: Any) -> None:
        if goal is self._active and goal.handle.is_active and self._robot_pose is not None:
            goal.publish_feedback(legs, executed, *self._robot_pose, self._frame)

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._active is not None and self._active.handle is handle:
            self._active.chain.cancel()
        return CancelResponse.ACCEPT

    def stop(self) -> None:
        """Cancel the chain and end the goal, before the node ends."""
        self._shutting_down = True
        if self._active is not None:
            self._active.chain.abandon(Outcome.SHUTDOWN, _SHUTDOWN)
        spin_out(self)


main = partial(run_node, WaypointsNode, PARAMETERS)
