"""The drives of action servers, by what these and the robot publish: live, and in recordings."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import STOP
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import Robot
from ator_ros.experience.records import Vocabulary, fault_in
from ator_ros.experience.run_legs import legs_through, rows_of_poses
from ator_ros.experience.server_goals import (
    FEEDBACK_SUFFIX,
    GOAL_POSE,
    NOT_CONNECTED,
    PLAN,
    STATUS_SUFFIX,
    ServerGoal,
    ServerGoals,
    remote_calls,
    through_servers,
    usual_values,
)
from ator_ros.experience.table import Episode
from ator_ros.experience.track import DIGITS, WIDTH, Segment, Track
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.printable import printable, quoted
from ator_ros.tops.chain import Top
from ator_ros.world.closest_approach import ClosestApproach
from ator_ros.world.readers import (
    MessageError,
    OdometryReader,
    plain_frame,
    pose_from_placement,
    robot_from_placement,
    transform_from,
)
from ator_ros.world.robot_velocity import RobotVelocity
from ator_ros.world.state import RobotState
from ator_ros.world.transforms import Transforms

ODOM = "odom"
TF = ("tf", "tf_static")
"""Roles of topics."""
LONGEST = 3600.0  # s, the longest drive
TOO_LONG = f"expected at most {LONGEST:.0f} s"
ODOMETRY_FRAME = "odom"  # REP-105
ROBOT_FRAME = "base_link"  # REP-105
SILENCE = 1.0  # s without odometry after which a new segment begins
_MOST_FRAMES = 1000  # in tf: far more than a robot has
_LONGEST_NAME = 256  # characters of a frame in tf
_SEGMENT = 100  # numbers that need as much memory as a segment without messages
_NEAR_ROBOT = 1.0  # m: what a robot drives while its path is planned
_KEPT_GOALS = 100  # that have ended: a status message still names those of the last minutes
_KEPT_ROWS = 1000  # of odometry without an active goal: 20 s at 50 Hz


class Watch:
    """Sorts what is published of a robot: its motion in segments, and the goals of its servers.

    A new segment begins after a reset or a long silence. Messages are added in the order of
    arrival; their roles are `ODOM`, `TF`, `PLAN`, `GOAL_POSE`, and the topics in `servers`.

    Parameters
    ----------
    domain : Vocabulary
        Its remote actions are those that are watched, and its TOPs say what their goals are for.
    robot_in_tf : bool
        Whether tf replaces odometry.
    others : collection of str
        Names of further servers; their goals are no drives of a TOP.

    Attributes
    ----------
    segments : list of Segment
        In the order of time; odometry is added to the last one.
    servers : mapping of str to str
        The actions by the topics of status and feedback of their servers; one of `others`, or of a
        server that drives through poses, has the name of the server.
    transforms : Transforms
        The frames in tf.
    numbers : int
        How many numbers are kept in memory.
    """

    def __init__(
        self,
        robot: Robot,
        domain: Vocabulary,
        *,
        robot_in_tf: bool = False,
        others: Collection[str] = (),
    ) -> None:
        self._robot = robot
        self._domain = domain
        self._robot_in_tf = robot_in_tf
        self._odometry = OdometryReader(
            ODOMETRY_FRAME if robot_in_tf else "", corrects=False, sideways=robot.moves_sideways
        )
        self._velocity = RobotVelocity(
            robot.greatest_speed(), robot.greatest_turn_rate, sideways=robot.moves_sideways
        )
        self.segments = [Segment()]
        actions = {call.server: name for name, call in remote_calls(domain).items()}
        self._through = through_servers(domain)
        actions |= {name: name for name in (*others, *self._through)}
        self.servers = {
            f"{server}{suffix}": action
            for server, action in actions.items()
            for suffix in (STATUS_SUFFIX, FEEDBACK_SUFFIX)
        }
        self.transforms = Transforms()
        self._goals = ServerGoals(self.odom_pose_in)
        self._is_older = False
        self._parents: dict[str, str] = {}
        """By frame in tf, its parent."""
        self._numbers = 0
        self._ended: list[ServerGoal] = []
        self._passing: list[ServerGoal] = []  # that are passed, until the robot leaves them

    @property
    def numbers(self) -> int:
        """How many numbers are kept in memory."""
        return self._numbers + self._goals.numbers

    @property
    def goals(self) -> list[ServerGoal]:
        """All goals, in the order of arrival."""
        return list(self._goals.goals.values())

    @property
    def active(self) -> list[ServerGoal]:
        """The goals that are executed, the oldest first."""
        return self._goals.active

    @property
    def frame(self) -> str:
        """The frame of odometry; empty before its first message."""
        return self._odometry.frame

    @property
    def now(self) -> float:
        """The stamp of the newest odometry in s; NaN before the first."""
        odom = self.segments[-1].odom
        return odom.last[0] if odom else math.nan

    @property
    def has_frames(self) -> bool:
        """Whether there are transforms."""
        return bool(self._parents)

    def robot_in(self, frame: str) -> RobotState | None:
        """Return the newest state of the robot in a frame; None if it is unknown."""
        odom = self.segments[-1].odom
        odom_pose = self.odom_pose_in(frame)
        if not odom or odom_pose is None:
            return None
        _, x, y, yaw, vx, w, vy = odom.last
        return RobotState(odom_pose.compose(Pose(x, y, yaw)), vx, w, vy=vy)

    def add(self, role: str, message: Any) -> None:
        """Add a message; raise MessageError if it cannot be used."""
        if role == ODOM:
            self._add_state(*self._odometry.read(message))
        elif role in TF:
            self._add_transforms(message, fixed=role == "tf_static")
        elif role == GOAL_POSE or (role == PLAN and self._is_of_drive(message)):
            self._goals.add_pose(message, self.now)
        elif role == PLAN:
            pass  # another client has asked the planner
        elif role.endswith(FEEDBACK_SUFFIX):
            self._goals.add_feedback(self.servers[role], message, self.now)
        else:
            newest = self.segments[-1]
            robot = self.robot_in(self.frame)
            ended = self._goals.add_status(self.servers[role], message, newest, self.now, robot)
            for goal in ended:
                goal.is_passed = self._passes(goal)
                (self._passing if goal.is_passed else self._ended).append(goal)
            self._observe_passing()

    def lose(self, action: str) -> None:
        """End the active goals of an action whose server is gone."""
        self._ended += self._goals.lose(action)

    def _is_of_drive(self, message: Any) -> bool:
        """Return whether a path begins at the robot, as far as that is known.

        Planners publish all paths that they are asked for.
        """
        robot = self.robot_in(plain_frame(message.header.frame_id))
        if robot is None or not message.poses:
            return True
        place = message.poses[0].pose.position
        return math.dist(robot.pose[:2], (place.x, place.y)) <= _NEAR_ROBOT

    def _top(self, goal: ServerGoal) -> Top | None:
        return next((top for top in self._domain.tops if top.action == goal.action), None)

    def _passes(self, goal: ServerGoal) -> bool:
        """Return whether another goal took over where the robot passes this one."""
        top = self._top(goal)
        can_pass = STOP in usual_values(self._domain, goal.action)
        if not can_pass or not goal.is_preempted or top is None:
            return False
        if goal.pose is None or goal.final_pose is None:
            return False
        return goal.final_pose.distance(goal.pose) <= top.place_tolerance

    def _observe_passing(self) -> None:
        """Observe how near the robot passes goals; those that it leaves have ended."""
        for goal in self._passing[:]:
            robot = self.robot_in(goal.frame)
            is_left = goal.segment is not self.segments[-1]
            if robot is not None and goal.pose is not None:
                approach = ClosestApproach(goal.nearest)
                is_left |= approach.leaves(robot.pose.distance(goal.pose))
                goal.nearest = approach.distance
            if is_left:
                self._passing.remove(goal)
                self._ended.append(goal)

    def take_ended(self) -> list[ServerGoal]:
        """Return the goals that have ended since the last call, and that the robot has left."""
        ended = self._ended
        self._ended = []
        return ended

    def forget(self) -> None:
        """Forget odometry and goals that no drive needs any more; those of `take_ended` are kept.

        A goal that is executed for longer than `LONGEST` is no drive.
        """
        newest = self.segments[-1]
        ending = (*self._passing, *self._ended)
        goals = (*self.active, *ending)
        running = (goal for goal in goals if self.now - goal.begin <= LONGEST)
        used = {id(goal.segment) for goal in running}
        if id(newest) not in used and len(newest.odom) > _KEPT_ROWS:
            newest = Segment()
            newest.odom.append(*self.segments[-1].odom.last)
        self.segments = [each for each in self.segments[:-1] if id(each) in used] + [newest]
        self._goals.forget(_KEPT_GOALS, ending)

    def legs(self, goal: ServerGoal, *, track: Track | None = None) -> list[ServerGoal] | str:
        """Return the legs of a goal that has ended, each as a goal, or why there are none.

        A goal of a server that drives through poses has a leg to each of them, another one only
        itself. `track` is that of the goal's segment, by default made of it now.
        """
        if goal.action not in self._through:
            return [goal]
        if reason := self.rejection(goal):
            return reason
        action, _ = self._through[goal.action]
        top = next((top for top in self._domain.tops if top.action == action), None)
        path = goal.first_path
        headings = goal.first_headings
        if top is None or goal.segment is None or goal.odom_pose is None:
            return "no TOP calls the action"
        rows = [] if path is None or headings is None else rows_of_poses(path, headings, goal.poses)
        if path is None or headings is None or not rows:
            return "its poses are unknown: its path does not show where they are"
        track = (track or Track(goal.segment)).seen_from(goal.odom_pose)
        during = track.between(goal.begin, goal.end)
        states = track.states(during[:, 0])
        legs = []
        for number, leg in enumerate(
            legs_through(states, path, headings, rows, top.place_tolerance)
        ):
            final = track.world(leg.end).robot.pose
            legs.append(
                replace(
                    goal,
                    action=action,
                    goal_id=goal.goal_id + bytes([number % 256]),
                    begin=leg.begin,
                    end=leg.end,
                    status=goal.status if leg.is_last or leg.is_passed else "aborted",
                    pose=goal.pose if leg.is_last else leg.pose,
                    final_pose=goal.final_pose if leg.is_last else final,
                    is_passed=leg.is_passed,
                    nearest=leg.nearest,
                    first_path=leg.path,
                    server_estimates=[],
                )
            )
        return legs

    def rejection(self, goal: ServerGoal) -> str:
        """Return why a goal is no episode; empty if it may be one."""
        reason = goal.rejection()
        if reason == NOT_CONNECTED:
            frames = ", ".join(printable(name) for name in self.transforms.frames[:8])
            odometry = printable(self.frame)
            return (
                f"tf: expected transforms from {printable(goal.frame)} to {odometry}, "
                f"got the frames {frames or 'none'}"
            )
        return reason

    def episode(self, goal: ServerGoal, *, track: Track | None = None) -> Episode | str:
        """Return the episode of a goal that has ended, in the goal's frame, or why it is none.

        `track` is that of the goal's segment, by default made of it now.
        """
        if reason := self.rejection(goal):
            return reason
        segment = goal.segment
        robot = self._robot
        if segment is None or (
            segment is not self.segments[-1] and goal.end == segment.odom.last[0]
        ):
            return "odometry was interrupted"
        if goal.end - goal.begin > LONGEST:
            return TOO_LONG
        top = self._top(goal)
        if top is None or goal.pose is None or goal.odom_pose is None:
            return "no TOP calls the action"
        track = (track or Track(segment)).seen_from(goal.odom_pose)
        errors = (math.nan, math.nan)
        nearer = math.nan
        if goal.final_pose is not None and goal.is_passed:
            if math.isfinite(goal.nearest):
                errors = goal.nearest, math.nan
                nearer = max(0.0, goal.final_pose.distance(goal.pose) - goal.nearest)
        elif goal.final_pose is not None:
            reached = (
                robot.hold_point(goal.final_pose) if top.point is Point.HOLD else goal.final_pose
            )
            errors = reached.distance(goal.pose), abs(wrap_angle(reached.yaw - goal.pose.yaw))
        if jump := track.jump(robot, goal.begin, goal.end):
            return jump
        start = track.world(goal.begin)
        values = usual_values(self._domain, goal.action)
        if goal.is_passed:
            values[STOP] = 0.0
        situation = Situation(
            goal.action, start.robot, start.objects, Goal(goal.pose, 0.0, top.point, values)
        )
        episode = Episode(
            situation,
            round(goal.end - goal.begin, DIGITS),
            goal.is_passed or goal.status == "succeeded",
            f"recorded: its server reported {goal.status}",
            *errors,
            samples=track.samples(goal.begin, goal.end, start.objects),
            nearer=nearer,
        )
        too_far = fault_in(episode, top, robot)
        return "the goal is farther than the robot drives in its duration" if too_far else episode

    def _add_state(self, time: float, robot: RobotState) -> None:
        odom = self.segments[-1].odom
        last = odom.last[0] if odom else time
        if time < last and not self._is_older:
            self._is_older = True  # one late message is ignored, two in a row are a reset
            return
        self._is_older = False
        if odom and not 0.0 <= time - last <= SILENCE:
            self.segments.append(Segment())
            self._numbers += _SEGMENT
        self.segments[-1].odom.append(time, *robot.pose, robot.vx, robot.w, robot.vy)
        self._numbers += WIDTH
        self._observe_passing()

    def _add_transforms(self, message: Any, *, fixed: bool) -> None:
        for transform in message.transforms:
            parent, child, time, placement = transform_from(transform)
            self._check_frames(parent, child)
            self.transforms.add(parent, child, time, placement, fixed=fixed)
        if self._robot_in_tf and (found := self.transforms.latest(self.frame, self.robot_frame())):
            self._add_state(*robot_from_placement(self._velocity, *found))

    def _check_frames(self, parent: str, child: str) -> None:
        """Note the parent of a frame in tf; raise MessageError for too many or long names."""
        if len(parent) > _LONGEST_NAME or len(child) > _LONGEST_NAME:
            raise MessageError(
                f"tf: expected names of at most {_LONGEST_NAME} characters, got {quoted(child)}"
            )
        if child not in self._parents and len(self._parents) >= _MOST_FRAMES:
            raise MessageError(f"tf: expected at most {_MOST_FRAMES} frames, got more")
        self._parents[child] = parent

    def robot_frame(self) -> str:
        """Return the robot's frame in tf: base_link, else the only child of odometry's frame."""
        if ROBOT_FRAME in self._parents:
            return ROBOT_FRAME
        children = [child for child, parent in self._parents.items() if parent == self.frame]
        return children[0] if len(children) == 1 else ROBOT_FRAME

    def odom_pose_in(self, frame: str) -> Pose | None:
        """Return the pose of odometry's frame in another frame, by the newest transforms."""
        if frame in ("", self.frame):
            return Pose(0.0, 0.0, 0.0)
        found = self.transforms.latest(frame, self.frame)
        return None if found is None else pose_from_placement(found[1], f"{self.frame} in tf")
