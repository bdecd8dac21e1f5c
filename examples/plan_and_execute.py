"""A client that requests chains for a goal and has the best one executed.

    ros2 launch ator_ros ator.launch.xml
    python3 examples/plan_and_execute.py ball_in_goal

The nodes must run. The program needs rclpy, ator_interfaces and the example `refine_and_execute`.
"""

from __future__ import annotations

import sys
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.wait_for_message import wait_for_message
from refine_and_execute import answered, executed, run

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import AlternativeChain, ObjectState, Outcome, PlanGoal, Situation
from ator_interfaces.srv import PlanChains

_TIMEOUT = 120.0  # s


def situation(node: Node) -> Situation:
    """Return the current state of robot and ball."""
    robot, ball = _message(node, "odom"), _message(node, "ball")
    moving = robot.twist.twist
    position, velocity = ball.pose.pose.position, ball.twist.twist.linear
    objects = [ObjectState(name="ball", position=position, velocity=velocity)]
    return Situation(
        robot=robot.pose.pose,
        vx=moving.linear.x,
        vy=moving.linear.y,
        w=moving.angular.z,
        objects=objects,
    )


def _message(node: Node, topic: str) -> Any:
    found, message = wait_for_message(Odometry, node, topic, time_to_wait=_TIMEOUT)
    if not found:
        raise TimeoutError(f"{topic}: expected a message within {_TIMEOUT:g} s, got none")
    return message


def plan_and_execute(node: Node) -> int:
    """Plan for the goal that the command line names, and execute the plan; return the exit code."""
    goal = PlanGoal(name=sys.argv[1] if len(sys.argv) > 1 else "ball_in_goal")
    answer = answered(
        node, PlanChains, "plan_chains", PlanChains.Request(situation=situation(node), goal=goal)
    )
    print(f"planned: {answer.reason}")
    for chain in answer.chains:
        print(f"  {', '.join(call.top for call in chain.calls)}")
    if not answer.chains:
        return 0 if answer.holds else 1
    first = answer.chains[0]
    others = [AlternativeChain(calls=chain.calls) for chain in answer.chains[1:]]
    # The executor refines all chains and executes the one with the best prediction.
    result = executed(node, ExecuteChain.Goal(chain=first, alternatives=others, refine=True))
    steps = ", ".join(call.top for call in result.record.chain.calls)
    print(f"executed: {steps} in {result.record.actual.duration:.2f} s: {result.outcome.reason}")
    return 0 if result.outcome.code == Outcome.SUCCEEDED else 1


if __name__ == "__main__":
    sys.exit(run(plan_and_execute))
