"""The node `executor`: executes chains of TOPs on the robot (paper, section 2.2)."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, ChainPerformance
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.remote import LONGEST
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.execution.predictions import Predictor, warm_up_actions
from ator_ros.execution.refining import AGAIN_AFTER
from ator_ros.execution.rolling import Rolling
from ator_ros.execution.supervisor import (
    GREATEST_STOP_SLOWDOWN,
    LONGEST_STOP_TIME,
    WATCH_PERIOD,
    Deadlines,
    Phase,
    Supervisor,
)
from ator_ros.nodes.commands import CommandPublisher
from ator_ros.nodes.diagnostics import (
    STEADY,
    Diagnosis,
    Diagnostics,
    Health,
    Ticks,
    Warnings,
    several_publishers,
)
from ator_ros.nodes.drawing import ExecutionDrawing
from ator_ros.nodes.goal_run import GoalRun, concluded, unstarted
from ator_ros.nodes.leases import LeaseWatch
from ator_ros.nodes.main_loop import pause, run_node, spin_out
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.messages import action_set_from, alternative_from, chain_from, into_frame
from ator_ros.nodes.models import LEARNED, LearnedSets
from ator_ros.nodes.parameters import (
    FENCE,
    FRAMES,
    MODELS,
    OBJECT,
    STAMPED,
    STATE,
    WORLD,
    Parameter,
    SetupError,
    declare_with_domain,
    domain_and_robot,
    fence_of,
    live,
)
from ator_ros.nodes.qos import ACTION_QUEUES, LATCHED, RESULTS, SERVICES
from ator_ros.nodes.remote_actions import RemoteServers
from ator_ros.nodes.subscriptions import Subscriptions
from ator_ros.printable import one_line
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import missing_in
from ator_ros.world.inputs import ClockJumpError, Inputs
from ator_ros.world.readers import MessageError
from ator_ros.world.sightings import ObjectTracker, Sightings
from ator_ros.world.state import STOP, Command, ObjectState, RobotState, World

# real s; DDS may still be connecting cmd_vel to a base that has just started
_DISCOVERY_GRACE = 1.0
# real s from this node's start for which others may start beside it: the first start of refinement
# compiles code, which may take a minute
_STARTUP = 60.0
_RESULT_TIMEOUT = 60  # s; rclpy's 900 s would keep the records of hundreds of chains in memory
_OVERTAKEN = "a newer goal took over"
_LONGEST_SUMMARY = 500  # characters of the line that the log has at the end of a goal
_USUAL = Deadlines()
_COMMON = (
    *FRAMES,
    STATE,
    STAMPED,
    *WORLD,
    MODELS,
    LEARNED,
    live("start_timeout", _USUAL.start, "real s that a goal waits for inputs", 0.05, LONGEST),
    live(
        "odom_timeout",
        _USUAL.odom,
        "real s without odometry, more if its stamps are slower than real time, at least 2 if "
        "faster or just after the start, and its greatest delay; the robot pauses after half",
        0.05,
        60.0,
    ),
    # A base that does not follow is stopped within 0.5 s; a greater latency would hide it until
    # then.
    live("latency", 0.0, "s from a state's stamp until its answer moves the base", 0.0, 0.3),
    FENCE,
    live(
        "refinement_timeout",
        _USUAL.refinement,
        "real s that an answer of refinement may take",
        0.01,
        60.0,
    ),
    live(
        "refine_again_after", AGAIN_AFTER, "m off what was expected to ask again, or 0", 0.0, 10.0
    ),
    live(
        "action_timeout", _USUAL.action, "s, by the stamps, that one action may take", 1.0, LONGEST
    ),
)


def parameters_for(objects: Sequence[str]) -> tuple[Parameter, ...]:
    """Return the parameters of the node, among them three for each of the `objects`."""
    parameters = list(_COMMON)
    for name in objects:
        age = f"s by which the {name} may be older than odometry; the robot pauses after half"
        noise = f"m, standard deviation of the {name}'s coordinates; 0: exact"
        parameters += [
            live(f"{name}_timeout", 0.3, age, 0.05, 60.0),
            Parameter(f"{name}_noise", 0.0, noise, 0.0, 1.0),
            Parameter(
                f"{name}_velocity_noise", 0.0, "m/s, standard deviation of its velocity", 0.0, 10.0
            ),
        ]
    return tuple(parameters)


class ExecutorNode(Node):
    """Executes one chain at a time; publishes one velocity command for each odometry message.

    Parameters that change while it runs count from the next goal on.

    Action server
        execute_chain (ator_interfaces/ExecuteChain): a newer goal that can be read preempts the
        running one. Results are kept for a minute. A goal starts once odometry has come for a
        second: a base that has just started does not receive commands yet. It ends when the robot
        stands (predicted with `latency`), or 5 s after the command to stop: the result then gives
        the robot's speed. It ends with the command to stop if a newer goal preempts it, odometry is
        lost or the node ends. If lost odometry returns within 5 s, the robot is commanded to stop
        until it stands. Goals outside the fence are refused. A goal is aborted when the base does
        not follow its commands, or when its path leads out of the fence.
    Subscribes to
        odom (nav_msgs/Odometry), or /tf and /tf_static, and the topics of the domain's objects:
        their stamps plus `latency` are the time of the actions; the topic of a map, if `map` names
        one.
    Publishes
        cmd_vel (geometry_msgs/Twist or TwistStamped, see `stamped_commands`): while a goal is
        active, unless a server executes it. performance/action (ator_interfaces/ActionPerformance):
        after each action, also an interrupted one. performance/chain
        (ator_interfaces/ChainPerformance, transient local): after each goal. chain_under_way,
        planned_path and markers, see `ExecutionDrawing`; /diagnostics, once a second.
    Calls
        refine_subgoal, when a goal asks for it; the domain's action servers.
    """

    def __init__(self) -> None:
        super().__init__("executor", automatically_declare_parameters_from_overrides=True)
        self._settings = declare_with_domain(self, parameters_for)
        domain, robot = domain_and_robot(self._settings)
        self._domain = domain
        self._warn = Warnings(self)
        self._remotes = RemoteServers(self, domain, self._settings["frame"], self._warn)
        self._libraries = self._remotes.libraries(robot)
        reasons = [top.lacks(robot) for top in domain.tops_for(robot)]
        reasons += [
            reason for library in self._libraries.values() for reason in library.left_out.values()
        ]
        for reason in filter(None, reasons):
            self.get_logger().warning(reason)
        self._sets = LearnedSets(self, domain, self._libraries, self._settings)
        self._map = FollowedMap(
            self, self._settings, domain, robot, self._take_map, lambda: self._run is None
        )
        for name, library in self._libraries.items():
            warm_up_actions(library, Predictor(library.robot, self._sets.present[name].models))
        self._inputs = inputs_of(self._settings, domain.objects)
        self._motion = MotionWatch(robot, self._settings["latency"])
        self._fence = fence_of(self._settings, robot)
        noises = (self._settings[f"{name}_velocity_noise"] for name in domain.objects)
        self._rolling = Rolling(robot, slowest=3.0 * max(noises, default=0.0))
        self._world: World | None = None
        self._arrived = 0  # number of the last goal that arrived
        self._newest = 0  # number of the last goal that started
        self._run: GoalRun | None = None
        self._odom_at = 0.0
        self._stop_until = 0.0
        self._shutting_down = False
        self._motion_remark = ""  # as logged last
        self._ticks = Ticks()
        self._started = time.monotonic()
        self._connect(robot)
        topics = self._diagnosis.topics
        Diagnostics(self, self._health, topics)
        self._drawing = ExecutionDrawing(self, domain, robot, self._settings["frame"])
        sources = " and ".join(["odom" if "odom" in topics else "tf", *domain.objects])
        self.get_logger().info(
            f"ready for chains of {robot.name} (domain {domain.name}, ROS domain "
            f"{self.context.get_domain_id()}), from {sources} in {self._settings['frame']} "
            f"to cmd_vel; {self._sets.startup_text()}"
        )

    def _connect(self, robot: Robot) -> None:
        settings = self._settings
        stamped = settings["stamped_commands"]
        frame = settings["robot_frame"]
        self._commands = CommandPublisher(self, stamped=stamped, frame=frame)
        self._actions = self.create_publisher(ActionPerformance, "performance/action", RESULTS)
        self._chains = self.create_publisher(ChainPerformance, "performance/chain", LATCHED)
        self._lease = LeaseWatch(self)
        self._refinement = self.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
        subscribed = Subscriptions(
            self, settings, robot, map(self._domain.source, self._domain.objects),
            take_robot=self._take_robot, take_object=self._take_object, warn=self._warn,
        )  # fmt: skip
        self._tf = subscribed.tf
        self._diagnosis = Diagnosis(self, subscribed)
        self._server = ActionServer(
            self, ExecuteChain, "execute_chain", self._execute,
            goal_callback=self._response,
            cancel_callback=self._cancel,
            result_timeout=_RESULT_TIMEOUT, **ACTION_QUEUES,
        )  # fmt: skip
        self.create_timer(WATCH_PERIOD, self._check_deadlines, clock=STEADY)

    def _response(self, _: ExecuteChain.Goal) -> GoalResponse:
        return GoalResponse.REJECT if self._shutting_down else GoalResponse.ACCEPT

    def _take_map(self, domain: Domain, robot: Robot) -> None:
        """Check goals on another map from now on."""
        self._domain = domain
        self._libraries = self._remotes.libraries(robot)
        self._sets.load(domain, self._libraries)

    def _take_object(self, name: str, stamp: float, there: ObjectState) -> None:
        if warning := self._inputs.object(name, stamp, there, time.monotonic()):
            self._warn(warning)

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        now = time.monotonic()
        try:
            world = self._inputs.robot(stamp, robot, now)
        except ClockJumpError as error:
            self._warn(str(error))
            self._motion.reset()
            # A goal that waits for its first state continues, as after a restart of the simulation.
            if self._run is not None and self._run.supervisor.phase is not Phase.WAITING:
                self._end(Ending.INPUT_LOST, str(error))
            return
        if world is None:
            return
        run = self._run
        fault = None if run is None else self._motion.fault(world.time, world.robot, now)
        world = self._motion.foresight.ahead(world)
        self._world = world
        self._odom_at = now
        self._rolling.observe(world)  # also between goals, when the robot has lost an object
        self._ticks.start(now)
        if run is not None:
            self._control(run, world, fault, now)
        elif now < self._stop_until:
            if world.robot.is_standing:
                self._stop_until = 0.0
            else:
                self._send(STOP)  # it may have moved on while odometry was lost
        self._drawing.objects(world)

    def _control(self, run: GoalRun, world: World, fault: str | None, now: float) -> None:
        """Send the command of a goal for the newest state."""
        if self._motion.remark not in ("", self._motion_remark):
            self._motion_remark = self._motion.remark
            self.get_logger().warning(self._motion_remark)
        run.supervisor.slowdown = self._inputs.slowdown
        run.supervisor.may_stall = self._may_stall(now)
        # While DDS may still be connecting the base, it would seem blocked.
        grace = min(_DISCOVERY_GRACE, 0.5 * self._settings["start_timeout"])
        is_connecting = now - max(self._inputs.since, self._commands.changed) < grace
        if self._remotes.ending() or (is_connecting and run.supervisor.phase is Phase.WAITING):
            self._send(STOP)
            self._motion.reset()  # the motion is not due to our commands
            run.supervisor.odometry_received(time.monotonic())
            return
        command = run.supervisor.tick(world, now, overdue=self._inputs.overdue, fault=fault)
        done = time.monotonic()
        self._send(self._motion.foresight.punctual(world.robot, command, done - now), answers=True)
        self._ticks.end(done)
        run.supervisor.odometry_received(done)
        self._report(run)

    def _check_deadlines(self) -> None:
        self._remotes.check()
        if self._run is None:
            return
        self._adapt_commands()
        if self._lease.has_ended:
            self._run.supervisor.end(Ending.CANCELED, "the client of this goal is gone")
        now = time.monotonic()
        silence = now - self._odom_at
        ending = self._remotes.ending()
        if ending and silence <= self._odom_timeout:
            self._run.supervisor.postpone(now, "waiting until a canceled server has ended")
        silent = (
            0.5
            * self._settings["odom_timeout"]
            * min(self._inputs.slowdown, GREATEST_STOP_SLOWDOWN)
        )
        if self._run.supervisor.odometry_is_late(now) or (ending and silence > silent):
            self._send(STOP)
        self._run.supervisor.watch(now)
        self._report(self._run)

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Start a goal and wait for its end, which the callbacks of odometry and timer detect."""
        settings = self._settings
        present = self._sets.present
        self._arrived += 1
        number = self._arrived
        try:
            self._map.expect_usable()
            action_set = action_set_from(handle.request.chain, allowed=self._libraries)
            library = self._libraries[action_set]
            chains = await self._read(handle.request, library)
            if self._shutting_down:
                return self._unstarted(handle, Ending.SHUTDOWN, "the executor was ended")
            if handle.is_cancel_requested:
                return self._unstarted(handle, Ending.CANCELED, "canceled by the client")
            if number < self._newest:
                return self._unstarted(handle, Ending.PREEMPTED, _OVERTAKEN)
            run = GoalRun(
                handle,
                library,
                chains,
                present[action_set],
                self._refinement,
                settings,
                self._fence,
                self._rolling,
                None if self._is_simulated else self._inputs.delay,
            )
            self._lease.watch(handle.request.lease)
        except MessageError as error:  # the running goal continues
            self._warn(f"refused: {error}")
            return self._unstarted(handle, Ending.REFUSED, str(error))
        self._newest = number
        self._inputs.set_timeouts(settings)
        self._motion.begin(settings["latency"], preempts=self._run is not None)
        self._end(Ending.PREEMPTED, _OVERTAKEN, at_once=True)
        self._run = run
        self._stop_until = 0.0
        run.supervisor.may_stall = self._may_stall(time.monotonic())
        # not in the goal callback: rclpy would keep the previous publisher in use
        self._adapt_commands()
        # A simulation as fast as possible waits for commands, also while the first action plans.
        self._send(STOP)
        return concluded(await run.finished, handle)

    async def _read(self, goal: ExecuteChain.Goal, library: TopLibrary) -> list[TopChain]:
        """Read the chains of a goal one by one, so that a running goal continues in between."""
        frame = self._settings["frame"]
        await pause(self)
        into_frame(frame, self._tf.base, [goal.chain])
        chains = [chain_from(goal.chain, library, frame=frame, fence=self._fence)]
        for number, sent in enumerate(goal.alternatives):
            await pause(self)
            into_frame(frame, self._tf.base, [sent])
            chains.append(alternative_from(sent, number, library, frame=frame, fence=self._fence))
        await pause(self)
        return chains

    def _unstarted(self, handle: ServerGoalHandle, ending: Ending, reason: str) -> Any:
        """Publish and return the result of a goal that ended before it started."""
        result = unstarted(handle, ending, reason, frame=self._settings["frame"])
        self._chains.publish(result.record)
        return concluded(result, handle)

    def _adapt_commands(self) -> None:
        """Choose the type of commands by the base in the graph, until a goal starts."""
        if self._run is None or self._run.supervisor.phase is Phase.WAITING:
            self._commands.adapt()

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._run is not None and self._run.handle is handle:
            self._run.supervisor.end(Ending.CANCELED, "canceled by the client")
            self._send(STOP)
        return CancelResponse.ACCEPT  # also while the goal is read

    def _end(self, ending: Ending, reason: str, *, at_once: bool = False) -> None:
        """End the running goal, if there is one; `at_once` does not wait until the robot stands."""
        if self._run is None:
            return
        self._run.supervisor.end(ending, reason)
        if at_once:
            self._run.supervisor.drop()
        self._send(STOP)
        self._report(self._run)

    def _report(self, run: GoalRun) -> None:
        """Publish new records and feedback; finish the goal when it has ended."""
        for record in run.new_records():
            self._actions.publish(record)
        run.request_refinement()
        run.publish_feedback()
        self._drawing.follow(run, self._world)
        if not run.ended:
            return
        self._run = None
        now = time.monotonic()
        if now - self._odom_at > 0.5 * self._odom_timeout:
            self._stop_until = now + LONGEST_STOP_TIME
        self._send(STOP)
        run.supervisor.explain(self._cause(run.supervisor))
        result = run.result(self._world)
        self._chains.publish(result.record)
        run.finished.set_result(result)
        if run.supervisor.ending is not Ending.SUCCEEDED:
            self._warn.last = run.supervisor.reason
        self.get_logger().info(one_line(f"goal ended: {run.summary}", _LONGEST_SUMMARY))

    def _cause(self, supervisor: Supervisor) -> str:
        """Return the most likely cause of an ending that is due to inputs or the base.

        Empty if unknown.
        """
        ending = supervisor.ending
        remark = self._motion.remark
        if ending is Ending.SUCCEEDED:
            return remark
        judged = (Ending.BASE_FAULT, Ending.OUT_OF_BOUNDS, Ending.FAILED, Ending.INPUT_LOST)
        if ending in judged and (several := self._diagnosis.senders_problem()):
            return several  # their states may seem to be motion, or stamps that go back
        if ending is Ending.BASE_FAULT:
            return self._motion.cause or self._delay_problem() or self._commands.cause()
        if ending is Ending.FAILED:
            return (
                self._delay_problem()
                or self._diagnosis.rate_problem("odom", self._odom_timeout)
                or supervisor.gap_problem
                or remark
            )
        if ending is not Ending.INPUT_LOST:
            return ""
        if self._world is None or time.monotonic() - self._odom_at > 0.5 * self._odom_timeout:
            return self._missing_cause("odom")
        lost = missing_in(supervisor.executor.chain.calls, self._world)
        return self._missing_cause(lost[0]) if lost else ""

    def _missing_cause(self, name: str) -> str:
        timeout = self._odom_timeout if name == "odom" else self._settings[f"{name}_timeout"]
        return self._diagnosis.cause(name, timeout)

    def _may_stall(self, now: float) -> bool:
        """Return whether odometry may be missing for a while.

        That of a fast simulation may, and any after a start: nodes that start beside this one
        compile and discover each other.
        """
        return self._inputs.is_fast or now - self._started < _STARTUP

    @property
    def _is_simulated(self) -> bool:
        """Whether a simulation's clock is published, which may become slower without a delay."""
        return bool(self.count_publishers("/clock") > 0)

    @property
    def _delay(self) -> float:
        """The delay of states in s; 0 if they are simulated."""
        return 0.0 if self._is_simulated else self._inputs.delay.seconds

    def _delay_problem(self) -> str:
        """Return that states are old, or an empty text."""
        delay = self._delay
        if delay <= self._settings["odom_timeout"]:
            return ""
        return (
            f"odom: states are {delay:.1f} s old when they are read: the network, a node that "
            "publishes them or this machine cannot keep up"
        )

    @property
    def _odom_timeout(self) -> float:
        """Real s without odometry, longer where its clock runs slower than real time."""
        return float(self._settings["odom_timeout"]) * self._inputs.slowdown

    def _send(self, command: Command | None, *, answers: bool = False) -> None:
        """Send a command, as of now or as the answer to the newest state.

        None: a server moves the robot.
        """
        if self._inputs.time is not None:
            now = time.monotonic()
            self._motion.sent(
                self._inputs.time + (0.0 if answers else now - self._odom_at), command, now
            )
        if command is not None:
            self._commands.publish(command, self._inputs.time or 0.0)

    def _health(self) -> Health:
        silence = time.monotonic() - self._odom_at if self._odom_at else None
        stale = silence is None or silence > self._odom_timeout
        known = {} if self._world is None else self._world.objects
        overdue = self._inputs.overdue
        values: dict[str, object] = {
            "odom": "none yet" if silence is None else f"{1000.0 * silence:.0f} ms ago",
            **{
                name: "unknown" if name not in known else "overdue" if name in overdue else "known"
                for name in self._domain.objects
            },
            "delay of odom (s)": f"{self._delay:.2f}" if self._inputs.delay.is_known else "unknown",
            **self._rolling.diagnostics(),
            **self._ticks.diagnostics(),
            "goal": "none" if self._run is None else self._run.supervisor.phase.value,
            "times real time, by odometry": f"{self._inputs.pace:.2f}",
            "last error": self._warn.last,
            **self._sets.diagnostics(),
        }
        required = (name for name in self._domain.objects if not self._domain.source(name).optional)
        lost = [name for name in required if name not in known]
        missing = ""
        self._adapt_commands()
        if stale:
            source = "odom" if "odom" in self._diagnosis.topics else "tf"
            missing = f"{source} is missing; {self._missing_cause('odom')}"
        elif lost:
            missing = f"{', '.join(lost)}: expected recent messages; {self._missing_cause(lost[0])}"
        elif self._run is not None:  # without a goal inputs are read less often than they come
            missing = self._diagnosis.rate_problem("odom", self._odom_timeout)
        problems = (
            missing,
            "" if missing else self._delay_problem(),
            self._commands.mismatch(),
            "" if self._run is None else self._motion.remark,
            self._map.problem,
            self._sets.problem,
            self._remotes.problem,
            several_publishers(self, self._diagnosis.topics),
        )
        is_error = self._map.is_missing or (stale and self._run is not None)
        return Health("; ".join(filter(None, problems)), is_error, values)

    def stop(self) -> None:
        """Stop the robot and end the running goal, before the node ends."""
        self._send(STOP)  # first: ending an action may fail
        self._shutting_down = True
        self._end(Ending.SHUTDOWN, "the executor was ended", at_once=True)
        self._remotes.stop()
        self._send(STOP)
        spin_out(self)  # so that the result is sent, also to a client that requests it only now
        self._send(STOP)


def inputs_of(settings: Mapping[str, Any], objects: Iterable[str]) -> Inputs:
    """Return the inputs for these objects; raises SetupError."""
    sightings = {}
    for name in objects:
        noise = settings[f"{name}_noise"]
        velocity_noise = settings[f"{name}_velocity_noise"]
        if (noise > 0.0) != (velocity_noise > 0.0):
            where = f"parameters {name}_noise and {name}_velocity_noise"
            got = f"{noise:g} and {velocity_noise:g}"
            raise SetupError(f"{where}: expected both above 0 or both 0, got {got}")
        sightings[name] = Sightings(
            name, settings[f"{name}_timeout"], ObjectTracker(noise, velocity_noise)
        )
    return Inputs(sightings)


main = partial(run_node, ExecutorNode, parameters_for([OBJECT]))
