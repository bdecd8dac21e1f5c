"""Conversions between ROS messages and the core's types, with all checks of requests and goals.

Functions that read a message raise MessageError; its text starts with `where`, the name of the
message.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, partial

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Quaternion, Twist
from nav_msgs.msg import OccupancyGrid, Odometry

import ator_interfaces.msg as msg
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import (
    GOAL_VARIABLES,
    ORDER,
    STOP,
    goal_values,
    wrong_values,
)
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.planning.goals import MOST_STATEMENTS, GoalStatement, Unspecified
from ator_ros.printable import one_line, quoted
from ator_ros.refinement import RefinementError
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.refinement.gate import MeasuredGain
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import (
    LONGEST_ALTERNATIVE,
    LONGEST_CHAIN,
    Judged,
    Refinement,
    Selection,
    SubgoalCurve,
)
from ator_ros.tops.chain import EVERYTHING, AllowedRange, InvalidChainError, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Region
from ator_ros.tops.library import LeftOutError, TopLibrary
from ator_ros.tops.ordering import ordering_of
from ator_ros.world import readers as checks
from ator_ros.world.grid_map import GridMap, map_of_grid
from ator_ros.world.readers import FARTHEST, MessageError, goal_pose_from, pose_from
from ator_ros.world.state import Command, ObjectState, RobotState, World

# times the robot's limit, which may be an estimate; a speed in km/h would be 3.6 times
_FASTEST_GOAL = 3.0
_MOST_LIMITS = 8  # as in FreeVariable.msg
_LONGEST_TEXT = 65_536  # characters of all texts in a refused chain that is sent back


def stamp_of(seconds: float) -> Time:
    """Return seconds as a stamp, to the nanosecond."""
    nanoseconds = round(seconds * 1e9)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def pose_of(pose: Pose) -> PoseMessage:
    """Write a planar pose."""
    x, y, z, w = quaternion_from_yaw(pose.yaw)
    message = PoseMessage(orientation=Quaternion(x=x, y=y, z=z, w=w))
    message.position.x = float(pose.x)
    message.position.y = float(pose.y)
    return message


def twist_of(command: Command) -> Twist:
    """Write a velocity command."""
    message = Twist()
    message.linear.x = float(command.vx)
    message.linear.y = float(command.vy)
    message.angular.z = float(command.w)
    return message


def chain_to_return(chain: msg.TopChain) -> msg.TopChain:
    """Return a chain that was refused, or an empty one if it is too large to be sent back."""
    is_small = len(chain.calls) <= LONGEST_CHAIN and _text_length(chain) <= _LONGEST_TEXT
    return chain if is_small else msg.TopChain()


def _text_length(chain: msg.TopChain) -> int:
    """Return the number of characters of all texts in a chain."""
    length = len(chain.action_set)
    for call in chain.calls:
        length += len(call.top) + len(call.goal.header.frame_id) + sum(map(len, call.open))
        length += sum(len(value.name) for value in call.values)
    return length


def into_frame(
    frame: str,
    base: Callable[[str, str], Pose | None],
    chains: Iterable[msg.TopChain | msg.AlternativeChain],
    situations: Iterable[msg.Situation] = (),
) -> None:
    """Transform goals and situations in place to a frame.

    Those whose frame has no pose according to `base` (`TfListener.base`) are left. Each frame is
    looked up once, which takes up to 1 ms.
    """
    origin_in = cache(partial(base, frame))
    for goal in (call.goal for chain in chains for call in chain.calls):
        if (origin := origin_in(goal.header.frame_id)) is not None:
            goal.pose = pose_of(origin.compose(goal_pose_from(goal.pose, "call.goal.pose")))
            goal.header.frame_id = frame
    for situation in situations:
        if (origin := origin_in(situation.header.frame_id)) is not None:
            robot = pose_from(situation.robot, "situation.robot")
            situation.robot = pose_of(origin.compose(robot))
            turn = Pose(0.0, 0.0, origin.yaw)
            for item in situation.objects:
                for vector, pose in ((item.position, origin), (item.velocity, turn)):
                    vector.x, vector.y, _ = pose.compose(Pose(vector.x, vector.y, 0.0))
            situation.header.frame_id = frame


def odometry_of(time: float, robot: RobotState, *, frame: str, child: str) -> Odometry:
    """Write the robot's odometry: pose in `frame`, twist in the robot's own frame `child`."""
    message = Odometry(child_frame_id=child)
    message.header.stamp = stamp_of(time)
    message.header.frame_id = frame
    message.pose.pose = pose_of(robot.pose)
    message.twist.twist = twist_of(robot.velocity)
    return message


def object_odometry_of(time: float, there: ObjectState, *, frame: str, height: float) -> Odometry:
    """Write an object's position, `height` m above the floor, and its velocity, both in `frame`."""
    message = Odometry(child_frame_id=frame)
    message.header.stamp = stamp_of(time)
    message.header.frame_id = frame
    position = message.pose.pose.position
    linear = message.twist.twist.linear
    position.x = float(there.x)
    position.y = float(there.y)
    position.z = height
    linear.x = float(there.vx)
    linear.y = float(there.vy)
    return message


