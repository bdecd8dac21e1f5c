"""Replay a recording of plain Nav2 as the node `watch` receives it, and print its errors.

    scripts/run python benchmarks/watched.py RECORDING --domain stations.yaml \
        --robot courier.yaml --map rooms.yaml

Rounds of learning begin after every ten drives, as beside the node; each drive is estimated by what
was learned before it. Errors are those of the estimate at the start of a drive, in s.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.available_models import with_path_times
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.experience.bag_files import Bag
from ator_ros.experience.server_drives import ODOM, TF
from ator_ros.experience.server_goals import PLAN, ServerGoal
from ator_ros.experience.store import RecordStore, StoreInfo
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.geometry import FloatArray
from ator_ros.learning.drive_monitor import DriveMonitor, EndedDrive, driven_on
from ator_ros.learning.estimates import Estimate
from ator_ros.learning.round import Source, learn
from ator_ros.learning.sets import RECORDS, publish
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.performance.model_file import load_models

BATCH = 10  # drives after which a round of learning begins, as config/nav2/nav2.yaml says
FIRST = 20  # drives before the first model
_PERIOD = 0.5  # s between two estimates


class Replay:
    """Feeds a monitor with a recording, and learns from its drives in `folder`."""

    def __init__(self, domain: Domain, robot: str, folder: Path) -> None:
        self._folder = folder
        self._file = robot
        self._domain = domain
        paths = WatchedPaths(folder / PATHS)
        self.monitor = DriveMonitor(domain.robot(robot), domain, "map", paths)
        self._robot = self.monitor.domain.robot(robot)
        info = StoreInfo(self._robot.digest(), domain.name)
        models = with_path_times({}, self.monitor.domain, self._robot, DEFAULT_SET)
        self.monitor.use(models, "")
        self._store = RecordStore(folder / RECORDS, info, most=10_000)
        self.drives: list[EndedDrive] = []
        self.estimates: dict[bytes, list[tuple[ServerGoal, Estimate]]] = {}
        self.by_speed: dict[bytes, float] = {}
        """By goal: the length of its path by the speed of former drives, in s."""
        self._lengths: dict[bytes, float] = {}
        self._driven = np.array([0.0, 0.0])  # m and s
        self._estimated_at = 0.0

    def add(self, role: str, message: object) -> None:
        """Add a message, and do what is due then."""
        self.monitor.watch.add(role, message)
        now = self.monitor.watch.now
        if role == PLAN or now - self._estimated_at >= _PERIOD:
            self._estimated_at = now
            for goal, estimate in self.monitor.estimates():
                if goal.goal_id not in self.estimates:
                    self.by_speed[goal.goal_id] = self._length_by_speed(goal)
                self.estimates.setdefault(goal.goal_id, []).append((goal, estimate))
        for drive in self.monitor.ended():
            self.drives.append(drive)
            if drive.episode is not None:
                self._driven += self._lengths.get(drive.goal.goal_id, 0.0), drive.duration
                self._store.append(DEFAULT_SET, drive.episode)
                if self._store.stored >= FIRST and self._store.stored % BATCH == 0:
                    self._learn()

    def _length_by_speed(self, goal: ServerGoal) -> float:
        assert goal.first_path is not None
        length = float(np.hypot(*np.diff(goal.first_path, axis=0).T).sum())
        self._lengths[goal.goal_id] = length
        driven, seconds = self._driven
        return length * seconds / driven if driven else length / self._robot.greatest_speed()

    def _learn(self) -> None:
        domain = driven_on(WatchedPaths(self._folder / PATHS), self._domain)
        robot = domain.robot(self._file)
        source = Source(self._folder, domain, robot, self._folder / "none")
        result = learn(source, time="2026-01-01T00:00:00Z")
        if not result["made"]:
            return
        place = publish(self._folder, Path(result["made"]))
        models = load_models(self._robot, self.monitor.domain.known_features, folder=place)
        self.monitor.use(models, f"{self._store.stored} drives")


def _shown(errors: FloatArray) -> str:
    if len(errors) < 2:
        return "none"
    low, high = mean_ci95(np.abs(errors))
    return f"{np.abs(errors).mean():.2f} s ({low:.2f} to {high:.2f})"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--domain", required=True)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--map", required=True)
    parser.add_argument("--server", default="/navigate_to_pose")
    options = parser.parse_args(argv)
    domain = find_domain(options.domain).on_map(options.map)
    roles = {f"/{name}": name for name in (ODOM, *TF, PLAN)}
    for suffix in ("/_action/status", "/_action/feedback"):
        roles[f"{options.server}{suffix}"] = f"{options.server.lstrip('/')}{suffix}"
    files = sorted(options.recording.glob("*.mcap"))
    with tempfile.TemporaryDirectory() as folder:
        replay = Replay(domain, options.robot, Path(folder))
        with Bag(files) as bag:
            topics = [topic for topic in bag.topics if topic[0] in roles]
            for (name, _), message in bag.messages(topics):
                replay.add(roles[name], message)
    report(replay)
    return 0


def report(replay: Replay) -> None:
    """Print errors by number of drives, and how estimates moved on the way."""
    arrived = [each for each in replay.drives if each.episode is not None and each.first]
    durations = np.array([drive.duration for drive in arrived])
    first = np.array([drive.first.total for drive in arrived if drive.first]) - durations
    without = np.array([replay.by_speed[drive.goal.goal_id] for drive in arrived]) - durations
    server = [np.array(drive.goal.server_estimates) - drive.duration for drive in arrived]
    print(f"{len(arrived)} of {len(replay.drives)} drives, of {durations.mean():.1f} s on average")
    for low, high in ((0, 20), (20, 40), (40, len(arrived))):
        print(
            f"drives {low + 1} to {high}: estimates {_shown(first[low:high])}, "
            f"length by speed {_shown(without[low:high])}, "
            f"Nav2's on the way {_shown(np.concatenate(server[low:high]))}"
        )
    beyond = []
    for drive in arrived:
        totals = [found.total for _, found in replay.estimates[drive.goal.goal_id]]
        for before, after in itertools.pairwise(totals):
            beyond.append(abs(after - before) - abs(before - drive.duration))
    moved = np.array(beyond)
    print(
        f"of {len(moved)} updates {np.mean(moved > 0.05):.1%} moved more than 0.05 s beyond the "
        f"error before, at most by {moved.max():.2f} s"
    )


if __name__ == "__main__":
    sys.exit(main())
