"""The chain that the paper compares with: each subgoal suits the action leading to it alone."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

from ator_ros.actions.goal_variables import direct_name, with_values
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_model import ChainModel, Memory
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.free_variables import FreeVariable, PredictsPerformance
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.regions import Regions
from ator_ros.refinement.sampled import NoCandidateError
from ator_ros.refinement.search import searching
from ator_ros.refinement.slices import Slices
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World


def fastest_alone(
    world: World,
    chain: TopChain,
    free: Sequence[FreeVariable],
    regions: Regions,
    *,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
    memory: Memory,
) -> Slices[TopChain]:
    """Return `chain` with naive values of its free variables, in slices.

    Those with a rest value (arrival speed: 0) take it; the others those at which the action that leads to
    their subgoal is predicted to be fastest. What changes only the action after it keeps its value, and so
    does what is bounded by a region in which no candidate is found.

    Raises
    ------
    RefinementError
        There is no finite prediction for a subgoal.
    """
    resting = [variable for variable in free if variable.domain.rest is not None]
    for variable in resting:
        chain = replaced(chain, variable.subgoal, {variable.name: variable.domain.rest or 0.0})
    searched = [v for v in free if v.domain.rest is None and _is_used(chain, v, models)]
    for index in sorted({variable.subgoal for variable in searched}):
        alone = [variable for variable in searched if variable.subgoal == index]
        late = yield
        if late:
            break
        part, objective = TopChain(chain.calls[: index + 1]), Objective()
        model = ChainModel(world, part, robot, models=models, free=alone, objective=objective, memory=memory)
        cost = functools.partial(_cost_of_step, model, index)
        allowed = regions.of_subgoal(chain, index, model.names[index])
        try:
            optimum = yield from searching(cost, [[variable.domain for variable in alone]], allowed=allowed)
        except NoCandidateError:  # the region is tiny: what is given is the only candidate
            continue
        if not math.isfinite(optimum.cost):
            top = chain.calls[index].top.name
            raise RefinementError(f"step {index + 1} ({top}): expected a finite prediction, got none")
        chain = replaced(chain, index, dict(zip(model.names[index], optimum.values[0], strict=True)))
    return chain


def replaced(chain: TopChain, index: int, values: Mapping[str, float]) -> TopChain:
    """Return the chain with some goal variables of a subgoal replaced."""
    return chain.with_goal(index, with_values(chain.calls[index].goal, values))


def _is_used(chain: TopChain, variable: FreeVariable, models: Mapping[str, PredictsPerformance]) -> bool:
    """Return whether the model of the action that leads to a subgoal uses its variable."""
    model = models[chain.calls[variable.subgoal].top.action]
    return direct_name(variable.name) in model.used_variables


def _cost_of_step(model: ChainModel, index: int, _: int, before: FloatArray, after: FloatArray) -> FloatArray:
    return model.step_cost(index, before, after)