def occupancy_grid_of(grid: GridMap, *, frame: str) -> OccupancyGrid:
    """Write a map: 0 for free cells, 100 for the others."""
    message = OccupancyGrid(data=np.where(grid.free, 0, 100).astype(np.int8).ravel().tolist())
    message.header.frame_id = frame
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.free.shape
    message.info.origin = pose_of(grid.origin)
    return message


def grid_from(message: OccupancyGrid, topic: str, *, frame: str) -> GridMap:
    """Read the map of a topic; raises MessageError, or FileError if it has no free cells."""
    checks.expect_frame(message.header.frame_id, f"{topic}.header.frame_id", expected=frame)
    origin = pose_from(message.info.origin, f"{topic}.info.origin")
    size = message.info.width, message.info.height
    return map_of_grid(topic, *size, message.info.resolution, origin, message.data)


def situation_of(world: World, *, frame: str) -> msg.Situation:
    """Write the state of robot and objects."""
    robot = world.robot
    message = msg.Situation(
        robot=pose_of(robot.pose), vx=float(robot.vx), vy=float(robot.vy), w=float(robot.w)
    )
    message.header.stamp = stamp_of(world.time)
    message.header.frame_id = frame
    for name, there in world.objects.items():
        item = msg.ObjectState(name=name)
        item.position.x = float(there.x)
        item.position.y = float(there.y)
        item.velocity.x = float(there.vx)
        item.velocity.y = float(there.vy)
        message.objects.append(item)
    return message


# Chains


def action_set_from(chain: msg.TopChain, *, allowed: Collection[str], where: str = "chain") -> str:
    """Read the name of a chain's action set; empty means the default."""
    return checks.name(chain.action_set or DEFAULT_SET, f"{where}.action_set", allowed=allowed)


def chain_from(
    chain: msg.TopChain | msg.AlternativeChain,
    library: TopLibrary,
    *,
    frame: str,
    where: str = "chain",
    most: int = LONGEST_CHAIN,
    fence: Fence | None = None,
) -> TopChain:
    """Read a chain with goals in `frame`; raises MessageError also if it leads out of the fence."""
    checks.count(chain.calls, f"{where}.calls", least=1, most=most)
    read = TopChain(tuple(calls_from(chain.calls, library, frame=frame, where=f"{where}.calls")))
    try:
        ordering_of(read)
    except InvalidChainError as error:
        raise MessageError(f"{where}: {error}") from None
    violation = None if fence is None else fence.violation(read, library.robot, where)
    if violation is not None:
        raise MessageError(violation)
    return read


def order_from(order: Iterable[int]) -> tuple[int, ...]:
    """Read the order of a refined chain; empty if it is that of the chain as sent."""
    read = tuple(map(int, order))
    return () if read == tuple(range(len(read))) else read


def alternative_from(
    chain: msg.AlternativeChain,
    number: int,
    library: TopLibrary,
    *,
    frame: str,
    fence: Fence | None,
) -> TopChain:
    """Read the alternative with this number (from 0); raises MessageError as for chains."""
    return chain_from(
        chain,
        library,
        frame=frame,
        where=f"alternatives[{number}]",
        most=LONGEST_ALTERNATIVE,
        fence=fence,
    )


