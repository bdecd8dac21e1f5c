"""Measure the nodes: requests per second, time to an answer, CPU shares, and time of a tick.

    scripts/run python benchmarks/nodes.py --out nodes.json

Use an idle machine. The script does not import ator_ros, so that one copy can measure any commit:
run it with the `scripts/run` of the checkout to measure.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import statistics
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Quaternion
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ObjectState, TopCall
from ator_interfaces.srv import PlaceObject, PlaceRobot, RefineSubgoal

NODES = ("simulation", "refinement", "executor")
TIMEOUT = 300.0  # s
SETTLING_TIME = 3.0  # s after which a started node is idle
TICKS = "99 % of the last 1000 ticks within (ms)"


def request() -> RefineSubgoal.Request:
    """Return a request of two steps: the heading at the ball before a dribble is open."""
    message = RefineSubgoal.Request()
    message.situation.robot.position.x = -2.0
    message.situation.robot.orientation.w = 1.0
    message.situation.objects = [ObjectState(name="ball")]
    approach = TopCall(top="goToBall", open=["yaw"])
    dribble = TopCall(top="dribbleBall")
    approach.goal.pose.orientation.w = 1.0
    dribble.goal.pose.position.x = 1.0
    dribble.goal.pose.position.y = 1.5
    dribble.goal.pose.orientation = Quaternion(z=0.7071067811865476, w=0.7071067811865476)
    message.chain.calls = [approach, dribble]
    return message


@contextmanager
def spun(name: str) -> Iterator[Node]:
    """Yield a node that a thread spins."""
    rclpy.init()
    node = Node(name)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stopping = threading.Event()

    def spin() -> None:
        while not stopping.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield node
    finally:
        stopping.set()
        thread.join()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for a condition; raise TimeoutError after `TIMEOUT`."""
    end = time.monotonic() + TIMEOUT
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"expected {what} within {TIMEOUT:g} s, got nothing")
        time.sleep(0.01)


def answer_times(number: int, seconds: float, results: Any) -> None:
    """Send requests one after the other for some seconds.

    The times in s and the number of failures are put into the queue `results`.
    """
    with spun(f"client{number}") as node:
        client = node.create_client(RefineSubgoal, "refine_subgoal")
        client.wait_for_service(TIMEOUT)
        client.call(request(), timeout_sec=5.0)
        times = []
        failures = 0
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            started = time.monotonic()
            answer = client.call(request(), timeout_sec=5.0)
            if answer is None or not answer.accepted:
                failures += 1
            else:
                times.append(time.monotonic() - started)
        results.put((times, failures))


def requests(clients: int, seconds: float) -> dict[str, float]:
    """Measure requests of several clients at once, each in its own process."""
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    processes = [
        context.Process(target=answer_times, args=(number, seconds, results))
        for number in range(clients)
    ]
    for process in processes:
        process.start()
    found = [results.get() for _ in processes]
    for process in processes:
        process.join()
    times: list[float] = []
    for times_of_client, _ in found:
        times += [1000.0 * each for each in times_of_client]
    times.sort()
    return {
        "requests per second": round(len(times) / seconds, 1),
        "median (ms)": round(statistics.median(times), 2),
        "99 % within (ms)": round(times[int(0.99 * len(times))], 2),
        "lost or refused": sum(failures for _, failures in found),
    }


def processor_time(pid: int) -> float:
    """Return the processor time in s that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def shares(pids: dict[str, int], work: Callable[[], None]) -> dict[str, float]:
    """Return the share of a core in % that each process uses during `work`."""
    before = {name: processor_time(pid) for name, pid in pids.items()}
    started = time.monotonic()
    work()
    took = time.monotonic() - started
    used = {name: processor_time(pid) - before[name] for name, pid in pids.items()}
    return {name: round(100.0 * seconds / took, 2) for name, seconds in used.items()}


class Driver:
    """Executes the chain of `request` repeatedly; another thread spins its node."""

    def __init__(self, node: Node) -> None:
        self.diagnosed = False
        self.ticks = ""
        self._robot = node.create_client(PlaceRobot, "place_robot")
        self._ball = node.create_client(PlaceObject, "place_ball")
        self._chains = ActionClient(node, ExecuteChain, "execute_chain")
        node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnostics, 10)

    def _diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/executor":
                self.diagnosed = True
                self.ticks = next(
                    (each.value for each in status.values if each.key == TICKS), self.ticks
                )

    def drive(self, times: int) -> None:
        """Place robot and ball and execute the chain, several times."""
        for _ in range(times):
            self._drive_once()

    def _drive_once(self) -> None:
        robot = PlaceRobot.Request()
        ball = PlaceObject.Request()
        robot.pose.pose = request().situation.robot
        self._robot.call(robot, timeout_sec=TIMEOUT)
        self._ball.call(ball, timeout_sec=TIMEOUT)
        time.sleep(0.3)
        goal = ExecuteChain.Goal(chain=request().chain, refine=True)
        sent = self._chains.send_goal_async(goal)
        until(sent.done, "an answer to the goal")
        result = sent.result().get_result_async()
        until(result.done, "a result")
        if result.result().status != GoalStatus.STATUS_SUCCEEDED:
            raise RuntimeError(result.result().result.outcome.reason)


def measure(seconds: float, chains: int) -> dict[str, Any]:
    """Measure everything with nodes of the installed package."""
    folder = Path(os.environ["ATOR_ROS_ROOT"], "install", "lib", "ator_ros")
    nodes = {name: subprocess.Popen([folder / name]) for name in NODES}
    pids = {name: process.pid for name, process in nodes.items()}
    try:
        with spun("driver") as node:
            driver = Driver(node)
            until(lambda: driver.diagnosed, "diagnostics of the executor")
            time.sleep(SETTLING_TIME)
            idle = shares(pids, lambda: time.sleep(seconds))
            driver.drive(1)
            driving = shares(pids, lambda: driver.drive(chains))
            time.sleep(SETTLING_TIME)
            ticks = driver.ticks
        return {
            "load before": round(os.getloadavg()[0], 1),
            "idle (% of a core)": idle,
            "driving (% of a core)": driving,
            TICKS: ticks,
            "one client": requests(1, seconds),
            "twenty clients": requests(20, seconds),
        }
    finally:
        for process in nodes.values():
            process.send_signal(signal.SIGINT)
        for process in nodes.values():
            process.wait()


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="of each measurement (default: 20)"
    )
    parser.add_argument("--chains", type=int, default=10, help="to execute (default: 10)")
    parser.add_argument("--domain", default="88", help="an unused ROS domain (default: 88)")
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options = parser.parse_args()
    os.environ["ROS_DOMAIN_ID"] = options.domain
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    text = json.dumps(measure(options.seconds, options.chains), indent=2)
    print(text)
    if options.out:
        options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
