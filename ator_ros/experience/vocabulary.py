"""What experience needs of a domain: which objects there are, and what each of its TOPs is for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.remote import RemoteCall
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.objects import held_first, held_last
from ator_ros.world.messages import ObjectSource


class Vocabulary(Protocol):
    """Name, objects, TOPs and goal variables of a domain; `ator_ros.domains.domain.Domain` is one."""

    @property
    def name(self) -> str:
        """Name of the domain."""

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of its objects."""

    def source(self, name: str) -> ObjectSource:
        """Return where the state of an object comes from."""

    @property
    def tops(self) -> tuple[Top, ...]:
        """Its TOPs, for a usual robot."""

    def tops_for(self, robot: Robot) -> tuple[Top, ...]:
        """Return its TOPs with the tolerances and regions of a robot in its scene."""

    @property
    def goal_variables(self) -> Mapping[str, GoalVariable]:
        """The goal variables that its actions declare, by name."""

    @property
    def remote_calls(self) -> Mapping[str, RemoteCall]:
        """How the servers of its remote actions are called, by the names of the actions."""


def point_of(domain: Vocabulary, top: str) -> Point:
    """Return the point that goals of a TOP are meant for: the axle where the domain has no such TOP."""
    return next((known.point for known in domain.tops if known.name == top), Point.AXLE)


def drive_between(domain: Vocabulary, first: str | None, last: str | None) -> Top | None:
    """Return the TOP that drives with one object held at the start and another, or the same, at the end.

    Parameters
    ----------
    domain : Vocabulary
        Whose TOPs.
    first, last : str or None
        The objects held at the start and at the end; None: none.

    Returns
    -------
    Top or None
        The first with these roles, else the first that drives and holds nothing; None without any.
    """
    driving = [top for top in domain.tops if top.arrives]
    roles = [(held_first(top), held_last(top)) for top in driving]
    for wanted in ((first, last), (None, None)):
        if wanted in roles:
            return driving[roles.index(wanted)]
    return None
