"""The page beside Nav2: map, watched drives, rules, errors and savings, from the node `watch`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import textwrap
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from ator_interfaces.msg import DriveEstimate, WatchedDrives
from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.files import FileError, load
from ator_ros.geometry import FloatArray, Pose
from ator_ros.learning.watch_tally import KIND, TALLY, Tally
from ator_ros.nodes.client_node import ClientNode
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.models import LearnedSets
from ator_ros.nodes.network import NodesError
from ator_ros.nodes.parameters import SetupError, domain_and_robot
from ator_ros.nodes.qos import LATCHED, RESULTS
from ator_ros.nodes.segments import BLUE, ORANGE, Label, polyline
from ator_ros.nodes.subscriptions import TfListener
from ator_ros.nodes.watch import watched_folder
from ator_ros.view.floor import LOOPBACK, Canvas, Movable, serve
from ator_ros.view.runs import plain

_PARAMETERS = ("domain", "robot", "map", "frame", "models", "learned", "watched")
_USUAL_FRAME = "base_link"  # of the robot, REP-105
_SHOWN = 50  # newest drives on the floor
_WIDTH = 0.03  # m, of their lines
_OLD = 2.0  # real s after which an estimate is no longer shown: a drive has two a second
_COLUMNS = 36  # of a line of rules
_SAVINGS = ("headings", "passing", "order")


@dataclass
class Watched:
    """What the page shows.

    Attributes
    ----------
    robot : Pose or None
        In the frame of the map; None: unknown.
    report : WatchedDrives or None
        The newest one.
    estimates : list of DriveEstimate
        Of running drives.
    paths : list of ndarray of shape (n, 2)
        The newest drives, in m, oldest first.
    tally : Tally
        Its errors are those of the newest drives.
    rules : str
        Those of all models.
    """

    robot: Pose | None = None
    report: WatchedDrives | None = None
    estimates: list[DriveEstimate] = field(default_factory=list)
    paths: list[FloatArray] = field(default_factory=list)
    tally: Tally = field(default_factory=Tally)
    rules: str = ""


class WatchClient(ClientNode):
    """Client of a node `watch` on this machine: what it publishes, and the folders that it names.

    Raises NodesError if the node, or its map, is not there in time.

    Parameters
    ----------
    arguments : sequence of str
        ROS arguments, such as the namespace of the node.
    timeout : float
        Real s for its parameters, and for the map.
    """

    def __init__(self, arguments: Sequence[str] = (), *, timeout: float = 20.0) -> None:
        super().__init__("view", arguments=arguments, timeout=timeout)
        self._report: WatchedDrives | None = None
        self._estimates: dict[str, tuple[float, DriveEstimate]] = {}
        """By goal, when it came in real s, and the newest estimate."""
        self._place: tuple[Domain, Robot] | None = None  # on its map
        settings = self._settings()
        self._frame = settings["frame"]
        given = self._read(["robot_frame"])  # of a parameter file for all nodes; empty without it
        self._robot_frame = given[0] if given else _USUAL_FRAME
        self._folder = watched_folder(settings["watched"])
        try:
            domain, robot = domain_and_robot(settings)
            followed = FollowedMap(self.node, settings, domain, robot, self._take_place)
        except SetupError as error:
            raise NodesError(f"watch: {error}; start view on its machine") from error
        if not followed.is_missing:
            self._take_place(domain, robot)
        self.until(lambda: self._place is not None, "a map as `watch` uses it")
        self.domain, self.robot = self._place or (domain, robot)
        libraries = {name: self.domain.library(self.robot, name) for name in domain.action_sets}
        self._models = LearnedSets(self.node, self.domain, libraries, settings)
        self._tf = TfListener(self.node)
        subscribe = self.node.create_subscription
        subscribe(WatchedDrives, "watch/drives", self._take_report, LATCHED)
        subscribe(DriveEstimate, "watch/estimates", self._take_estimate, RESULTS)
        self._watched = Watched()
        self._has_changed = True  # what the files contain

    def _settings(self) -> dict[str, Any]:
        """Return the parameters of the node `watch`."""
        return dict(zip(_PARAMETERS, self._read(_PARAMETERS), strict=True))

    def _read(self, names: Sequence[str]) -> list[Any]:
        """Return parameters of the node `watch`; none of them if it lacks one."""
        client = AsyncParameterClient(self.node, "watch")
        self.until(client.services_are_ready, "the node `watch`, as nav2.launch.xml starts it,")
        future = client.get_parameters(list(names))
        self.until(future.done, "the parameters of `watch`")
        return [parameter_value_to_python(value) for value in future.result().values]

    def _take_place(self, domain: Domain, robot: Robot) -> None:
        self._place = domain, robot

    def _take_report(self, message: WatchedDrives) -> None:
        self._report = message
        self._has_changed = True

    def _take_estimate(self, message: DriveEstimate) -> None:
        self._estimates[message.goal_id] = time.monotonic(), message

    def watched(self) -> Watched:
        """Return what the page shows."""
        found = self._watched
        if self._has_changed:
            self._has_changed = False
            with contextlib.suppress(FileError, OSError):
                found.paths = WatchedPaths(self._folder / PATHS).newest(_SHOWN)
                found.tally = load(self._folder / TALLY, KIND, Tally)
        found.report = self._report
        since = time.monotonic() - _OLD
        recent = {name: item for name, item in self._estimates.items() if item[0] > since}
        self._estimates = recent
        found.estimates = [estimate for _, estimate in recent.values()]
        found.robot = self._tf.base(self._frame, self._robot_frame)
        models = self._models.present[DEFAULT_SET].models
        found.rules = "\n\n".join(f"{name}:\n{model.rules()}" for name, model in models.items())
        return found


class WatchedPage:
    """Serves the page; `update` shows something new. By default only this machine can reach it."""

    def __init__(
        self, domain: Domain, robot: Robot, *, host: str = LOOPBACK, port: int = 8080
    ) -> None:
        self.server = server = serve(domain, robot, host=host, port=port)
        area = robot.scene.area
        self._drives = Canvas(server, "/drives", area)
        self._goals = Canvas(server, "/goals", area)
        self._robot = Movable(server, "/robot", area)
        radius = 0.5 * (robot.front + robot.rear)
        server.scene.add_cylinder("/robot/body", radius, 0.2, ORANGE, position=(0.0, 0.0, 0.1))
        nose = (radius, 0.0, 0.1)
        server.scene.add_icosphere("/robot/nose", 0.25 * radius, ORANGE, position=nose)
        gui = server.gui
        self._report = gui.add_markdown("waiting for the node `watch`")
        with gui.add_folder("Errors of the first estimates in s"):
            self._errors = gui.add_uplot(
                errors_over_time(Tally()),
                (
                    {"label": "newest drives"},
                    {"label": "estimates", "stroke": "#2060d0", "width": 2},
                    {"label": "server's own", "stroke": "#d07020", "width": 2},
                ),
                scales={"x": {"time": False}, "y": {"distr": 3}},  # logarithmic
                aspect=1.3,
            )
        with gui.add_folder("Rules of the models"):
            self._rules = gui.add_markdown("")

    def update(self, watched: Watched) -> None:
        """Show what is watched."""
        # In viser's thread, because changing a handle sets asyncio events.
        loop = self.server.get_event_loop()
        asyncio.run_coroutine_threadsafe(self._update(watched), loop).result()

    async def _update(self, watched: Watched) -> None:
        with self.server.atomic():
            self._robot.show(watched.robot)
            lines = (
                polyline(f"drive{number}", path.tolist(), BLUE, _WIDTH)
                for number, path in enumerate(watched.paths)
            )
            self._drives.draw(lines)
            self._goals.label(map(_label, watched.estimates))
            if watched.report is not None:
                self._report.content = report_text(watched.report)
            self._errors.data = errors_over_time(watched.tally)
            self._rules.content = f"```\n{_wrapped(watched.rules or 'no model yet')}\n```"


def _wrapped(text: str) -> str:
    lines = text.splitlines()
    return "\n".join(textwrap.fill(line, _COLUMNS, subsequent_indent="  ") for line in lines)


def _label(estimate: DriveEstimate) -> Label:
    place = estimate.goal.pose.position
    text = f"{estimate.remaining:.0f} s ± {estimate.spread:.0f} s"
    return Label(f"goal{estimate.goal_id}", text, place.x, place.y)


def errors_over_time(tally: Tally) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places in the lists of errors, and the newest errors of estimates and of the server.

    All have the shape (n,), errors in s. The newest ones of both are side by side; NaN where there
    are fewer.
    """
    lists = tally.estimate_errors, tally.server_errors
    count = max(1, *map(len, lists))
    numbers = np.arange(count, dtype=float) + 1.0
    ours, theirs = (np.array([math.nan] * (count - len(each)) + each) for each in lists)
    return numbers, ours, theirs


