"""The process of one round of learning, which the node `learning` starts."""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path

import rclpy

from ator_ros.domains.domain import domain_for
from ator_ros.learning.round import Source, learn
from ator_ros.nodes.path_planner import planned_by

_NICE = 15


def main() -> None:
    """Execute one round at the lowest priority, and write its result to standard output.

    Arguments, in a JSON list: the folder of records, domain, robot, models, map, planner and frame as the
    parameters of the node name them, and the time.
    """
    os.nice(_NICE)
    with suppress(OSError):  # Linux weighs sessions before processes, and this process has its own session
        Path("/proc/self/autogroup").write_text(str(_NICE), encoding="ascii")
    folder, name, robot, models, grid, planner, frame, time = json.loads(sys.argv[1])
    domain = domain_for(name, robot).on_map(grid)
    if planner:
        rclpy.init()
        domain = planned_by(planner, frame, domain)
    source = Source(Path(folder), domain, domain.robot(robot or None), domain.models_root(models))
    sys.stdout.write(json.dumps(learn(source, time=time), allow_nan=False))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