def calls_from(
    calls: Sequence[msg.TopCall], library: TopLibrary, *, frame: str, where: str = "calls"
) -> list[TopCall]:
    """Read steps with goals in `frame`."""
    return [
        _call_from(call, library, frame, f"{where}[{number}]") for number, call in enumerate(calls)
    ]


def _call_from(call: msg.TopCall, library: TopLibrary, frame: str, where: str) -> TopCall:
    try:
        top = library[checks.name(call.top, f"{where}.top", allowed=[*library, *library.left_out])]
    except LeftOutError as error:
        raise MessageError(f"{where}.top: {error}") from None
    checks.expect_frame(call.goal.header.frame_id, f"{where}.goal.header.frame_id", expected=frame)
    fastest = _FASTEST_GOAL * library.robot.greatest_speed()
    speed = checks.number(call.speed, f"{where}.speed", low=0.0, high=fastest, unit="m/s")
    pose = goal_pose_from(call.goal.pose, f"{where}.goal.pose")
    declared = library.goal_variables(top)
    values = {item.name: item.value for item in call.values}
    if STOP in values:
        raise MessageError(f"{where}.values: expected no {STOP}, which is the field `passing`")
    if any(item.name == STOP for item in declared):
        values[STOP] = 0.0 if call.passing else 1.0
    elif call.passing:
        raise MessageError(
            f"{where}.passing: expected false, as {top.action} cannot pass its goal: its server "
            "declares neither `early` nor `through`, or it has an arrival speed instead"
        )
    goal = Goal(pose, speed, top.point, values)
    if wrong := wrong_values(goal, declared):
        raise MessageError(f"{where}.values: {wrong}")
    opened = checks.names(
        call.open,
        f"{where}.open",
        allowed=(*GOAL_VARIABLES, *goal.values, STOP, ORDER, EVERYTHING),
    )
    read = TopCall(top, goal, opened, tuple(sorted({int(index) for index in call.after})))
    allowed = _allowed_from(call.allowed, read, library, where)
    read = dataclasses.replace(read, allowed=allowed).within_allowed(library.robot, library.ranges)
    if unmet := read.contradictions(library.robot):
        raise MessageError(
            f"{where}.goal ({top.name}): expected a goal at which its post-condition holds: "
            f"{'; '.join(unmet)}"
        )
    return read


def _allowed_from(
    allowed: Sequence[msg.AllowedRange], call: TopCall, library: TopLibrary, where: str
) -> tuple[AllowedRange, ...]:
    """Read the allowed ranges of a call's opened variables."""
    known = goal_values(call.goal)
    read = []
    for number, item in enumerate(allowed):
        place = f"{where}.allowed[{number}]"
        name = checks.name(item.name, f"{place}.name", allowed=known)
        if not call.opens(name):
            raise MessageError(f"{place}: expected an opened variable, got {name}; add it to open")
        most = 2.0 * math.tau if name == "yaw" else math.inf
        low = checks.number(item.low, f"{place}.low", low=-most, high=most)
        highest = low + math.tau if name == "yaw" else math.inf
        high = checks.number(item.high, f"{place}.high", low=low, high=highest)
        one = AllowedRange(name, low, high)
        usual = call.range_of(name, library.robot, library.ranges)
        alone = dataclasses.replace(call, allowed=(one,))
        if usual is None:
            raise MessageError(f"{place}: expected a variable with a range, got {name}")
        if alone.range_of(name, library.robot, library.ranges) is None:
            raise MessageError(
                f"{place}: expected a part of {usual}, which {name} can be, got {low:g} to {high:g}"
            )
        read.append(one)
    return tuple(read)


def alternative_of(chain: TopChain, *, frame: str) -> msg.AlternativeChain:
    """Write a chain of at most `LONGEST_ALTERNATIVE` steps as an alternative."""
    return msg.AlternativeChain(calls=[call_of(call, frame=frame) for call in chain.calls])


def chain_of(chain: TopChain, *, action_set: str, frame: str) -> msg.TopChain:
    """Write a chain."""
    return msg.TopChain(
        calls=[call_of(call, frame=frame) for call in chain.calls], action_set=action_set
    )