def report_text(report: WatchedDrives) -> str:
    """Return the newest report in Markdown."""
    lines = [
        f"**{plain(report.server)}: {report.drives} drives to learn from**; {report.held_up} held "
        f"up, {report.recovered} with recoveries, {report.ended_early} ended early.",
        f"First estimates of the last {report.estimated} were wrong by "
        f"{_seconds(report.estimate_error)} on average, the server's own on the way by "
        f"{_seconds(report.server_error)}.",
        f"Models: {plain(report.models) or 'none yet'}. Measured gain of {report.refined.refined} "
        f"refined chains: {_seconds(report.refined.measured)} "
        f"({_between(report.refined.measured_low, report.refined.measured_high)}).",
        f"Driven today: {report.driven / 60.0:.0f} min. What would have been saved:",
        "| | s | 95 % |\n|---|---|---|\n" + "\n".join(_saved(report, name) for name in _SAVINGS),
    ]
    return "\n\n".join(lines)


def _saved(report: WatchedDrives, name: str) -> str:
    saving = getattr(report, name)
    return f"| {name} | {_seconds(saving.saving)} | {_between(saving.low, saving.high)} |"


def _seconds(value: float) -> str:
    return "unknown" if math.isnan(value) else f"{value:.1f} s"


def _between(low: float, high: float) -> str:
    return "-" if math.isnan(low) else f"{low:.1f} to {high:.1f}"
