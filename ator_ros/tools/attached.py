"""Drive with an executor that is already running, on the user's robot, to gather experience."""

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
from ator_ros.domains.declared import DeclaredPlace, Places
from ator_ros.domains.domain import Domain, DomainError
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.experience.collect import episode_generator
from ator_ros.experience.records import ENDED, episode_of
from ator_ros.experience.table import ExperienceError, episode_frame
from ator_ros.files import FileError, read_yaml
from ator_ros.geometry import Pose
from ator_ros.motion.routes import routes_of
from ator_ros.nodes.network import NodesError, stay_on_this_machine
from ator_ros.robot.description import Robot
from ator_ros.schema import SchemaError, structured
from ator_ros.tools.collect import Attachment
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.objects import objects_in
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft
from ator_ros.world.messages import MessageError

_LARGEST_FILE = 200_000  # bytes
_ROOM = 0.1  # m from obstacles at random goals, besides half the robot's width: localization errs
_MOST_REFUSED = 20  # goals in a row, such as those outside the executor's fence
_MOST_FAILED = 5  # drives in a row: the robot is stuck, or the server cannot drive
_TAKEN_OVER = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN)


class Destinations:
    """Draws goals at the places of a file, or without one in the free space of the robot's map.

    Without file and map, the domain draws them; if it cannot, they are anywhere in the area.

    Parameters
    ----------
    robot : Robot
        The robot, on its map if it has one.
    file : Path or None
        A YAML file with a list of places.

    Raises
    ------
    FileError
        The file cannot be used.
    NoPlaceError
        No route leads to one of its places.
    """

    def __init__(self, robot: Robot, file: Path | None) -> None:
        self._robot, self._routes = robot, routes_of(robot)
        self._places: tuple[DeclaredPlace, ...] = ()
        self._area = Fence(*robot.scene.area.lines)
        self.where = "of its domain" if self._routes is None else f"in free space of {self._routes.grid}"
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

        Goals are at least `SHORT` from the start, except for one in seven random goals on a map or in the
        area, which is nearer.
        """
        if not self._places and self._routes is None:
            with suppress(DomainError):
                return spec.sample(self._robot, rng).goal
        pose = None if self._places else short_goal(start, rng)
        if pose is None or not self._is_free(pose, start):
            pose = drawn_until(
                partial(self._pose, rng),
                lambda pose: pose.distance(start) >= SHORT and self._is_free(pose, start),
                lambda: f"expected places {self.where}, {SHORT:g} m from the robot and within its reach",
            )
        values = {item.name: float(rng.uniform(item.low, item.high)) for item in spec.goal_variables}
        return Goal(pose, 0.0, top.point, values)

    def _pose(self, rng: np.random.Generator) -> Pose:
        if self._places:
            return self._places[int(rng.integers(len(self._places)))].drawn(rng)
        yaw = float(rng.uniform(-np.pi, np.pi))
        if self._routes is None:
            low, high = np.split(np.array(self._robot.scene.area.lines), 2)
            x, y = rng.uniform(low, high).tolist()
            return Pose(x, y, yaw)
        grid = self._routes.grid
        along, across = (rng.random(2) * grid.free.shape[::-1] * grid.resolution).tolist()
        return grid.origin.compose(Pose(along, across, yaw))

    def _is_free(self, pose: Pose, start: Pose | None = None) -> bool:
        if self._routes is None:
            return bool(self._places) or self._area.outside(pose.x, pose.y) == 0.0
        room = 0.0 if self._places else self._routes.radius + _ROOM
        reached = self._routes.fault(pose.x, pose.y, None if start is None else (start.x, start.y)) is None
        return reached and bool(self._routes.clearance(np.array([pose.x]), np.array([pose.y]))[0] >= room)


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
    """Drive with the running executor; yield the row of each of its records.

    `missing` are the action and the number of each drive. An interruption stops the robot.

    Raises
    ------
    ExperienceError
        The user does not confirm, others use the robot, or too many goals in a row are not reached.
    NodesError
        The executor or the robot's state is missing.
    """
    if not missing:
        return
    destinations = Destinations(robot, attachment.places)
    if not attachment.confirmed:
        _ask(f"collect: {len(missing)} drives of {robot.name} to places {destinations.where}")
    stay_on_this_machine(os.environ)
    tops, failed, reason = driven_tops(domain, robot), 0, ""
    with closing(Backend(domain, robot, frame="", arguments=attachment.arguments)) as backend:
        backend.ready(simulated=False, refinement=False)
        backend.until(backend.world, "the robot's state, on odom or tf as in the executor")
        for action, number in missing:
            spec, top = domain.actions(action_set)[action], tops[action]
            rng, refused, frame = episode_generator(action, seed, number), 0, None
            while frame is None:
                if failed >= _MOST_FAILED or refused >= _MOST_REFUSED:
                    count = max(failed, refused)
                    raise ExperienceError(f"{action}: {count} goals in a row were not reached: {reason}")
                world = backend.world()
                assert world is not None
                goal = destinations.goal(spec, top, world.robot.pose, rng)
                draft = Draft(world, TopChain((TopCall(top, goal),)), action_set)
                run = backend.drive("collect", draft, refine=False)
                if run.problem:
                    raise NodesError(run.problem)
                record = [run.record, *run.record.actions][-1]  # the chain's, if no step began
                ending, reason = Ending(record.outcome.code), record.outcome.reason
                if ending in _TAKEN_OVER:
                    raise ExperienceError(f"{action}: {reason}; the same command resumes from here")
                if ending.value in ENDED:
                    try:
                        frame = episode_frame(number, episode_of(record, domain, robot), domain.objects)
                    except MessageError as error:
                        reason = str(error)
                refused += frame is None
                failed = 0 if ending is Ending.SUCCEEDED else failed + (ending is not Ending.REFUSED)
            yield frame


def _ask(question: str) -> None:
    where = f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    print(f"{question}, by the executor on {where}. The robot moves. Go on? [y/N] ", end="", file=sys.stderr)
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ExperienceError("expected the answer y, or --yes: the robot was not moved")