def call_of(call: TopCall, *, frame: str) -> msg.TopCall:
    """Write one step of a chain."""
    message = msg.TopCall(
        top=call.top.name,
        speed=float(call.goal.speed),
        passing=call.passing,
        open=sorted(call.open),
        after=call.after,
        allowed=[msg.AllowedRange(**each._asdict()) for each in call.allowed],
    )
    message.goal.header.frame_id = frame
    message.goal.pose = pose_of(call.goal.pose)
    message.values = [
        msg.GoalValue(name=name, value=float(value))
        for name, value in call.goal.values.items()
        if name != STOP
    ]
    return message


def statements_from(
    goal: msg.PlanGoal, named: Mapping[str, Condition], variables: Sequence[str]
) -> list[GoalStatement]:
    """Read the goal of a plan.

    That is one of the domain's `named` goals, or terms about its state `variables`.
    """
    if goal.name and goal.terms:
        raise MessageError("goal: expected a name or terms, got both")
    if goal.name:
        return list(named[checks.name(goal.name, "goal.name", allowed=named)].terms)
    checks.count(goal.terms, "goal.terms", least=1, most=MOST_STATEMENTS)
    return [_statement(term, variables, f"goal.terms[{i}]") for i, term in enumerate(goal.terms)]


def _statement(term: msg.GoalTerm, variables: Sequence[str], where: str) -> GoalStatement:
    variable = checks.name(term.variable, f"{where}.variable", allowed=variables)
    value, low, high = (
        checks.number(getattr(term, name), f"{where}.{name}", low=-FARTHEST, high=FARTHEST)
        for name in ("value", "low", "high")
    )
    if low > high:
        raise MessageError(f"{where}: expected low <= high, got low {low:g} and high {high:g}")
    unspecified = low == high == 0.0
    if not term.relative_to:
        return Unspecified(variable, value) if unspecified else Region(variable, value, low, high)
    other = checks.name(term.relative_to, f"{where}.relative_to", allowed=variables)
    if other == variable:
        raise MessageError(f"{where}.relative_to: expected another variable, got {quoted(other)}")
    if not unspecified:
        return Region(variable, other, value + low, value + high)
    if value != 0.0:
        expected = "expected low and high of a value relative to another variable"
        raise MessageError(f"{where}: {expected}, got none")
    return Unspecified(variable, other)


def objective_from(objective: msg.Objective, failure_cost: float = 0.0) -> Objective:
    """Read an objective.

    A `success` below 0 stands for `failure_cost` (s), where models predict it.
    """
    weights = {
        name: float(getattr(objective, name)) for name in objective.get_fields_and_field_types()
    }
    optional = frozenset({"success"} if weights["success"] < 0.0 else ())
    try:
        return Objective(weights | dict.fromkeys(optional, failure_cost), optional)
    except RefinementError as error:
        raise MessageError(str(error)) from error


def performance_of(values: Mapping[str, float] | None = None) -> msg.Performance:
    """Write a performance; fields that are not among `values` are NaN."""
    names = msg.Performance.get_fields_and_field_types()
    return msg.Performance(**{name: float((values or {}).get(name, math.nan)) for name in names})


# Answers of refinement


def answer_of(
    choice: Selection,
    request: RefineSubgoal.Request,
    gain: msg.Gain,
    *,
    reason: str,
    action_set: str,
    frame: str,
) -> RefineSubgoal.Response:
    """Write the answer to a request, with a reason that is cut to one line."""
    refinement = choice.refinement
    before = refinement.before
    after = refinement.after
    response = RefineSubgoal.Response(
        accepted=True,
        refined=refinement.refined,
        cut_short=not choice.complete,
        reason=one_line(reason),
        chain=chain_of(refinement.chain, action_set=action_set, frame=frame),
        original=chain_of(refinement.original, action_set=action_set, frame=frame),
        order=refinement.chain.order,
        original_order=refinement.original.order,
        best_order=refinement.best.order,
        free=_free_variables(refinement),
        not_free=[
            msg.NotFree(subgoal=n.subgoal, name=n.name, reason=one_line(n.reason))
            for n in refinement.not_free
        ],
        before=chain_performance_of(before),
        after=chain_performance_of(after),
        before_actions=[performance_of(action) for action in before.actions],
        after_actions=[performance_of(action) for action in after.actions],
        gain=gain,
        cost_before=before.cost,
        cost_after=after.cost,
        curves=[_curve(curve) for curve in refinement.curves if request.want_curve],
    )
    if request.alternatives:
        response.chosen = choice.number
        others = (msg.TopChain(calls=each.calls) for each in request.alternatives)
        sent = (request.chain, *others)
        response.alternatives = [
            _alternative(judged, chain, action_set=action_set, frame=frame)
            for judged, chain in zip(choice.judged, sent, strict=True)
        ]
    return response


