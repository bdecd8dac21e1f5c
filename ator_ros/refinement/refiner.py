"""Automatic subgoal refinement: a chain in, the refined chain out (paper, section 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ator_ros.actions.goal_variables import goal_values
from ator_ros.refinement.answer import Refinement, SubgoalCurve, remarks, why_nothing_free
from ator_ros.refinement.averaging import Averages
from ator_ros.refinement.bounds import outside_experience, within_experience, within_regions
from ator_ros.refinement.calibration import Calibration
from ator_ros.refinement.chain_model import ChainModel, ChainPrediction, Memory
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.free_variables import (
    Analysis,
    FreeVariable,
    PredictsPerformance,
    analyse,
    names_of,
)
from ator_ros.refinement.gate import Gate, OpenGate, gate_features
from ator_ros.refinement.naive import fastest_alone, replaced
from ator_ros.refinement.objective import Objective, expected_time
from ator_ros.refinement.paths import Optimum
from ator_ros.refinement.regions import Regions
from ator_ros.refinement.room import with_room
from ator_ros.refinement.search import searching, unsearched
from ator_ros.refinement.slices import Slices, completed
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.ranges import USUAL_RANGES, Range, Ranges
from ator_ros.world.state import World

LONGEST_CHAIN = 32
"""Chains of more actions are refused, so that one request cannot occupy a node for long."""
_CUT_SHORT = "its deadline cut the search short"


class Refiner:
    """Rewrites the subgoals of chains so that the whole chain performs best.

    Parameters
    ----------
    robot : Robot
        Sizes and limits.
    models : mapping
        Action name to performance model; an action may lack one.
    gate : Gate, optional
        Decides from the predictions whether refinement pays; by default it always does.
    ranges : mapping, optional
        Goal variable to its range: those of a domain are `TopLibrary.ranges`; by default the usual ones.
    calibration : Calibration, optional
        What the models' predictions miss. It is added to what is reported, and to what a gate judges that
        wants it; the search does without.
    failure_cost : float
        Time in s that one failure costs where a request has no objective of its own, see `expected_time`.
    """

    def __init__(
        self,
        robot: Robot,
        models: Mapping[str, PredictsPerformance],
        gate: Gate | None = None,
        *,
        ranges: Ranges = USUAL_RANGES,
        calibration: Calibration | None = None,
        failure_cost: float = 0.0,
    ) -> None:
        self.robot = robot
        self.failure_cost = failure_cost
        self.models = models
        self.gate = gate if gate is not None else OpenGate()
        self._ranges = ranges
        self._calibration = (calibration or Calibration()).matching(models)

    def refine(
        self,
        world: World,
        chain: TopChain,
        objective: Objective | None = None,
        *,
        placeholders: bool = False,
    ) -> Refinement:
        """Find the best free variables of `chain` from the state `world`, and change it where that pays.

        Parameters
        ----------
        world, chain
            The request; whether the chain is a valid plan from there is not looked at.
        objective : Objective, optional
            What shall be least; by default `expected_time` with the refiner's failure cost.
        placeholders : bool
            The values of free variables are placeholders: the chain compared with is the naive one.

        Raises
        ------
        RefinementError
            The request cannot be evaluated: a chain that is empty or too long, a number that is not finite,
            no finite prediction for any candidate.
        """
        return completed(self.refining(world, chain, objective, placeholders=placeholders))

    def refining(
        self,
        world: World,
        chain: TopChain,
        objective: Objective | None = None,
        *,
        placeholders: bool = False,
    ) -> Slices[Refinement]:
        """Refine as `refine` does, in slices.

        When time is up, placeholders for which no naive value has been searched keep their values.
        """
        objective = objective if objective is not None else expected_time(self.failure_cost)
        analysis, regions = self.bounded(world, chain)
        memory: Memory | None = None  # without placeholders nothing is asked for twice
        if placeholders:
            memory = {}
            chain = yield from fastest_alone(
                world, chain, analysis.free, regions, models=self.models, robot=self.robot, memory=memory
            )
        late = yield
        model = ChainModel(
            world, chain, self.robot,
            models=self.models, free=analysis.free, objective=objective, memory=memory,
        )  # fmt: skip
        if not analysis.free:
            prediction = yield from model.predicting(model.given)
            yield
            told = self._corrected(world, (chain,), (prediction,), (), objective)
            return self._left_alone(chain, analysis, *told)
        if late:
            before = after = yield from model.predicting(model.given)
            optimum = unsearched(model.given, before.cost)
        else:
            axes, allowed = _axes(chain, analysis.free), regions.allowing()
            cost = with_room(model.step_cost, chain, model.names, self.robot, self.gate.room)
            optimum = yield from searching(cost, axes, model.given, allowed, self._averages(model, axes))
            before = yield from model.predicting(model.given)
            after = yield from model.predicting(optimum.values)
        yield
        if not math.isfinite(optimum.cost):
            raise RefinementError(
                "expected a finite prediction for some candidate, got none: check the distances"
            )
        return self._answer(world, chain, analysis, model, optimum, objective, (before, after))

    def _corrected(
        self,
        world: World,
        chains: Sequence[TopChain],
        predictions: Sequence[ChainPrediction],
        free: Sequence[FreeVariable],
        objective: Objective,
    ) -> list[ChainPrediction]:
        """Return the predictions of chains of the same TOPs with what they are expected to miss added."""
        predicted = list(zip(chains, predictions, strict=True))
        turned = {variable.subgoal for variable in free if variable.name == "yaw"}
        chosen = [index in turned for index in range(len(chains[0].calls))]
        return self._calibration.corrected(
            predicted, world, self.models, self.robot, objective, chosen=chosen
        )

    def naive(self, world: World, chain: TopChain) -> TopChain:
        """Return the chain that the paper compares with: each subgoal suits the action leading to it alone.

        Free variables with a rest value (arrival speed: 0) take it; the others those at which the action is
        predicted to be fastest. What changes only the action after it keeps its value.

        Raises
        ------
        RefinementError
            As in `refine`.
        """
        analysis, regions = self.bounded(world, chain)
        return completed(
            fastest_alone(
                world, chain, analysis.free, regions, models=self.models, robot=self.robot, memory={}
            )
        )

    def analyse(self, world: World, chain: TopChain) -> Analysis:
        """Return the free variables of `chain`, and those that it opens in vain.

        Raises
        ------
        RefinementError
            The chain is empty or too long, or a number is not finite.
        """
        if not 1 <= len(chain.calls) <= LONGEST_CHAIN:
            raise RefinementError(f"chain: expected 1 to {LONGEST_CHAIN} actions, got {len(chain.calls)}")
        robot = world.robot
        if not all(map(math.isfinite, (*robot.pose, robot.v, robot.w))):
            raise RefinementError(f"robot: expected a finite state, got {robot}")
        for index, call in enumerate(chain.calls):
            for name, value in goal_values(call.goal).items():
                if not math.isfinite(value):
                    raise RefinementError(
                        f"{name} of step {index + 1} ({call.top.name}): expected a finite number, got {value}"
                    )
        return analyse(chain, self.models, self.robot, self._ranges)

    def bounded(self, world: World, chain: TopChain) -> tuple[Analysis, Regions]:
        """Return the analysis of `chain` with its variables bounded by regions and experience, and these.

        Raises
        ------
        RefinementError
            As in `analyse`.
        """
        analysis = self.analyse(world, chain)
        outside = outside_experience(world, chain, self.models, self.robot)
        analysis = within_experience(analysis, chain, self.models, outside)
        regions = Regions(world, chain, self.robot, names_of(chain, analysis.free), self.models)
        if regions.allowing() is None:
            return analysis, regions
        analysis = within_regions(analysis, regions, chain)
        return analysis, regions.narrowed_to(names_of(chain, analysis.free))

    def _averages(self, model: ChainModel, axes: Sequence[Sequence[Range]]) -> Averages | None:
        """Return how the gate wants costs to be averaged; None where it does not."""
        widths = [[self.gate.widths.get(name, 0.0) for name in names] for names in model.names]
        return Averages(axes, widths) if any(map(any, widths)) else None

    def _answer(
        self,
        world: World,
        chain: TopChain,
        analysis: Analysis,
        model: ChainModel,
        optimum: Optimum,
        objective: Objective,
        predicted: tuple[ChainPrediction, ChainPrediction],
    ) -> Refinement:
        best = chain
        for index, names in enumerate(model.names):
            if names:
                best = replaced(best, index, dict(zip(names, optimum.values[index], strict=True)))
        told = self._corrected(world, (chain, best), predicted, analysis.free, objective)
        judged = told if self.gate.corrected else predicted
        averaged = math.inf if optimum.given is None else optimum.given - optimum.cost
        features = gate_features(world, chain, best, *judged, averaged=averaged)
        pays, reason = self.gate.decide(features)
        limited = any(variable.limits for variable in analysis.free)
        invalid = best.violations(world, self.robot) if limited else []
        changed = pays and best != chain and not invalid
        if pays and best == chain:
            reason = "the chain is the best already"
        elif invalid:
            reason = f"the best chain found is no valid plan: {'; '.join(invalid)}"
        if not optimum.complete:
            reason = f"{reason}; {_CUT_SHORT}"
        lacking = self._without_model(chain)
        return Refinement(
            best if changed else chain,
            changed,
            reason + remarks(chain, analysis.not_free, lacking, analysis.outside),
            original=chain,
            best=best,
            before=told[0],
            after=told[1],
            free=analysis.free,
            not_free=analysis.not_free,
            without_model=lacking,
            curves=_curves(model, optimum),
            features=features,
            complete=optimum.complete,
        )

    def _left_alone(self, chain: TopChain, analysis: Analysis, prediction: ChainPrediction) -> Refinement:
        """Return the answer where nothing is free."""
        lacking = self._without_model(chain)
        return Refinement(
            chain,
            False,
            why_nothing_free(chain, analysis.not_free) + remarks(chain, (), lacking, analysis.outside),
            original=chain,
            best=chain,
            before=prediction,
            after=prediction,
            not_free=analysis.not_free,
            without_model=lacking,
        )

    def _without_model(self, chain: TopChain) -> tuple[int, ...]:
        return tuple(step for step, call in enumerate(chain.calls) if call.top.action not in self.models)


def _curves(model: ChainModel, optimum: Optimum) -> tuple[SubgoalCurve, ...]:
    return tuple(
        SubgoalCurve(index, names, curve.values, curve.totals)
        for index, (names, curve) in enumerate(zip(model.names, optimum.curves, strict=True))
        if names
    )


def _axes(chain: TopChain, free: Sequence[FreeVariable]) -> list[list[Range]]:
    return [
        [variable.domain for variable in free if variable.subgoal == index]
        for index in range(len(chain.calls))
    ]
