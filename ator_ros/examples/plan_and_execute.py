"""A client of your own: ask for the chains that reach a goal, have the best executed.

    ros2 launch ator_ros ator.launch.xml
    python3 -m ator_ros.examples.plan_and_execute ball_in_goal

The nodes must run. The program needs rclpy and the interfaces, and nothing else of ator_ros.
"""

from __future__ import annotations

import sys
from typing import Any

import rclpy
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from rclpy.wait_for_message import wait_for_message

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ObjectState, Outcome, PlanGoal, Situation
from ator_interfaces.srv import PlanChains

_PATIENCE = 120.0  # s


def situation(node: Node) -> Situation:
    """Return where the robot and the ball are now."""
    robot, ball = _message(node, "odom"), _message(node, "ball")
    twist = robot.twist.twist
    position, velocity = ball.pose.pose.position, ball.twist.twist.linear
    objects = [ObjectState(name="ball", position=position, velocity=velocity)]
    return Situation(robot=robot.pose.pose, v=twist.linear.x, w=twist.angular.z, objects=objects)


def planned(node: Node, goal: str) -> PlanChains.Response:
    """Ask the refinement node for the chains that reach a goal which the domain names."""
    client = node.create_client(PlanChains, "plan_chains")
    if not client.wait_for_service(timeout_sec=_PATIENCE):
        raise TimeoutError("plan_chains: expected the service, found none")
    request = PlanChains.Request(situation=situation(node), goal=PlanGoal(name=goal))
    return _waited(node, client.call_async(request), "plan_chains")


def executed(node: Node, answer: PlanChains.Response) -> ExecuteChain.Result:
    """Have the executor refine the chains and execute the one that is predicted best."""
    client = ActionClient(node, ExecuteChain, "execute_chain")
    if not client.wait_for_server(timeout_sec=_PATIENCE):
        raise TimeoutError("execute_chain: expected the action, found none")
    first, *others = answer.chains
    goal = ExecuteChain.Goal(chain=first, alternatives=others, refine=True)
    handle = _waited(node, client.send_goal_async(goal), "execute_chain")
    return _waited(node, handle.get_result_async(), "the end of the chain").result


def _message(node: Node, topic: str) -> Any:
    found, message = wait_for_message(Odometry, node, topic, time_to_wait=_PATIENCE)
    if not found:
        raise TimeoutError(f"{topic}: expected a message, got none")
    return message


def _waited(node: Node, future: Future, what: str) -> Any:
    rclpy.spin_until_future_complete(node, future, timeout_sec=_PATIENCE)
    if not future.done():
        raise TimeoutError(f"{what}: expected an answer within {_PATIENCE:g} s, got none")
    return future.result()


def main() -> int:
    """Run the client; return the exit code."""
    rclpy.init()
    node = rclpy.create_node("plan_and_execute")
    try:
        answer = planned(node, sys.argv[1] if len(sys.argv) > 1 else "ball_in_goal")
        print(f"planned: {answer.reason}")
        for chain in answer.chains:
            print(f"  {', '.join(call.top for call in chain.calls)}")
        if not answer.chains:
            return 0 if answer.holds else 1
        result = executed(node, answer)
        steps = ", ".join(call.top for call in result.record.chain.calls)
        print(f"executed: {steps} in {result.record.actual.duration:.2f} s: {result.outcome.reason}")
        return 0 if result.outcome.code == Outcome.SUCCEEDED else 1
    except TimeoutError as error:
        print(f"plan_and_execute: {error}", file=sys.stderr)
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
