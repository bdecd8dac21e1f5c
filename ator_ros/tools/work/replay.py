"""Play a recording on a page in the browser; nothing of it needs ROS."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from ator_ros.domains.domain import domain_for
from ator_ros.evaluation.running import RESULT
from ator_ros.experience.errors import ExperienceError
from ator_ros.simulation.urdf import WHEEL_NAMES, Wheels, robot_urdf
from ator_ros.tools.guard import EXPECTED_ERRORS, until_stopped
from ator_ros.viewing.recording_file import read_robots

if TYPE_CHECKING:  # viser may not be there
    from ator_ros.page.replay_page import ReplayPage

_PERIOD = 1.0 / 25.0


def run(options: argparse.Namespace) -> int:
    """Do what the command line asks for until Ctrl-C or SIGTERM; return the exit code."""
    return until_stopped("view", partial(_serve, options), EXPECTED_ERRORS)


def _serve(options: argparse.Namespace, going_on: Callable[[], None]) -> None:
    from ator_ros.page.replay_page import ReplayPage

    domain, file = domain_for(options.domain, options.robot), options.shown
    if not file.exists() or (file.is_dir() and not (file / "metadata.yaml").is_file()):
        raise ExperienceError(
            f"{file}: expected the folder of an evaluation, with {RESULT}, or a recording, "
            "an .mcap file or the folder that ros2 bag record made"
        )
    robot = domain.robot(options.robot or None)
    robots, left_out = read_robots(file, domain, going_on)
    if left_out:
        print(f"view: {left_out} chains are left out: their records make no sense", file=sys.stderr)
    page = ReplayPage(robots, domain, robot, robot_urdf(robot), host=options.host, port=options.port)
    try:
        print(
            f"view: open http://{options.host}:{page.server.get_port()} in a browser; Ctrl-C ends it",
            flush=True,
        )
        _loop(page, Wheels(robot), going_on)
    finally:
        page.close()


def _loop(page: ReplayPage, wheels: Wheels, going_on: Callable[[], None]) -> None:
    due = time.monotonic()
    while True:
        going_on()
        world = page.update(time.monotonic(), dict(zip(WHEEL_NAMES, wheels.angles, strict=True)))
        wheels.roll(world.time, world.robot.v, world.robot.w)
        due = max(due + _PERIOD, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
