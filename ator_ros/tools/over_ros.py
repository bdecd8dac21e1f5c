"""Collect episodes over ROS: in a simulation of our own, or with an executor that already runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import STOP, drawn_values, with_values
from ator_ros.actions.situation import SHORT, ActionSpec, Situation, drawn_until, short_goal
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import routes_of
from ator_ros.domains.declared import DeclaredPlace, Places
from ator_ros.domains.domain import Domain, DomainError
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.experience.records import ENDED, episode_of
from ator_ros.experience.simulated import Key, episode_generator, groups
from ator_ros.experience.table import ExperienceError
from ator_ros.files import FileError, read_yaml
from ator_ros.geometry import Pose
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.nodes.remote_messages import RemoteError, RemoteInterface
from ator_ros.performance.coverage import Unlike
from ator_ros.schema import SchemaError, structured
from ator_ros.tools.own_nodes import all_nodes, connected
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.library import top_of
from ator_ros.tops.objects import objects_in
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft
from ator_ros.world.readers import MessageError
from ator_ros.world.state import RobotState, World

Episodes = Generator[pd.DataFrame, None, None]
"""The rows of each episode, see `ator_ros.experience.table.episode_frame`."""
_ATTEMPTS = 3  # drives from one situation: other programs or a busy machine may abort a drive
_LARGEST_FILE = 200_000  # bytes
# m from obstacles at random goals, besides half the robot's width: localization errs
_CLEARANCE = 0.1
_MOST_WITHOUT_EPISODE = 20  # goals in a row, such as goals outside the executor's fence
_MOST_FAILURES = 5  # drives in a row: the robot is stuck, or the server cannot drive
_STOPPED_BY_OTHERS = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN)


def simulated_drives(
    domain: Domain,
    missing: Sequence[tuple[str, int]],
    source: ToolsetSource,
    seed: int,
    factor: float,
) -> Episodes:
    """Drive chains of one step in a simulation with nodes of our own.

    The situations are those that `collect` draws without ROS from the same seed. `missing` are the
    action and the number of each episode; `factor` is the number of simulated per real seconds.
    Raises ExperienceError if the messages of an action server are unknown, or a situation gives no
    episode, and NodesError if a node fails.
    """
    robot = source.described()
    actions = domain.actions(source.action_set)
    names = list(dict.fromkeys(action for action, _ in missing))
    limit = max(TIME_LIMIT, domain.time_limit)
    print(
        f"collect: {len(missing)} episodes of {', '.join(names)} in the simulator, driven by "
        f"{_drivers(domain, source.action_set, names)}; before each, the robot is placed; each "
        f"drive ends after at most {limit:g} s; the nodes start and compile code first, up to a "
        "minute",
        file=sys.stderr,
        flush=True,
    )
    for spec in actions.values():
        for call in () if spec.remote is None else spec.remote.servers:
            try:
                RemoteInterface(call, "odom")
            except RemoteError as error:
                message = f"{spec.name}: action server {call.server}: {error}"
                raise ExperienceError(message) from error
    servers = domain.remote_servers(source.action_set)
    with all_nodes(factor, source) as nodes, connected(nodes, domain, robot, servers) as backend:
        for group in groups(missing, actions.values()):
            spec = actions[group[0][0]]
            situations = [
                spec.situation(robot, episode_generator(spec.name, seed, number))
                for _, number in group
            ]
            top = top_of(situations[0], domain.tops_for(robot), robot)
            start = World(0.0, situations[0].robot, situations[0].objects)
            goals = [situation.goal for situation in situations]
            for _ in range(_ATTEMPTS):
                backend.place(start)
                records = _drive(backend, start, top, goals, source.action_set)
                rows, reason = _episode_rows(group, records, domain, robot)
                if len(rows) == len(group):
                    yield from rows.values()
                    break
            else:
                raise ExperienceError(
                    f"{spec.name}, drive {group[0][1] + 1}: expected a usable record in "
                    f"{_ATTEMPTS} attempts, the last one ended with {reason!r}"
                )


def attached_drives(
    domain: Domain,
    missing: Sequence[tuple[str, int]],
    source: ToolsetSource,
    seed: int,
    *,
    places: Path | None,
    confirmed: bool,
    arguments: Sequence[str],
) -> Episodes:
    """Drive with the running executor. An interruption stops the robot.

    `missing` are the action and the number of each episode, `places` is a file for `Destinations`,
    and `arguments` are ROS arguments, such as the namespace of the robot's nodes. Unless
    `confirmed`, the user must agree first.

    Raises ExperienceError if the user does not confirm, another client controls the robot, or too
    many drives in a row fail, and NodesError if the executor or the robot's state is missing.
    """
    robot = source.described()
    destinations = Destinations(robot, places)
    driver = _drivers(domain, source.action_set, (action for action, _ in missing))
    plan = (
        f"collect: {len(missing)} drives of {robot.name} to places {destinations.where}, "
        f"by {driver} on ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    )
    if confirmed:
        print(plan, file=sys.stderr, flush=True)
    else:
        _confirm(plan)
    stay_on_this_machine(os.environ)
    tops = driven_tops(domain, robot)
    actions = domain.actions(source.action_set)
    generators = {key: episode_generator(key[0], seed, key[1]) for key in missing}
    waiting = list(missing)
    failures = 0
    unused = 0  # drives in a row without an episode
    reason = ""
    with closing(Backend(domain, robot, frame="", arguments=arguments)) as backend:
        backend.ready(simulated=False, refinement=False)
        backend.until(backend.world, "the robot's state, on odom or tf as in the executor")
        while waiting:
            group = groups(waiting, actions.values())[0]
            action = group[0][0]
            if failures >= _MOST_FAILURES:
                raise ExperienceError(f"{action}: {failures} drives in a row failed: {reason}")
            if unused >= _MOST_WITHOUT_EPISODE:
                raise ExperienceError(
                    f"{action}: {unused} goals in a row were refused or gave no usable record: "
                    f"{reason}"
                )
            world = backend.world()
            assert world is not None
            goals: list[Goal] = []
            for key in group:
                pose = goals[-1].pose if goals else world.robot.pose
                goals.append(
                    destinations.goal(actions[action], tops[action], pose, generators[key])
                )
            records = _drive(backend, world, tops[action], goals, source.action_set)
            last = records[-1]
            ending = Ending(last.outcome.code)
            if ending in _STOPPED_BY_OTHERS:
                raise ExperienceError(
                    f"{action}: {last.outcome.reason}; the same command resumes from here"
                )
            if ending is Ending.SUCCEEDED:
                failures = 0
            elif ending is not Ending.REFUSED:
                failures += 1
            rows, problem = _episode_rows(group, records, domain, robot)
            reason = problem or last.outcome.reason
            unused = 0 if rows else unused + 1
            for key, row in rows.items():
                waiting.remove(key)
                yield row


def driven_tops(domain: Domain, robot: Robot) -> dict[str, Top]:
    """Return for each action its first TOP that drives to a goal and needs no object."""
    tops = reversed(domain.tops_for(robot))
    return {top.action: top for top in tops if top.arrives and not objects_in(top)}


def _drivers(domain: Domain, action_set: str, actions: Iterable[str]) -> str:
    """Return what executes these actions over ROS, for a message."""
    calls = (domain.actions(action_set)[name].remote for name in dict.fromkeys(actions))
    servers = {call.server: call.type for call in calls if call is not None}
    named = (f"the action server {name} ({kind})" for name, kind in servers.items())
    return " and ".join(["the executor", *named])


def _confirm(plan: str) -> None:
    """Ask the user whether to move the robot; raise ExperienceError unless the answer is yes."""
    question = f"{plan}. The robot will move. Continue? [y/N] "
    print(question, end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ExperienceError("the robot was not moved: answer y to continue, or give --yes")


def _drive(
    backend: Backend, start: World, top: Top, goals: Sequence[Goal], action_set: str
) -> list[Any]:
    """Execute a chain to goals, the last of which is not passed.

    Return its ActionPerformances, or the ChainPerformance if it never began.
    """
    *others, last = goals
    if STOP in last.values:
        last = with_values(last, {STOP: 1.0})
    calls = tuple(TopCall(top, goal) for goal in (*others, last))
    draft = Draft(start, TopChain(calls), action_set)
    chain = backend.drive("collect", draft, refine=False).record
    return list(chain.actions) or [chain]


def _episode_rows(
    group: Sequence[Key], records: Sequence[Any], domain: Domain, robot: Robot
) -> tuple[dict[Key, pd.DataFrame], str]:
    """Return the table rows of records, and why one of them is not an episode, if any is not."""
    rows = {}
    reason = ""
    for key, record in zip(group, records, strict=False):
        row, problem = _episode_row(record, key[1], domain, robot)
        if row is not None:
            rows[key] = row
        reason = reason or problem
    return rows, reason


def _episode_row(
    record: Any, number: int, domain: Domain, robot: Robot
) -> tuple[pd.DataFrame | None, str]:
    """Return the table row of a record, or None and the reason why it is not an episode."""
    if record.outcome.code not in ENDED:
        return None, record.outcome.reason
    try:
        return episode_of(record, domain, robot).rows(number, domain.objects), ""
    except MessageError as error:
        return None, str(error)


class Destinations:
    """Draws the goals of drives.

    Goals are at the places of `file`, a YAML file with a list of places. Without a file they are in
    the free space of the robot's map. Without a map the domain draws them, or they are in the
    robot's area.

    Raises FileError if the file cannot be used, and NoPlaceError if a place is not in free space of
    the map.
    """

    def __init__(self, robot: Robot, file: Path | None) -> None:
        self._robot = robot
        self._routes = routes_of(robot)
        self._places: tuple[DeclaredPlace, ...] = ()
        self._area = Fence(*robot.scene.area.lines)
        self.where = "of its domain"
        if self._routes is not None:
            self.where = f"in free space of {self._routes.grid}"
        if file is None:
            return
        self.where = f"of {file}"
        try:
            self._places = structured(read_yaml(file, largest=_LARGEST_FILE), Places)
        except SchemaError as error:
            raise FileError(f"{file}: expected a list of places: {error}") from error
        rng = np.random.default_rng(0)
        for number, place in enumerate(self._places):
            expected = f"{file}: [{number}]: expected a place in free space of the map"
            drawn_until(partial(place.drawn, rng), self._is_free, partial(str, expected), most=100)

    def goal(self, spec: ActionSpec, top: Top, start: Pose, rng: np.random.Generator) -> Goal:
        """Draw a goal for a drive from `start`, in m and rad; raises NoPlaceError.

        Places are at least `SHORT` from the start. One in seven random goals is nearer. If the
        action samples what is unlike earlier drives, so is the drive from `start`.
        """
        if isinstance(spec.sample, Unlike):
            plain = replace(spec, sample=spec.sample.sample)
            robot = RobotState(start)
            return spec.sample.coverage.new(
                lambda: Situation(spec.name, robot, {}, self.goal(plain, top, start, rng))
            ).goal
        if not self._places and self._routes is None:
            with suppress(DomainError):  # the domain cannot draw drives of this action
                return spec.sample(self._robot, rng).goal
        pose = None if self._places else short_goal(start, rng)
        if pose is None or not self._is_free(pose, start):
            expected = f"places {self.where}, {SHORT:g} m from the robot and within its reach"
            pose = drawn_until(
                partial(self._pose, rng),
                lambda pose: pose.distance(start) >= SHORT and self._is_free(pose, start),
                lambda: f"expected {expected}",
            )
        return Goal(pose, 0.0, top.point, drawn_values(spec.goal_variables, rng))

    def _pose(self, rng: np.random.Generator) -> Pose:
        if self._places:
            return self._places[int(rng.integers(len(self._places)))].drawn(rng)
        yaw = float(rng.uniform(-np.pi, np.pi))
        if self._routes is None:
            x_min, y_min, x_max, y_max = self._robot.scene.area.lines
            return Pose(float(rng.uniform(x_min, x_max)), float(rng.uniform(y_min, y_max)), yaw)
        grid = self._routes.grid
        x, y = (rng.random(2) * grid.free.shape[::-1] * grid.resolution).tolist()
        return grid.origin.compose(Pose(x, y, yaw))

    def _is_free(self, pose: Pose, start: Pose | None = None) -> bool:
        if self._routes is None:
            return bool(self._places) or self._area.outside(pose.x, pose.y) == 0.0
        origin = None if start is None else (start.x, start.y)
        if self._routes.fault(pose.x, pose.y, origin) is not None:
            return False
        room = 0.0 if self._places else self._routes.radius + _CLEARANCE
        return bool(self._routes.clearance(np.array([pose.x]), np.array([pose.y]))[0] >= room)
