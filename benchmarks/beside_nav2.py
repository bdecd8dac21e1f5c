"""Drive as a client of Nav2 commands it, with the node `watch` beside, and print its errors.

    scripts/run python benchmarks/beside_nav2.py --drives 70 --seed 1 --factor 5 --work beside

It starts `ator_ros_examples.nav2_stand_in` (nav2_msgs must be installed), and beside it `watch` and
`learning`, with what `nav2_setup` finds out. The goals are random places of the domain `building`,
with paths of at most 12 m.
Errors are those of the estimate at the start of a drive, in s; the CPU time is that of `watch`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.node import Node

from ator_interfaces.msg import ActionPerformance, DriveEstimate, Outcome, WatchedDrives
from ator_ros.actions.situation import Situation
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import LATCHED, RESULTS, SENSOR_DATA
from ator_ros.nodes.remote_messages import action_type
from ator_ros.performance.accuracy import mean_ci95
from ator_ros_examples.nav2_stand_in import START
from ator_ros_examples.stand_ins import navfn

_PATIENCE = 60.0  # real s
_LONGEST = 12.0  # m, of a path; drives take 15 s on average
_TICKS = os.sysconf("SC_CLK_TCK")


class Client(Node):  # type: ignore[misc]
    """Sends drives to navigate_to_pose one after the other, and receives the estimates."""

    def __init__(self) -> None:
        super().__init__("client")
        self.estimates: list[DriveEstimate] = []
        self.records: list[ActionPerformance] = []
        self.tallies: list[WatchedDrives] = []
        self.has_odometry = False
        self._navigate = ActionClient(
            self, action_type("nav2_msgs/action/NavigateToPose"), "navigate_to_pose"
        )
        self.create_subscription(DriveEstimate, "watch/estimates", self.estimates.append, RESULTS)
        self.create_subscription(ActionPerformance, "watch/action", self.records.append, RESULTS)
        self.create_subscription(WatchedDrives, "watch/drives", self.tallies.append, LATCHED)
        self.create_subscription(Odometry, "odom", self._take_odometry, SENSOR_DATA)

    def _take_odometry(self, _: Odometry) -> None:
        self.has_odometry = True

    def wait(self, future: Any) -> Any:
        """Return what a future becomes."""
        rclpy.spin_until_future_complete(self, future, timeout_sec=10.0 * _PATIENCE)
        return future.result()

    def drive(self, goal: Any) -> str:
        """Drive to a pose; return the goal's id."""
        assert self._navigate.wait_for_server(_PATIENCE)
        stamped = PoseStamped(pose=pose_of(goal))
        stamped.header.frame_id = "map"
        kind = action_type("nav2_msgs/action/NavigateToPose")
        handle = self.wait(self._navigate.send_goal_async(kind.Goal(pose=stamped)))
        self.wait(handle.get_result_async())
        return bytes(handle.goal_id.uuid).hex()


def start(*words: str, log: Path) -> subprocess.Popen[bytes]:
    """Start a process with its output in a file."""
    with log.open("wb") as output:
        return subprocess.Popen(words, stdout=output, stderr=subprocess.STDOUT)


def executable(name: str) -> str:
    """Return the path of one of our nodes."""
    return str(Path(get_package_prefix("ator_ros"), "lib", "ator_ros", name))


