"""The process of one round of learning, which the node `learning` starts."""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path

import rclpy

from ator_ros.domains.domain import domain_for
from ator_ros.experience.parallel import end_with_parent
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.learning.drive_monitor import driven_on
from ator_ros.learning.round import Source, learn
from ator_ros.nodes.path_planner import planned_by

_NICE = 15  # of 19: every other program goes first


def main() -> None:
    """Execute one round at the lowest priority, and write its result as JSON to standard output.

    The only argument is a JSON object: `learned`, the folder of records; `domain`, `robot`,
    `models`, `map`, `planner`, `watched` and `frame` as the parameters of the node; `time`, the
    time stamp of the new set of models; `parent`, the process of the node. It ends with the node,
    also if that is killed.
    """
    given: dict[str, str] = json.loads(sys.argv[1])
    end_with_parent(int(given["parent"]))
    os.nice(_NICE)
    # Linux weighs sessions before processes, and this process has its own session
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(_NICE), encoding="ascii")
    domain = domain_for(given["domain"], given["robot"]).on_map(given["map"])
    if given["planner"]:
        rclpy.init()
        domain = planned_by(given["planner"], given["frame"], domain)
    if given["watched"]:
        domain = driven_on(WatchedPaths(Path(given["watched"]) / PATHS), domain)
    robot = domain.robot(given["robot"] or None)
    models = domain.models_root(given["models"])
    source = Source(Path(given["learned"]), domain, robot, models)
    sys.stdout.write(json.dumps(learn(source, time=given["time"]), allow_nan=False))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
