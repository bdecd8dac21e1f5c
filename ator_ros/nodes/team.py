"""The node `team`: one on each robot of a team; together they decide who takes which role."""

from __future__ import annotations

import dataclasses
import math
import time
from functools import partial
from pathlib import Path

from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome, Roles, Teammate
from ator_interfaces.msg import Role as RoleMessage
from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.execution.predictions import warm_up_refinement
from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.nodes.chain_client import ChainClient, SentChain
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health, Warnings
from ator_ros.nodes.main_loop import run_node, spin_out
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.messages import chain_of, into_frame, situation_of, stamp_of
from ator_ros.nodes.models import LEARNED, LearnedSets, ModelSet
from ator_ros.nodes.parameters import (
    FRAMES,
    MODELS,
    STATE,
    WORLD,
    Parameter,
    SetupError,
    declare_parameters,
    domain_and_robot,
    live,
)
from ator_ros.nodes.qos import LATCHED, LATCHED_BY_MANY
from ator_ros.nodes.subscriptions import Subscriptions
from ator_ros.printable import one_line, quoted
from ator_ros.refinement.refiner import Refiner
from ator_ros.team.role_file import RoleFile, load_roles
from ator_ros.team.roles import (
    SAME_FRAME,
    Bid,
    Course,
    Decision,
    Member,
    Plan,
    as_observed,
    bids_of,
    common_objects,
    course_in,
    plan_roles,
)
from ator_ros.team.roster import PERIOD, Roster
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.inputs import ClockJumpError, Inputs
from ator_ros.world.readers import (
    MessageError,
    name,
    names,
    number,
    plain_frame,
    position,
    world_from,
)
from ator_ros.world.sightings import ObjectTracker, Sightings
from ator_ros.world.state import ObjectState, RobotState, World

TEAMMATES = "/teammates"
"""The topic of all robots of a team; remap it to have several teams."""
_MOST_ROBOTS = 16  # as many pairs with roles as `Roles.msg` has
_OBJECT_TIMEOUT = 1.0  # s for which an object that is not observed any more counts as known
_MOST_REFUSALS = 3  # of chains in a row, after which the robot has failed
_FARTHEST_REACH = 100.0  # m
_GREATEST_COST = 1e6  # s

PARAMETERS = (
    *FRAMES,
    *WORLD,
    STATE,
    MODELS,
    LEARNED,
    Parameter("roles", "", "file of the team's roles (.yaml)"),
    live("execute", False, "whether the robot drives: its executor gets the role's chain"),
    Parameter(
        "timeout", 1.0, "real s without messages after which a robot drops out", low=0.4, high=60.0
    ),
    live(
        "retry_after", 3.0, "real s after which a robot that failed takes a role again", 0.0, 3600.0
    ),
)


