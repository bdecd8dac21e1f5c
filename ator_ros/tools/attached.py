"""Collect experience with an executor that is already running, such as that of a real robot."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from ator_ros.actions.base import Goal
from ator_ros.actions.situation import SHORT, ActionSpec, drawn_until, short_goal
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import routes_of
from ator_ros.domains.declared import DeclaredPlace, Places
from ator_ros.domains.domain import Domain, DomainError
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.experience.simulated import episode_generator
from ator_ros.experience.table import ExperienceError
from ator_ros.files import FileError, read_yaml
from ator_ros.geometry import Pose
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.schema import SchemaError, structured
from ator_ros.tools.collect import Attachment, drivers
from ator_ros.tools.own_nodes import episode_row
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.objects import objects_in
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft

_LARGEST_FILE = 200_000  # bytes
# m from obstacles at random goals, besides half the robot's width: localization errs
_CLEARANCE = 0.1
_MOST_WITHOUT_EPISODE = 20  # goals in a row, such as goals outside the executor's fence
_MOST_FAILURES = 5  # drives in a row: the robot is stuck, or the server cannot drive
_STOPPED_BY_OTHERS = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN)


class Destinations:
    """Draws the goals of drives.

    Goals are at the places of `file`, a YAML file with a list of places. Without a file they are in
    the free space of the robot's map. Without a map the domain draws them, or they are in the
    robot's area.

    Raises FileError if the file cannot be used, and NoPlaceError if a place is not in free space of
    the map.
    """

    def __init__(self, robot: Robot, file: Path | None) -> None:
        self._robot, self._routes = robot, routes_of(robot)
        self._places: tuple[DeclaredPlace, ...] = ()
        self._area = Fence(*robot.scene.area.lines)
        self.where = (
            "of its domain" if self._routes is None else f"in free space of {self._routes.grid}"
        )
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

        Places are at least `SHORT` from the start. One in seven random goals is nearer.
        """
        if not self._places and self._routes is None:
            with suppress(DomainError):  # the domain cannot draw drives of this action
                return spec.sample(self._robot, rng).goal
        pose = None if self._places else short_goal(start, rng)
        if pose is None or not self._is_free(pose, start):
            pose = drawn_until(
                partial(self._pose, rng),
                lambda pose: pose.distance(start) >= SHORT and self._is_free(pose, start),
                lambda: (
                    f"expected places {self.where}, {SHORT:g} m from the robot and within its reach"
                ),
            )
        values = {
            item.name: float(rng.uniform(item.low, item.high)) for item in spec.goal_variables
        }
        return Goal(pose, 0.0, top.point, values)

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
        room = 0.0 if self._places else self._routes.radius + _CLEARANCE
        reached = (
            self._routes.fault(pose.x, pose.y, None if start is None else (start.x, start.y))
            is None
        )
        return reached and bool(
            self._routes.clearance(np.array([pose.x]), np.array([pose.y]))[0] >= room
        )


def driven_tops(domain: Domain, robot: Robot) -> dict[str, Top]:
    """Return for each action its first TOP that drives to a goal and needs no object."""
    tops = reversed(domain.tops_for(robot))
    return {top.action: top for top in tops if top.arrives and not objects_in(top)}


def drives(
    domain: Domain,
    robot: Robot,
    missing: Sequence[tuple[str, int]],
    action_set: str,
    seed: int,
    attachment: Attachment,
) -> Generator[pd.DataFrame, None, None]:
    """Drive with the running executor; yield the row of each episode. An interruption stops the robot.

    `missing` are the action and the number of each episode. Raises ExperienceError if the user does
    not confirm, another client controls the robot, or too many drives in a row fail, and NodesError
    if the executor or the robot's state is missing.
    """
    if not missing:
        return
    destinations = Destinations(robot, attachment.places)
    driver = drivers(domain, action_set, (action for action, _ in missing))
    plan = f"collect: {len(missing)} drives of {robot.name} to places {destinations.where}, by {driver}"
    plan += f" on ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    if attachment.confirmed:
        print(plan, file=sys.stderr, flush=True)
    else:
        _confirm(plan)
    stay_on_this_machine(os.environ)
    tops, failures, reason = driven_tops(domain, robot), 0, ""
    with closing(Backend(domain, robot, frame="", arguments=attachment.arguments)) as backend:
        backend.ready(simulated=False, refinement=False)
        backend.until(backend.world, "the robot's state, on odom or tf as in the executor")
        for action, number in missing:
            spec, top = domain.actions(action_set)[action], tops[action]
            rng, goals, row = episode_generator(action, seed, number), 0, None
            while row is None:
                if failures >= _MOST_FAILURES:
                    raise ExperienceError(f"{action}: {failures} drives in a row failed: {reason}")
                if goals >= _MOST_WITHOUT_EPISODE:
                    raise ExperienceError(
                        f"{action}: {goals} goals in a row were refused or gave no usable record: {reason}"
                    )
                world = backend.world()
                assert world is not None
                goal = destinations.goal(spec, top, world.robot.pose, rng)
                draft = Draft(world, TopChain((TopCall(top, goal),)), action_set)
                run = backend.drive("collect", draft, refine=False)
                record = [run.record, *run.record.actions][-1]  # the chain's, if no step began
                ending = Ending(record.outcome.code)
                if ending in _STOPPED_BY_OTHERS:
                    raise ExperienceError(
                        f"{action}: {record.outcome.reason}; the same command resumes from here"
                    )
                row, problem = episode_row(record, number, domain, robot)
                reason = problem or record.outcome.reason
                goals += 1
                failures = (
                    0 if ending is Ending.SUCCEEDED else failures + (ending is not Ending.REFUSED)
                )
            yield row


def _confirm(plan: str) -> None:
    """Ask the user whether to move the robot; raise ExperienceError unless the answer is yes."""
    question = f"{plan}. The robot will move. Continue? [y/N] "
    print(question, end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ExperienceError("the robot was not moved: answer y to continue, or give --yes")
