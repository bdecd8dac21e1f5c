"""A client of your own: have a chain refined, look at the answer, have it executed.

    ros2 launch ator_ros ator.launch.xml
    python3 examples/refine_and_execute.py

The nodes must run. The program needs rclpy and the interfaces, and nothing else of ator_ros. Before it runs
again, put everything back: `python3 examples/call.py /reset std_srvs/srv/Trigger`.
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

_PATIENCE = 60.0  # s


def pose(x: float, y: float, yaw: float) -> Pose:
    """Return a pose in m and rad."""
    turn = Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
    return Pose(position=Point(x=x, y=y), orientation=turn)


def request() -> RefineSubgoal.Request:
    """Return the README's request: fetch what lies at the origin, with an open heading, and bring it."""
    fetch = TopCall(top="goToBall", goal=PoseStamped(pose=pose(0.0, 0.0, 0.0)), open=["yaw"])
    bring = TopCall(top="dribbleBall", goal=PoseStamped(pose=pose(0.0, 2.0, math.pi / 2.0)))
    start = Situation(robot=pose(-2.0, 0.0, 0.0), objects=[ObjectState(name="ball")])
    return RefineSubgoal.Request(situation=start, chain=TopChain(calls=[fetch, bring]))


def answered(node: Node, kind: Any, service: str, request: Any) -> Any:
    """Return the answer of a service of the refinement node."""
    client = node.create_client(kind, service)
    if not client.wait_for_service(timeout_sec=_PATIENCE):
        raise TimeoutError(f"{service}: expected the service, found none")
    return _waited(node, client.call_async(request), service)


def executed(node: Node, goal: ExecuteChain.Goal) -> ExecuteChain.Result:
    """Have the executor execute a goal to its end."""
    client = ActionClient(node, ExecuteChain, "execute_chain")
    if not client.wait_for_server(timeout_sec=_PATIENCE):
        raise TimeoutError("execute_chain: expected the action, found none")
    handle = _waited(node, client.send_goal_async(goal, feedback_callback=_print_feedback), "execute_chain")
    return _waited(node, handle.get_result_async(), "the end of the chain").result


def report(record: ChainPerformance, *, refined: bool) -> str:
    """Return what was executed: the chain and its duration, then each step with its goal."""
    kind = "refined" if refined else "naive"
    first = f"executed the {kind} chain in {record.actual.duration:.2f} s: {record.outcome.reason}"
    steps = []
    for action in record.actions:
        pose = action.call.goal.pose
        yaw = math.degrees(2.0 * math.atan2(pose.orientation.z, pose.orientation.w))
        place = f"({pose.position.x:.2f}, {pose.position.y:.2f}), heading {yaw:.0f} deg"
        steps.append(
            f"  step {action.step + 1}, {action.call.top}: goal {place}, speed {action.call.speed:.2f} m/s, "
            f"took {action.actual.duration:.2f} s"
        )
    return "\n".join([first, *steps])


def _print_feedback(message: Any) -> None:
    now = message.feedback
    print(f"  {now.elapsed:5.2f} s: step {now.step + 1} of {now.steps}, {now.top}: {now.status}")


def _waited(node: Node, future: Future, what: str) -> Any:
    """Spin the node until an answer is received."""
    rclpy.spin_until_future_complete(node, future, timeout_sec=_PATIENCE)
    if not future.done():
        raise TimeoutError(f"{what}: expected an answer within {_PATIENCE:g} s, got none")
    return future.result()


def refine_and_execute(node: Node) -> int:
    """Have the chain refined and executed; return the exit code."""
    answer = answered(node, RefineSubgoal, "refine_subgoal", request())
    print(f"refined: {answer.refined}, {answer.reason}")
    becomes = "becomes" if answer.refined else "stays; best would be"
    for free in answer.free:
        print(f"  {free.name} of step {free.subgoal + 1}: {free.before:.2f} {becomes} {free.after:.2f}")
    if not answer.accepted:
        return 1
    print(f"predicted: {answer.before.duration:.2f} s before, {answer.after.duration:.2f} s after")
    # refine=True would refine it again, from where the robot is then
    result = executed(node, ExecuteChain.Goal(chain=answer.chain))
    print(report(result.record, refined=answer.refined))
    return 0 if result.outcome.code == Outcome.SUCCEEDED else 1


def run(client: Callable[[Node], int]) -> int:
    """Run a client on a node of its name; return the exit code."""
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
