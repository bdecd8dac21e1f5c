"""Automatic subgoal refinement: a chain in, the refined chain out (paper, section 4)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.geometry import FloatArray
from ator_ros.refinement.answer import Refinement, SubgoalCurve
from ator_ros.refinement.calibration import Calibration
from ator_ros.refinement.chain_model import ChainModel, ChainPrediction, Memory
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.free_variables import (
    DOMAINS,
    Analysis,
    Domain,
    FreeVariable,
    PerformanceModel,
    analyse,
    goal_values,
    with_values,
)
from ator_ros.refinement.gate import Gate, OpenGate, gate_features
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.search import Optimum, search
from ator_ros.robot import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world import World

LONGEST_CHAIN = 32
"""Chains of more actions are refused, so that one request cannot occupy a node for long."""


class Refiner:
    """Rewrites the subgoals of chains so that the whole chain performs best.

    Parameters
    ----------
    robot : Robot
        Sizes and limits.
    models : mapping
        Action name to performance model.
    gate : Gate, optional
        Decides from the predictions whether refinement pays; by default it always does.
    domains : mapping, optional
        Goal variable to its domain.
    calibration : Calibration, optional
        What the models' predictions miss; it is added to what is reported, after everything is decided.
    """

    def __init__(
        self,
        robot: Robot,
        models: Mapping[str, PerformanceModel],
        gate: Gate | None = None,
        *,
        domains: Mapping[str, Callable[[Robot, Goal], Domain]] = DOMAINS,
        calibration: Calibration | None = None,
    ) -> None:
        self.robot = robot
        self.models = models
        self.gate = gate if gate is not None else OpenGate()
        self._domains = domains
        self._calibration = (calibration or Calibration()).matching(models)

    def refine(self, world: World, chain: TopChain, objective: Objective | None = None) -> Refinement:
        """Find the best free variables of `chain` from the state `world`, and change it where that pays.

        A free variable that is NaN in the request is open: the chain is then compared with the naive one.

        Raises
        ------
        RefinementError
            The request cannot be evaluated: a chain that is empty or too long, an action without a model, a
            number that is not finite where it must be.
        """
        objective = objective if objective is not None else Objective()
        analysis = self.analyse(world, chain)
        if not analysis.free:
            reason = "nothing is free: " + "; ".join(analysis.reasons)
            return Refinement(chain, False, reason, chain, chain)
        memory: Memory = {}
        if any(math.isnan(_value(chain, variable)) for variable in analysis.free):
            chain = self._fastest_alone(world, chain, analysis.free, memory)
        with np.errstate(all="ignore"):
            model = self._model(world, chain, analysis.free, objective, memory)
            given = [_values(chain, index, names) for index, names in enumerate(model.names)]
            optimum = search(model.step_cost, _axes(chain, analysis.free), given)
            before, after = model.predict(given), model.predict(optimum.values)
        if not math.isfinite(optimum.cost):
            raise RefinementError(
                "expected a finite prediction for some candidate, got none: check the distances"
            )
        answer = self._answer(world, chain, analysis.free, model, optimum, before, after)
        return self._calibrated(world, answer, objective)

    def _calibrated(self, world: World, answer: Refinement, objective: Objective) -> Refinement:
        """Return the answer with what its predictions are expected to miss added."""
        if answer.before is None or answer.after is None:
            return answer
        told = [(answer.original, answer.before), (answer.best, answer.after)]
        before, after = self._calibration.corrected(told, world, self.models, self.robot, objective)
        return dataclasses.replace(answer, before=before, after=after)

    def naive(self, world: World, chain: TopChain) -> TopChain:
        """Give the chain that the paper compares with: each subgoal suits the action that leads to it alone.

        Free variables with a rest value (arrival speed: 0) take it; the others those at which the action is
        predicted to be fastest.

        Raises
        ------
        RefinementError
            As in `refine`.
        """
        return self._fastest_alone(world, chain, self.analyse(world, chain).free, {})

    def _fastest_alone(
        self, world: World, chain: TopChain, free: Sequence[FreeVariable], memory: Memory
    ) -> TopChain:
        resting = [variable for variable in free if variable.domain.rest is not None]
        for variable in resting:
            chain = _replaced(chain, variable.subgoal, {variable.name: variable.domain.rest or 0.0})
        searched = [variable for variable in free if variable.domain.rest is None]
        for index in sorted({variable.subgoal for variable in searched}):
            alone = [variable for variable in searched if variable.subgoal == index]
            with np.errstate(all="ignore"):
                calls = chain.calls[: index + 1]
                model = self._model(world, TopChain(calls), alone, Objective(), memory)
                axes = _axes(chain, alone)
                optimum = search(_only(model, index), axes[: index + 1])
            if not math.isfinite(optimum.cost):
                raise RefinementError(f"subgoal {index + 1}: expected a finite prediction, got none")
            chain = _replaced(chain, index, dict(zip(model.names[index], optimum.values[index], strict=True)))
        return chain

    def analyse(self, world: World, chain: TopChain) -> Analysis:
        """Give the free variables of `chain`, which need not be open yet.

        Raises
        ------
        RefinementError
            As in `refine`.
        """
        if not 1 <= len(chain.calls) <= LONGEST_CHAIN:
            raise RefinementError(f"chain: expected 1 to {LONGEST_CHAIN} actions, got {len(chain.calls)}")
        for call in chain.calls:
            if call.top.action not in self.models:
                raise RefinementError(
                    f"chain: expected actions with a performance model, {sorted(self.models)}, "
                    f"got {call.top.action!r}"
                )
        robot = world.robot
        if not all(map(math.isfinite, (*robot.pose, robot.v, robot.w))):
            raise RefinementError(f"robot: expected a finite state, got {robot}")
        analysis = analyse(chain, self.models, self.robot, self._domains)
        free = {(variable.subgoal, variable.name) for variable in analysis.free}
        for index, call in enumerate(chain.calls):
            for name, value in goal_values(call.goal).items():
                if not math.isfinite(value) and not (math.isnan(value) and (index, name) in free):
                    raise RefinementError(
                        f"{name} of subgoal {index + 1} ({call.top.name}): "
                        f"expected a finite number, got {value}"
                    )
        return analysis

    def _model(
        self,
        world: World,
        chain: TopChain,
        free: Sequence[FreeVariable],
        objective: Objective,
        memory: Memory,
    ) -> ChainModel:
        return ChainModel(
            world, chain, self.robot, models=self.models, free=free, objective=objective, memory=memory
        )

    def _answer(
        self,
        world: World,
        chain: TopChain,
        free: tuple[FreeVariable, ...],
        model: ChainModel,
        optimum: Optimum,
        before: ChainPrediction,
        after: ChainPrediction,
    ) -> Refinement:
        curves = tuple(
            SubgoalCurve(index, names, curve.values, curve.totals)
            for index, (names, curve) in enumerate(zip(model.names, optimum.curves, strict=True))
            if names
        )
        best = chain
        for index, names in enumerate(model.names):
            if names:
                best = _replaced(best, index, dict(zip(names, optimum.values[index], strict=True)))
        features = gate_features(world, chain, best, before, after)
        pays, reason = self.gate.decide(features)
        changed = pays and best != chain
        if pays and not changed:
            reason = "the chain is the best already"
        answer = best if changed else chain
        return Refinement(answer, changed, reason, chain, best, free, before, after, curves, features)


def _replaced(chain: TopChain, index: int, values: Mapping[str, float]) -> TopChain:
    return chain.with_goal(index, with_values(chain.calls[index].goal, values))


def _value(chain: TopChain, variable: FreeVariable) -> float:
    return goal_values(chain.calls[variable.subgoal].goal)[variable.name]


def _values(chain: TopChain, index: int, names: Sequence[str]) -> FloatArray:
    values = goal_values(chain.calls[index].goal)
    return np.array([values[name] for name in names], dtype=float)


def _axes(chain: TopChain, free: Sequence[FreeVariable]) -> list[list[Domain]]:
    return [
        [variable.domain for variable in free if variable.subgoal == index]
        for index in range(len(chain.calls))
    ]


def _only(model: ChainModel, index: int) -> Callable[[int, FloatArray, FloatArray], FloatArray]:
    """Give the step cost that counts the action `index` only."""

    def cost(step: int, before: FloatArray, after: FloatArray) -> FloatArray:
        return model.step_cost(step, before, after) if step == index else np.zeros(1)

    return cost
