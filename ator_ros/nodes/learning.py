"""The node `learning`: trains models from records while the robot acts (paper, section 3)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from ator_interfaces.msg import ActionPerformance, ChainPerformance
from ator_ros.actions import DEFAULT_SET
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.experience.records import ENDED, episode_of
from ator_ros.experience.store import StoreInfo
from ator_ros.files import FileError
from ator_ros.learning.gains import chain_gain
from ator_ros.learning.learner import Learner
from ator_ros.learning.process import RoundProcess
from ator_ros.learning.sets import digest_of_start
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health
from ator_ros.nodes.main_loop import run_node
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.parameters import (
    FRAME,
    MODELS,
    PLANNER,
    WORLD,
    Parameter,
    SetupError,
    declare_parameters,
    domain_and_robot,
    map_file,
    map_topic,
)
from ator_ros.nodes.path_planner import planner_name
from ator_ros.nodes.qos import RESULTS_OF_MANY, SERVICES
from ator_ros.nodes.subscriptions import WARNING_PERIOD
from ator_ros.printable import one_line
from ator_ros.world.grid_map import GridMap, save_map
from ator_ros.world.readers import MessageError

PARAMETERS = (
    FRAME,
    *WORLD,
    MODELS,
    PLANNER,
    Parameter("learned", "", "folder of records and learned sets; empty: ~/.ros/ator_ros/learned"),
    Parameter(
        "watched",
        "",
        "folder of the node `watch`, whose paths are the routes on the map instead of those of "
        "`planner`; empty: none",
    ),
    Parameter("records", ["performance/action"], "topics of the records, of one or several robots"),
    Parameter("chains", ["performance/chain"], "topics of their chain records"),
    Parameter("batch", 20, "new records after which to learn again", 5, 10_000),
)
_PERIOD = 0.25  # real s between two looks at the round under way
_MOST_EPISODES = 20_000  # of each action set that are kept: 28 hours of drives of 5 s
_DEFAULT_FOLDER = "~/.ros/ator_ros/learned"


class LearningNode(Node):
    """Stores records, trains models in a process of its own, and switches to better sets of models.

    Subscribes to
        performance/action (ator_interfaces/ActionPerformance), or the topics that `records` names.
        All robots have the same description. performance/chain (ator_interfaces/ChainPerformance),
        or the topics that `chains` names. the topic of a map (nav_msgs/OccupancyGrid, transient
        local), if `map` names one.
    Publishes
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    Services
        ~/learn_now (std_srvs/Trigger): starts a round of learning.
        ~/freeze (std_srvs/SetBool): while true, records are stored and the set in use stays.
    Writes
        the folder `learned`: records, sets, what refined chains gained, and the link `current` to
        the set that the nodes `refinement` and `executor` with the same parameter use.
    """

    def __init__(self) -> None:
        super().__init__("learning", automatically_declare_parameters_from_overrides=True)
        settings = declare_parameters(self, PARAMETERS)
        self._domain, self._robot = domain_and_robot(settings)
        self._folder = folder = Path(settings["learned"] or _DEFAULT_FOLDER).expanduser()
        given = {name: settings[name] for name in ("domain", "robot", "models", "frame")}
        planner = "" if settings["watched"] else planner_name(self, settings, self._domain)
        self._grid = map_file(settings)
        self._awaits_map = bool(map_topic(settings))
        self._topic_map: GridMap | None = None
        self._given = given | {"learned": str(folder), "planner": planner}
        self._given["watched"] = settings["watched"]
        self._fault = ""  # the last one that was logged
        self._numbers: dict[str, int] = {}  # of the last message of each topic
        models = self._domain.models_root(settings["models"])
        try:
            self._learner = Learner(
                folder,
                StoreInfo(self._robot.digest(), self._domain.name),
                self._start_round,
                start=digest_of_start(models, self._domain.action_sets),
                batch=settings["batch"],
                most=_MOST_EPISODES,
            )
        except (FileError, OSError) as error:
            raise SetupError(f"parameter learned: {error}") from error
        self._map = FollowedMap(self, settings, self._domain, self._robot, self._take_map)
        subscribed: dict[str, type[Any]] = {}
        for kind, topics, take in (
            (ActionPerformance, settings["records"], self._take),
            (ChainPerformance, settings["chains"], self._take_chain),
        ):
            for topic in topics:
                received = partial(self._receive, take, topic)
                self.create_subscription(kind, topic, received, RESULTS_OF_MANY)
                subscribed[topic] = kind
        self.create_service(Trigger, "~/learn_now", self._learn_now, qos_profile=SERVICES)
        self.create_service(SetBool, "~/freeze", self._freeze, qos_profile=SERVICES)
        self.create_timer(_PERIOD, self._work, clock=STEADY)
        Diagnostics(self, self._health, subscribed)
        frozen = ", frozen" if self._learner.frozen else ""
        self.get_logger().info(
            f"learning from {', '.join(settings['records'])} into {folder}: {self._learner.stored} "
            f"records, set {self._learner.diagnostics()['set']}{frozen}"
        )

    def _take_map(self, domain: Domain, robot: Robot) -> None:
        """Use another map from the next round on."""
        self._domain = domain
        self._robot = robot
        self._topic_map = domain.grid
        self._awaits_map = False

    def _start_round(self) -> RoundProcess:
        """Start a round in a process, which reads the map of a topic from a file.

        Raises OSError.
        """
        grid = self._grid
        if self._topic_map is not None:
            grid = str(save_map(self._topic_map, self._folder))
        settings = self._given | {"map": grid, "time": _now()}
        return RoundProcess("ator_ros.nodes.learning_process", settings)

    def _receive(
        self, take: Callable[[Any], None], topic: str, message: Any, info: Mapping[str, Any]
    ) -> None:
        """Take a record, and count those before it that came faster than they were read.

        Each publisher numbers its messages: only those of a single one can be counted.
        """
        number = info["publication_sequence_number"]
        last = self._numbers.get(topic, number)
        self._numbers[topic] = number
        if number > last + 1 and self.count_publishers(topic) == 1:
            self._learner.miss(number - last - 1)
        take(message)

    def _take(self, message: Any) -> None:
        if message.outcome.code not in ENDED:
            return
        try:
            episode = episode_of(message, self._domain, self._robot)
        except MessageError as error:
            self._learner.left_out += 1
            self.get_logger().warning(
                f"record left out: {error}", throttle_duration_sec=WARNING_PERIOD
            )
            return
        self._learner.take(message.action_set or DEFAULT_SET, episode)

    def _take_chain(self, message: Any) -> None:
        if chain := chain_gain(message, self._learner.gains.models):
            self._learner.take_chain(chain)

    def _work(self) -> None:
        if report := self._learner.work(time.monotonic(), may_begin=not self._awaits_map):
            self.get_logger().info(one_line(report))
        fault = self._learner.fault
        if fault != self._fault:
            self._fault = fault
            if fault:
                self.get_logger().warning(one_line(fault))
            else:
                self.get_logger().info(f"{self._folder} can be written again; no record waits")

    def _learn_now(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        why_not = self._learner.learn_now()
        response.success = not why_not
        when = "once there is a map" if self._awaits_map else "now"
        response.message = (
            why_not or f"a round starts {when}; log and diagnostics report its result"
        )
        return response

    def _freeze(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            self._learner.freeze(request.data)
        except OSError as error:
            response.message = str(error)
        else:
            response.success = True
            response.message = "the set in use stays" if request.data else "learning continues"
        return response

    def _health(self) -> Health:
        values = self._learner.diagnostics()
        if self._domain.grid is not None:
            values["map"] = str(self._domain.grid)
        problems = filter(None, (self._map.problem, self._learner.problem))
        return Health("; ".join(problems), values=values)

    def stop(self) -> None:
        """End the current round, and close the files."""
        self._learner.close()
        if self._learner.lost:
            self.get_logger().error(
                f"{self._learner.lost} of {self._learner.taken} records are lost: they came "
                f"faster than they were read, or {self._folder} could not be written"
            )


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


main = partial(run_node, LearningNode, PARAMETERS)
