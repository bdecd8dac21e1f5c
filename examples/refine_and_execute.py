"""A client that has a chain refined, prints the answer, and has it executed.

    ros2 launch ator_ros ator.launch.xml
    python3 examples/refine_and_execute.py

The nodes must run. The program needs rclpy and ator_interfaces. Before a second run, reset the
simulation: `python3 examples/call.py /reset std_srvs/srv/Trigger`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import rclpy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, ObjectState, Outcome, Situation, TopCall, TopChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.leases import publish_lease

_TIMEOUT = 60.0  # s


def pose(x: float, y: float, yaw: float) -> Pose:
    """Return a pose in m and rad."""
    turn = Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
    return Pose(position=Point(x=float(x), y=float(y)), orientation=turn)


def request() -> RefineSubgoal.Request:
    """Return the README's request: go to the ball with an open heading, and dribble it."""
    approach = TopCall(top="goToBall", goal=PoseStamped(pose=pose(0.0, 0.0, 0.0)), open=["yaw"])
    dribble = TopCall(top="dribbleBall", goal=PoseStamped(pose=pose(0.0, 2.0, math.pi / 2.0)))
    start = Situation(robot=pose(-2.0, 0.0, 0.0), objects=[ObjectState(name="ball")])
    return RefineSubgoal.Request(situation=start, chain=TopChain(calls=[approach, dribble]))


def answered(node: Node, kind: Any, service: str, request: Any) -> Any:
    """Return the answer of a service."""
    client = node.create_client(kind, service)
    if not client.wait_for_service(timeout_sec=_TIMEOUT):
        raise TimeoutError(f"{service}: expected the service within {_TIMEOUT:g} s, found none")
    return _waited(node, client.call_async(request), service)


def executed(node: Node, goal: ExecuteChain.Goal) -> ExecuteChain.Result:
    """Have a goal executed; return its result."""
    client = ActionClient(node, ExecuteChain, "execute_chain")
    if not client.wait_for_server(timeout_sec=_TIMEOUT):
        raise TimeoutError(f"execute_chain: expected the action within {_TIMEOUT:g} s, found none")
    goal.lease = publish_lease(node)  # the goal ends with this program
    handle = _waited(
        node, client.send_goal_async(goal, feedback_callback=_print_feedback), "execute_chain"
    )
    return _waited(node, handle.get_result_async(), "the end of the chain").result


def report(record: ChainPerformance, *, refined: bool) -> str:
    """Return the duration of the executed chain, and goal and duration of each step."""
    if not record.actions:
        return f"not executed: {record.outcome.reason}"
    kind = "refined" if refined else "naive"
    first = f"executed the {kind} chain in {record.actual.duration:.2f} s: {record.outcome.reason}"
    steps = []
    for action in record.actions:
        pose = action.call.goal.pose
        yaw = math.degrees(2.0 * math.atan2(pose.orientation.z, pose.orientation.w))
        goal = f"({pose.position.x:.2f}, {pose.position.y:.2f}), heading {yaw:.0f} deg"
        steps.append(
            f"  step {action.step + 1}, {action.call.top}: goal {goal}, "
            f"speed {action.call.speed:.2f} m/s, "
            f"took {action.actual.duration:.2f} s"
        )
    return "\n".join([first, *steps])


def _print_feedback(message: Any) -> None:
    now = message.feedback
    print(f"  {now.elapsed:5.2f} s: step {now.step + 1} of {now.steps}, {now.top}: {now.status}")


def _waited(node: Node, future: Future, what: str) -> Any:
    """Spin the node until an answer is received."""
    rclpy.spin_until_future_complete(node, future, timeout_sec=_TIMEOUT)
    if not future.done():
        raise TimeoutError(f"{what}: expected an answer within {_TIMEOUT:g} s, got none")
    return future.result()


def refine_and_execute(node: Node) -> int:
    """Have the chain refined and executed; return the exit code."""
    answer = answered(node, RefineSubgoal, "refine_subgoal", request())
    print(f"refined: {answer.refined}, {answer.reason}")
    change = "changed to" if answer.refined else "unchanged; best would be"
    for free in answer.free:
        print(
            f"  {free.name} of step {free.subgoal + 1}: {free.before:.2f} {change} {free.after:.2f}"
        )
    if not answer.accepted:
        return 1
    print(f"predicted: {answer.before.duration:.2f} s before, {answer.after.duration:.2f} s after")
    # refine=True would refine the chain again, from the robot's pose at that time
    result = executed(node, ExecuteChain.Goal(chain=answer.chain))
    print(report(result.record, refined=answer.refined))
    return 0 if result.outcome.code == Outcome.SUCCEEDED else 1


def run(client: Callable[[Node], int]) -> int:
    """Run a client on a node with its name; return the exit code."""
    rclpy.init()
    node = rclpy.create_node(client.__name__)
    try:
        return client(node)
    except TimeoutError as error:
        print(f"{client.__name__}: {error}", file=sys.stderr)
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(run(refine_and_execute))
