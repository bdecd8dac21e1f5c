"""Random situations with a chain to execute in them (paper, section 5)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ator_ros.actions.goal_variables import wrong_values
from ator_ros.domains.domain import Domain
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import LeftOutError, TopLibrary
from ator_ros.world.state import World

#: Purposes of the seeds; no range is used for anything else.
SEEDS: Mapping[str, str] = MappingProxyType(
    {
        "1xx": "training episodes",
        "2xx": "episodes that measure the models' accuracy",
        "3xx": "situations that the gate and the calibration are learned from",
        "4xx-8xx": "development",
        "9xx": "quality of the actions, effect of the sensors",
        "1375-1376": "evaluations of a heavy robot, looked at while its actions and its gate were mended",
        "1377": "its evaluation after that",
        "5431": "development, too",
        "2005": "earlier evaluations, looked at while the gate was made",
        "2015": "an evaluation of the paper's actions by a smaller set of models",
        "2017": "an evaluation of the paper's actions, whose failures were looked at while they were mended",
        "2032": "a part of an evaluation of the paper's actions, whose failures were mended",
        "2034": "the same, after that",
        "2035": "an evaluation of the paper's actions, whose longest runs were mended",
        "2036": "the same; its slower runs led to the rule by which the kind of a gate is chosen",
        "2037": "the final evaluation of the paper's actions",
        "2026": "the final evaluation",
        "2027": "the evaluation of the observed models, and their learning curve",
        "2028": "open places, looked at while what limits them was made",
        "2029": "the evaluation of open places",
        "2030": "the final evaluation of the tour",
        "2033": "the dense oracle of open places",
        "2041": "the evaluation of refinement along the way",
        "2042": "the choice among alternatives",
        "2043": "an earlier learning curve of the observed models",
        "3107": "further situations that the calibration is learned from",
        "3108-3110": "errors of earlier calibrations, looked at",
        "3111": "the final errors of calibrated predictions",
    }
)


@dataclass(frozen=True, slots=True)
class Trial:
    """One situation of an evaluation: index, initial state, and plan with open variables."""

    index: int
    world: World
    chain: TopChain


def random_trial(domain: Domain, chain: str, library: TopLibrary, *, seed: int, index: int) -> Trial:
    """Draw situation `index` of the evaluation with this seed; it depends on nothing else.

    Parameters
    ----------
    domain : Domain
        Source of the situation.
    chain : str
        Name of one of its chains.
    library : TopLibrary
        Robot, and TOPs of the chain.
    seed, index : int
        Seed of the evaluation, and index of the situation.

    Raises
    ------
    EvaluationError
        A goal lacks a variable that its action declares, or has another one.
    LeftOutError
        The chain needs a TOP whose action the library's set lacks.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    try:
        world, plan = domain.chains[chain](library.robot, library, rng)
    except LeftOutError as error:
        raise LeftOutError(f"chain {chain} of {domain.name}: {error}") from None
    for step, call in enumerate(plan.calls, start=1):
        if wrong := wrong_values(call.goal, library.goal_variables(call.top)):
            raise EvaluationError(f"chain {chain} of {domain.name}: step {step} ({call.top.name}): {wrong}")
    return Trial(index, world, plan)


def open_speeds(chain: TopChain) -> TopChain:
    """Return the chain with the arrival speeds at its intermediate subgoals left open too."""
    *intermediate, last = chain.calls
    opened = (dataclasses.replace(call, open=call.open | {"speed"}) for call in intermediate)
    return TopChain((*opened, last))


def open_places(chain: TopChain) -> TopChain:
    """Return the chain with speeds open, and all of a subgoal where the next step may begin in a region."""
    following = [*chain.calls[1:], None]
    calls = [
        dataclasses.replace(call, open=call.open | {"x", "y", "yaw", "speed"})
        if after is not None and after.top.pre.relations
        else call
        for call, after in zip(open_speeds(chain).calls, following, strict=True)
    ]
    return TopChain(tuple(calls))


def with_headings(chain: TopChain, headings: Mapping[int, float]) -> TopChain:
    """Return the chain with headings (rad) at some subgoals replaced and committed to."""
    calls = list(chain.calls)
    for index, yaw in headings.items():
        call = calls[index]
        goal = dataclasses.replace(call.goal, pose=call.goal.pose._replace(yaw=float(yaw)))
        calls[index] = dataclasses.replace(call, goal=goal, open=call.open - {"yaw"})
    return TopChain(tuple(calls))
