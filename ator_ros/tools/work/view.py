"""Start a view: nodes of its own or nodes that run, the desk, the page, and the loop that joins them."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from ator_ros.domains.domain import Domain, DomainError, domain_for
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.nodes.parameters import SetupError
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import ModelFileError, load_models
from ator_ros.robot.description import Robot
from ator_ros.simulation.urdf import WHEEL_NAMES, Wheels, robot_urdf
from ator_ros.tools.guard import EXPECTED_ERRORS, until_stopped
from ator_ros.tools.processes import all_nodes
from ator_ros.viewing.desk import Desk
from ator_ros.viewing.stage import NO_STAGES, StageError
from ator_ros.viewing.worst import worst_trials

_PERIOD = 1.0 / 25.0
_ROUNDS = 2
"""Rounds of the loop of which wishes are taken in one: a drag is refined 12.5 times a second, to its end."""
_PATIENCE = 60.0
_SIMULATED = {"lockstep": True}
"""The simulation waits for the executor at any speed, so that a busy machine spoils no chain."""
_EXECUTED = {"odom_timeout": 60.0}
"""As long as it can be: a chain outlasts a pause of so many real s, in which the stamps stand still."""


def run(options: argparse.Namespace, words: Sequence[str] = ()) -> int:
    """Do what the command line asks for until Ctrl-C or SIGTERM; return the exit code."""
    expected = (*EXPECTED_ERRORS, StageError, SetupError)
    return until_stopped("view", partial(_serve, options, words), expected)


def _serve(options: argparse.Namespace, words: Sequence[str], not_stopped: Callable[[], None]) -> None:
    from ator_ros.nodes.live_stage import LiveStage
    from ator_ros.nodes.spun_node import SpunNode
    from ator_ros.page.page import Page

    domain = domain_for(options.domain, options.robot)
    if not domain.chains:
        raise DomainError(f"domain: expected one with chains, got {domain.name}, which has none")
    robot = domain.robot(options.robot or None)
    runs = worst_trials(options.shown, domain, robot) if options.shown else ()
    with _nodes(options) as (number, check):

        def going_on() -> None:
            not_stopped()
            check()

        with contextlib.ExitStack() as closing:
            stages: dict[str, LiveStage] = {}
            for name in options.robots or [""]:
                space = ["--ros-args", "-r", f"__ns:=/{name}"] if name else []
                own = SpunNode(
                    "view", domain=number, words=[*words, *space], check=going_on, patience=_PATIENCE
                )
                frame = options.frame or (f"{name}/odom" if name else "odom")
                stages[name] = LiveStage(own, domain, robot, frame=frame)
                own.start()
                closing.callback(own.close)
            for stage in stages.values():
                closing.callback(stage.leave)
                stage.ready(simulated=not options.attach)
            libraries = {name: domain.library(robot, name) for name in domain.action_sets}
            desk = Desk(next(iter(stages.values())), domain, libraries)
            if options.attach:
                desk.control(desk.stage)  # robots that run are not moved by being looked at
            page = Page(
                desk,
                robot,
                robot_urdf(robot),
                _models(options.models, domain, robot),
                host=options.host,
                port=options.port,
                runs=runs,
                stages=stages if options.robots else NO_STAGES,
            )
            closing.callback(page.close)
            address = f"http://{options.host}:{page.server.get_port()}"
            print(f"view: open {address} in a browser; Ctrl-C ends it", flush=True)
            _loop(desk, page, Wheels(robot), going_on)


@contextlib.contextmanager
def _nodes(options: argparse.Namespace) -> Iterator[tuple[int | None, Callable[[], None]]]:
    """Yield the ROS domain, None for that of the environment, and what raises when a node has ended."""
    if options.attach:
        stay_on_this_machine(os.environ)
        yield None, lambda: None
        return
    files = {name: getattr(options, name) for name in ("models", "robot", "domain")}
    with all_nodes(options.real_time_factor, _SIMULATED, _EXECUTED, **files) as nodes:
        print(f"view: three nodes start on ROS domain {nodes.domain} …", flush=True)
        yield nodes.domain, nodes.check


def _models(folder: str, domain: Domain, robot: Robot) -> Mapping[str, Mapping[str, PerformanceModel]]:
    """Read the models of all action sets, to tell their rules; sets without models are left out."""
    found = {}
    for name in domain.action_sets:
        with contextlib.suppress(ModelFileError, OSError):
            place = Path(folder) if folder else domain.shipped_models
            found[name] = load_models(robot, domain.known_features, action_set=name, folder=place)
    return found


def _loop(desk: Desk, page: object, wheels: Wheels, going_on: Callable[[], None]) -> None:
    from ator_ros.page.page import Page

    assert isinstance(page, Page)
    due = time.monotonic()
    for number in itertools.count():
        going_on()
        desk.step(() if number % _ROUNDS else page.inbox.take())
        world = desk.stage.world()
        if world is not None:
            wheels.roll(world.time, world.robot.v, world.robot.w)
        page.update(time.monotonic(), dict(zip(WHEEL_NAMES, wheels.angles, strict=True)))
        due = max(due + _PERIOD, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