def _alternative(
    judged: Judged, sent: msg.TopChain, *, action_set: str, frame: str
) -> msg.Alternative:
    if isinstance(judged, str):
        return msg.Alternative(
            reason=one_line(judged), chain=sent, predicted=performance_of(), cost=math.nan
        )
    return msg.Alternative(
        accepted=True,
        complete=judged.complete,
        reason=one_line(judged.reason),
        chain=chain_of(judged.chain, action_set=action_set, frame=frame),
        order=judged.chain.order,
        predicted=chain_performance_of(judged.predicted),
        cost=judged.predicted.cost,
    )


def refused(reason: str, chain: msg.TopChain) -> RefineSubgoal.Response:
    """Write the answer to a request that cannot be evaluated, with its `chain`."""
    chain = chain_to_return(chain)
    response = RefineSubgoal.Response(reason=reason, chain=chain, original=chain, gain=gain_of())
    response.before = response.after = performance_of()
    response.cost_before = response.cost_after = math.nan
    return response


def chain_performance_of(prediction: ChainPrediction | None) -> msg.Performance:
    """Write the predicted performance of a chain."""
    if prediction is None:
        return performance_of()
    success = math.prod(action.get("success", math.nan) for action in prediction.actions)
    spread = prediction.spread if math.isfinite(prediction.duration) else math.nan
    return performance_of(
        {
            "duration": prediction.duration,
            "spread": spread,
            "bound": prediction.bound,
            "success": success,
        }
    )


def gain_of(
    refinement: Refinement | None = None, measured: MeasuredGain | None = None, models: str = ""
) -> msg.Gain:
    """Write the predicted gain of a refinement, and the gain measured with `models`.

    NaN if unknown.
    """
    unknown = ("predicted", "uncertainty", "measured", "measured_low", "measured_high")
    gain = msg.Gain(models=models, **dict.fromkeys(unknown, math.nan))
    if refinement is not None and refinement.free:
        gain.predicted = refinement.saved
        gain.uncertainty = refinement.uncertainty
        gain.comparison = refinement.comparison
    if measured is not None:
        gain.refined = measured.refined
        gain.compared = measured.compared
        gain.measured = measured.mean
        gain.measured_low = measured.low
        gain.measured_high = measured.high
    return gain


def _free_variables(refinement: Refinement) -> list[msg.FreeVariable]:
    before = refinement.original
    after = refinement.best
    return [
        msg.FreeVariable(
            subgoal=variable.subgoal,
            name=variable.name,
            before=goal_values(before.sent(variable.subgoal).goal)[variable.name],
            after=goal_values(after.sent(variable.subgoal).goal)[variable.name],
            low=variable.domain.span[0],
            high=variable.domain.span[1],
            limits=_bounded(variable.limits),
        )
        for variable in refinement.free
    ]


def _bounded(texts: Sequence[str]) -> list[str]:
    """Return texts, of which the last one counts those above `_MOST_LIMITS`."""
    if len(texts) <= _MOST_LIMITS:
        return list(texts)
    shown = texts[: _MOST_LIMITS - 1]
    return [*shown, f"and {len(texts) - len(shown)} more"]


def _curve(curve: SubgoalCurve) -> msg.SearchCurve:
    values = np.ravel(curve.values).tolist()
    totals = np.ravel(curve.totals).tolist()
    return msg.SearchCurve(
        subgoal=curve.subgoal, variables=list(curve.names), values=values, totals=totals
    )