class TeamNode(Node):
    """Decides, alike on each robot of a team, who takes which role, and lets its robot act.

    Start it in the namespace of each robot. There is no central node.

    Subscribes to
        /teammates (ator_interfaces/Teammate): the states of the teammates. odom
        (nav_msgs/Odometry), or /tf and /tf_static, and the topics of the domain's objects: the
        robot's own state. the topic of a map, if `map` names one.
    Publishes, five times a second
        /teammates (ator_interfaces/Teammate, transient local): the robot's state, its role, and
        what each role costs it.
        roles (ator_interfaces/Roles, transient local): who takes which role, and at which cost.
        /diagnostics, once a second.
    Calls
        execute_chain (ator_interfaces/ExecuteChain), with `execute`.
    """

    def __init__(self) -> None:
        super().__init__("team", automatically_declare_parameters_from_overrides=True)
        self._settings = settings = declare_parameters(self, PARAMETERS)
        self._name = self.get_namespace().strip("/")
        if not self._name:
            raise SetupError("namespace: expected that of the robot, as -r __ns:=/robot_1, got /")
        self._warn = Warnings(self)
        domain, robot = domain_and_robot(settings)
        self._use(domain, robot)
        self._file = _roles_of(settings["roles"], self._library, domain)
        self._role_names = tuple(role.name for role in self._file.roles)
        self._sets = LearnedSets(
            self, domain, {DEFAULT_SET: self._library}, settings, self._warm_up
        )
        self._map = FollowedMap(self, settings, domain, robot, self._take_map)
        sightings = {
            each: Sightings(each, _OBJECT_TIMEOUT, ObjectTracker(0.0, 0.0))
            for each in domain.objects
        }
        self._inputs = Inputs(sightings)
        self._world: World | None = None
        self._odom_at = -math.inf
        self._failed_until = -math.inf
        self._failure = ""
        self._refusals = 0  # in a row
        self._course: Course | None = None
        self._sent: SentChain | None = None
        self._sent_role = ""
        self._sent_chain = TopChain(())
        self._chains = ChainClient(self)
        self._mates = self.create_publisher(Teammate, TEAMMATES, LATCHED)
        self._beliefs = self.create_publisher(Roles, "roles", LATCHED)
        subscribed = Subscriptions(
            self, settings, robot, map(domain.source, domain.objects),
            take_robot=self._take_robot, take_object=self._take_object, warn=self._warn,
        )  # fmt: skip
        self._tf = subscribed.tf
        self.create_subscription(Teammate, TEAMMATES, self._take_mate, LATCHED_BY_MANY)
        self._roster = Roster(self._name, settings["timeout"], time.monotonic())
        self.create_timer(PERIOD, self._decide, clock=STEADY)
        Diagnostics(self, self._health)
        self.get_logger().info(
            f"{self._name} takes one of the roles {', '.join(self._role_names)} (domain "
            f"{domain.name}, ROS domain {self.context.get_domain_id()})"
        )

    def _use(self, domain: Domain, robot: Robot) -> None:
        self._domain = domain
        self._robot = robot
        self._library = domain.library(robot)

    def _take_map(self, domain: Domain, robot: Robot) -> None:
        self._use(domain, robot)
        self._sets.load(domain, {DEFAULT_SET: self._library})

    def _refiner(self, models: ModelSet) -> Refiner:
        return Refiner(
            self._robot,
            models.models,
            ranges=self._domain.ranges,
            failure_cost=self._domain.time_limit,
        )

    def _warm_up(self, library: TopLibrary, models: ModelSet) -> None:
        warm_up_refinement(library, self._refiner(models))

    # Inputs

    def _take_object(self, object_name: str, stamp: float, there: ObjectState) -> None:
        if warning := self._inputs.object(object_name, stamp, there, time.monotonic()):
            self._warn(warning)

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        now = time.monotonic()
        try:
            world = self._inputs.robot(stamp, robot, now)
        except ClockJumpError as error:
            self._warn(str(error))
            return
        if world is not None:
            self._world = world
            self._odom_at = now

    def _take_mate(self, message: Teammate) -> None:
        if message.name == self._name:
            return
        now = time.monotonic()
        try:
            member = self._member_from(message)
        except MessageError as error:
            self._warn(f"{TEAMMATES}: ignored {quoted(message.name)}: {error}")
            return
        known = {member.name for member in self._roster.members(now)}
        if message.name not in known and len(known) >= _MOST_ROBOTS:
            self._warn(f"{TEAMMATES}: expected at most {_MOST_ROBOTS} robots, got more")
            return
        self._roster.take(member, now, ready=message.ready)

    def _member_from(self, message: Teammate) -> Member:
        """Read the message of a teammate, in the frame of this robot; raises MessageError."""
        frame = self._settings["frame"]
        origin = self._tf.base(frame, message.situation.header.frame_id) or SAME_FRAME
        into_frame(frame, self._tf.base, (), [message.situation])
        world = world_from(message.situation, frame=frame)
        objects = {
            each: world.objects[each] for each in self._domain.objects if each in world.objects
        }
        names([each.role for each in message.roles], "roles", allowed=self._role_names)
        return Member(
            message.name,
            dataclasses.replace(world, objects=objects),
            number(message.reach, "reach", low=0.0, high=_FARTHEST_REACH, unit="m"),
            name(message.role, "role", allowed=("", *self._role_names)),
            {each.role: _bid_from(each, origin) for each in message.roles},
        )

    # Decisions

    def _decide(self) -> None:
        """Decide on the newest states, publish state and roles, and let the robot act."""
        now = time.monotonic()
        self._note_end(now)
        if self._world is None:
            return
        status = self._problem(now)
        is_ready = not status
        own = Member(self._name, self._world, self._robot.reach, self._roster.role())
        self._roster.take(own, now, ready=is_ready)
        if not is_ready:
            self._course = None
            self._stop()
        else:
            plans = self._plans(self._world, now)
            own = dataclasses.replace(own, bids=bids_of(plans))
            self._roster.take(own, now)
            decision = self._roster.decide(self._file.roles, now)
            self._beliefs.publish(self._belief(decision, self._world, now))
            self._act(plans.get(self._roster.role()), self._world, decision)
            status = self._reason(decision)
        self._publish_state(own, status, ready=is_ready)

    def _plans(self, world: World, now: float) -> dict[str, Plan]:
        """Return how the robot would act in each role."""
        return plan_roles(
            world,
            self._file.roles,
            self._refiner(self._sets.present[DEFAULT_SET]),
            self._library,
            common_objects(self._roster.members(now), self._robot),
            origin=self._origin() or SAME_FRAME,
            barred=self._roster.barred(now),
            course=self._course,
        )

    def _problem(self, now: float) -> str:
        """Return why the robot cannot take a role; empty if it can."""
        if self._roster.is_listening(now):
            return "waiting for messages of teammates"
        if now - self._odom_at > self._roster.timeout:
            return "expected odometry, got none"
        if self._map.is_missing:
            return self._map.problem
        if self._origin() is None:
            return f"tf: expected the frame {quoted(self._file.frame)} of the roles, got none"
        if not self._settings["execute"]:
            return ""
        if not self._chains.is_ready():
            return "expected the robot's executor, got none"
        return self._failure if now < self._failed_until else ""

    def _origin(self) -> Pose | None:
        """Return the frame of the roles in that of the robot; None if it is unknown."""
        frame = self._settings["frame"]
        if plain_frame(self._file.frame) in ("", plain_frame(frame)):
            return SAME_FRAME
        return self._tf.base(frame, self._file.frame)

    def _reason(self, decision: Decision) -> str:
        """Return in a sentence what the robot does, and why roles do not change."""
        role = self._roster.role()
        text = f"has the role {role}" if role else "has no role"
        if decision.waits(self._name):
            text += " and waits, as a more important role needs its place"
        found = decision.assignment
        if found.gain:
            text += f"; a change would gain {found.gain:.2f} s ± {found.uncertainty:.2f} s"
        return text

    def _belief(self, decision: Decision, world: World, now: float) -> Roles:
        """Write a decision."""
        message = Roles(
            robot=self._name,
            role=self._roster.role(),
            gain=decision.assignment.gain,
            uncertainty=decision.assignment.uncertainty,
            reason=one_line(self._reason(decision)),
        )
        message.header.stamp = stamp_of(world.time)
        message.header.frame_id = self._settings["frame"]
        members = {member.name: member for member in self._roster.members(now)}
        for robot in decision.names:
            for role in self._role_names:
                message.pairs.append(_role_message(members[robot], role))
        return message

    def _publish_state(self, own: Member, status: str, *, ready: bool) -> None:
        own = dataclasses.replace(own, role=self._roster.role())
        self._mates.publish(
            Teammate(
                name=self._name,
                situation=situation_of(own.world, frame=self._settings["frame"]),
                reach=own.reach,
                ready=ready,
                role=own.role,
                roles=[_role_message(own, role) for role in own.bids],
                status=one_line(status),
            )
        )

    # Driving

    def _act(self, plan: Plan | None, world: World, decision: Decision) -> None:
        """Note when the robot should be done in its role, and with `execute` send the chain."""
        role = self._roster.role()
        reach = self._robot.reach
        self._course = course_in(role, plan, self._course, world.time, reach) if plan else None
        if not self._settings["execute"]:
            self._stop()
            return
        same = self._sent is not None and role == self._sent_role
        if plan is None or decision.waits(self._name) or not (plan.chain or same):
            self._stop()
            return
        if not plan.chain or (same and plan.goes_on(self._sent_chain, reach)):
            return
        observed = as_observed(plan.chain, world)
        message = chain_of(observed, action_set=DEFAULT_SET, frame=self._settings["frame"])
        self._sent = self._chains.send(ExecuteChain.Goal(chain=message))
        self._sent_role = role
        self._sent_chain = plan.chain

    def _stop(self) -> None:
        """Cancel the role's chain."""
        if self._sent is not None:
            self._sent.cancel()
        self._sent = None

    def _note_end(self, now: float) -> None:
        """Note the end of the chain; a robot whose chain failed drops out for a while."""
        if self._sent is None or not self._sent.result.done():
            return
        outcome = self._sent.result.result().outcome
        self._sent = None
        self._refusals = self._refusals + 1 if outcome.code == Outcome.REFUSED else 0
        # An object may have moved between the decision and its execution.
        if 0 < self._refusals < _MOST_REFUSALS:
            return
        if outcome.code != Outcome.SUCCEEDED:
            self._failed_until = now + self._settings["retry_after"]
            self._failure = f"the chain of {self._sent_role} failed: {outcome.reason}"
            self._warn(self._failure)

    def _health(self) -> Health:
        now = time.monotonic()
        others = [each.name for each in self._roster.members(now) if each.name != self._name]
        problems = self._problem(now), self._sets.problem
        values = {
            "role": self._roster.role() or "none",
            "teammates": ", ".join(sorted(others)) or "none",
            "last error": self._warn.last,
            **self._sets.diagnostics(),
        }
        return Health("; ".join(filter(None, problems)), self._map.is_missing, values)

    def stop(self) -> None:
        """Stop the robot, and leave the team, before the node ends."""
        self._chains.abandon(Outcome.SHUTDOWN, "the node team was ended")
        if self._world is not None:
            own = Member(self._name, self._world, self._robot.reach)
            self._roster.take(own, time.monotonic(), ready=False)
            self._publish_state(own, "the node team was ended", ready=False)
        spin_out(self)