def cpu_time(process: subprocess.Popen[bytes]) -> float:
    """Return the CPU time of a process in s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def near_goal(draw: Callable[[], Situation], planner: Any, place: tuple[float, float]) -> Pose:
    """Draw situations until their goal is not far from a place; return that goal."""
    while True:
        goal = draw().goal.pose
        path = planner(place, goal[:2])
        if path is not None and np.hypot(*np.diff(path, axis=0).T).sum() <= _LONGEST:
            return goal


def await_round(client: Client, log: Path) -> None:
    """Wait until a round of learning has ended after each ten records.

    It has the lowest priority, and more time on a robot, which does not drive so fast.
    """
    end = time.monotonic() + 2.0 * _PATIENCE
    due = len(client.records) // 10
    while log.read_text().count("/navigate_to_pose:") < due and time.monotonic() < end:
        rclpy.spin_once(client, timeout_sec=0.5)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=70)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--factor", type=float, default=5.0, help="simulated s per s")
    parser.add_argument(
        "--idle", type=float, default=0.0, help="real s after the drives, for savings of rounds"
    )
    parser.add_argument("--work", type=Path, required=True, help="a new folder")
    options = parser.parse_args(argv)
    options.work.mkdir(parents=True)
    work = options.work
    factor = ("--ros-args", "-p", f"real_time_factor:={options.factor}")
    stand_in = (sys.executable, "-m", "ator_ros_examples.nav2_stand_in", *factor)
    processes = [start(*stand_in, log=work / "stand_in.log")]
    setup = (sys.executable, "-m", "ator_ros.start", "commands.nav2_setup", "--folder", str(work))
    folder = subprocess.run(setup, capture_output=True, text=True, check=True).stdout
    words = ("--ros-args", "--params-file", f"{folder}/nav2.yaml")
    processes += [
        start(executable(name), *words, log=work / f"{name}.log") for name in ("watch", "learning")
    ]
    rclpy.init()
    client = Client()
    drives = []
    building = find_domain("building")
    robot = building.robot()
    rng = np.random.default_rng(options.seed)
    spec = building.actions()["pursue"]
    assert robot.grid is not None
    planner = navfn(robot.grid, robot)
    place = START[:2]
    try:
        while not client.has_odometry:
            rclpy.spin_once(client, timeout_sec=0.1)
        end = time.monotonic() + _PATIENCE
        while "watching" not in (work / "watch.log").read_text() and time.monotonic() < end:
            rclpy.spin_once(client, timeout_sec=0.1)
        spent = took = 0.0
        for _ in range(options.drives):
            goal = near_goal(partial(spec.situation, robot, rng), planner, place)
            place = goal[:2]
            begin = time.monotonic()
            used = cpu_time(processes[1])
            drives.append(client.drive(goal))
            spent += cpu_time(processes[1]) - used
            took += time.monotonic() - begin
            await_round(client, work / "learning.log")
        end = time.monotonic() + options.idle
        while time.monotonic() < end:
            rclpy.spin_once(client, timeout_sec=0.1)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        client.destroy_node()
        rclpy.try_shutdown()
    report(client, work)
    print(
        f"watch used {spent / took:.1%} of a core while the robot drove, at {options.factor:g} "
        "times real time"
    )
    return 0


def report(client: Client, work: Path) -> None:
    """Print errors by number of drives, and how estimates moved on the way."""
    by_goal: dict[str, list[DriveEstimate]] = {}
    for estimate in client.estimates:
        by_goal.setdefault(estimate.goal_id, []).append(estimate)
    rows = []
    beyond = []
    for number, record in enumerate(client.records):
        estimates = by_goal.get(record.chain_id, [])
        if not estimates or record.outcome.code != Outcome.SUCCEEDED:
            continue
        duration = record.actual.duration
        totals = [each.total for each in estimates]
        rows.append((number, duration, totals[0] - duration, estimates[0].elapsed))
        for before, after in itertools.pairwise(totals):
            beyond.append(abs(after - before) - abs(before - duration))
    (work / "drives.json").write_text(json.dumps(rows))
    table = np.array(rows)
    count = len(client.records)
    print(f"{len(rows)} of {count} drives, of {table[:, 1].mean():.1f} s on average")
    moved = np.array(beyond)
    print(
        f"of {len(moved)} updates {np.mean(moved > 0.05):.1%} moved more than 0.05 s beyond the "
        f"error before, at most by {moved.max():.2f} s"
    )
    delays = table[:, 3]
    print(f"first estimates {delays.mean():.2f} s after the start, at most {delays.max():.2f} s")
    for low, high in ((0, 20), (20, 40), (40, 70), (70, count)):
        errors = np.abs(table[(table[:, 0] >= low) & (table[:, 0] < high), 2])
        if len(errors) > 1:
            between = " to ".join(f"{value:.2f}" for value in mean_ci95(errors))
            print(f"drives {low + 1} to {high}: {errors.mean():.2f} s ({between})")
    tally = client.tallies[-1]
    for name in ("headings", "passing", "order"):
        saving = getattr(tally, name)
        between = f"({saving.low:.0f} to {saving.high:.0f})"
        print(f"{name}: {saving.saving:.0f} s {between} of {tally.driven:.0f} s driven")


if __name__ == "__main__":
    sys.exit(main())
