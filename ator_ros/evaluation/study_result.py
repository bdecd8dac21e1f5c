"""What `study` finds out about a robot: its actions, their models, and what refinement is worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ator_ros.evaluation.open_variables import OpenVariable
from ator_ros.formats import Format

FORMAT = Format("ator_ros study", 1, "study")
SETTINGS = Format("ator_ros study settings", 1, "settings file of a study")


@dataclass(frozen=True)
class StudySettings:
    """What the files in a study's folder depend on; options of `study`, and the digest of robot and scene."""

    description_digest: str
    domain: str
    action_set: str
    episodes: int
    situations: int
    seed: int
    chain: str | None
    oracle: int


@dataclass(frozen=True)
class MeasuredAction:
    """How an action did over all its episodes, and how accurate its model is.

    Attributes
    ----------
    episodes : int
        Number of episodes.
    success : float
        Share that succeeded.
    mean_duration_s : float or None
        Of the successes; None without any.
    accuracy : dict
        As in the file of its model; empty without one.
    failures : dict
        Why episodes failed and how often.
    """

    episodes: int
    success: float
    mean_duration_s: float | None
    accuracy: dict[str, Any]
    failures: dict[str, int]


@dataclass(frozen=True)
class StudyResult:
    """The content of the file that `study` writes.

    Attributes
    ----------
    command : str
        The command that wrote it.
    robot, robot_digest : str
        Name and digest of the robot's description.
    domain, action_set : str
        Names of both.
    actions : mapping of str to MeasuredAction
        Those that the robot can execute, by name.
    left_out : mapping of str to str
        Why it can't execute the others.
    chain : str or None
        The chain that was evaluated; None without one.
    evaluation : mapping or None
        Summary of its evaluation, as in `evaluation.json`.
    variables : tuple of OpenVariable
        What each open variable of the chain is worth, and why if it is worth nothing.
    """

    command: str
    robot: str
    robot_digest: str
    domain: str
    action_set: str
    actions: dict[str, MeasuredAction]
    left_out: dict[str, str]
    chain: str | None
    evaluation: dict[str, Any] | None
    variables: tuple[OpenVariable, ...] = ()