def _role_message(member: Member, role: str) -> RoleMessage:
    """Write what a role costs a robot."""
    bid = member.bids.get(role)
    message = RoleMessage(robot=member.name, role=role, holds=role == member.role)
    message.cost = math.nan if bid is None else float(bid.cost)
    message.uncertainty = math.nan if bid is None else float(bid.error)
    message.end.x, message.end.y = (math.nan, math.nan) if bid is None else map(float, bid.end)
    return message


def _bid_from(message: RoleMessage, origin: Pose) -> Bid:
    """Read what a role costs a robot; `origin` is its frame in that of this robot."""
    x = position(message.end.x, f"{message.role}: end: x")
    y = position(message.end.y, f"{message.role}: end: y")
    error = message.uncertainty
    if error != math.inf:  # that of models without known errors
        error = number(error, f"{message.role}: uncertainty", low=0.0, high=_GREATEST_COST)
    return Bid(
        number(message.cost, f"{message.role}: cost", low=0.0, high=_GREATEST_COST, unit="s"),
        error,
        origin.compose(Pose(x, y, 0.0))[:2],
    )


def _roles_of(file: str, library: TopLibrary, domain: Domain) -> RoleFile:
    """Read the file of roles; raises SetupError."""
    if not file:
        raise SetupError("parameter roles: expected a file, got none; config/team has examples")
    try:
        return load_roles(Path(file).expanduser(), library, domain.objects)
    except FileError as error:
        raise SetupError(f"parameter roles: {error}") from error


main = partial(run_node, TeamNode, PARAMETERS)
