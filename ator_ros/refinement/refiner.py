"""Subgoal refinement: a chain in, the refined chain out (paper, section 4)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from ator_ros.actions.goal_variables import STOP, direct_name, with_values
from ator_ros.bases.description import Robot
from ator_ros.geometry import FloatArray
from ator_ros.performance.path_times import path_times_remark
from ator_ros.printable import printable
from ator_ros.refinement import RefinementError
from ator_ros.refinement.chain_prediction import (
    ChainModel,
    ChainPrediction,
    GainError,
    PredictsPerformance,
    predict_chain,
    values_of,
)
from ator_ros.refinement.free_variables import (
    Analysis,
    FreeVariable,
    NotFree,
    Regions,
    analyze,
    names_of,
    outside_experience,
    within_regions,
)
from ator_ros.refinement.gate import KEPT_AS_SENT, KEPT_NAIVE, NO_GATE, Gate
from ator_ros.refinement.naive import naive_on_paths
from ator_ros.refinement.objective import Objective, expected_time
from ator_ros.refinement.order import OrderSearch
from ator_ros.refinement.search import (
    Deadline,
    NoCandidateError,
    Optimum,
    Work,
    expected_work,
    no_deadline,
    search,
    unsearched,
)
from ator_ros.tops.chain import InvalidChainError, TopChain, projected
from ator_ros.tops.ordering import Ordering, in_valid_order, ordering_of
from ator_ros.tops.ranges import USUAL_RANGES, Range, Ranges
from ator_ros.world.state import World

LONGEST_CHAIN = 100
"""Most actions of a chain: longer ones would occupy a node for long."""
MOST_ALTERNATIVES = 4
"""Most alternative chains of a request."""
LONGEST_ALTERNATIVE = 25
"""Most actions of each: reading one takes up to 0.15 ms, in which a running goal has to wait."""
_MOST_LISTED = 6
_LONGEST_REASONS = 180  # characters of the reasons of all chains, without their names
_SHORTEST_REASON = 50  # characters of each
_MOST_ORDERS = 6  # orders whose free variables are searched
# Orders whose cost on the grid is this much above the least one on it are not searched: the search
# between the points of the grid lowers the costs of orders of a round by shares that differ less.
_PROMISING = 1.015
# Two starts of a search in a building end up to 0.15 % apart.
_NEAR = 1.002
_MOST_NUMBERS = 12  # steps of an order that a reason lists
_DOMINANT = 0.5  # least share of durations in the cost for which a gain is given in s
ITS_DEADLINE = "its deadline"
"""In the reason of every answer whose search was cut short."""


@dataclass(frozen=True, slots=True)
class SubgoalCurve:
    """The `SearchCurve` of a call of the request (from 0).

    `values` are those (m, rad, m/s) of its variables `names`.
    """

    subgoal: int
    names: tuple[str, ...]
    values: FloatArray
    totals: FloatArray


@dataclass(frozen=True, slots=True)
class Refinement:
    """The answer to a request.

    Attributes
    ----------
    refined, reason
        Whether a subgoal is changed, and why.
    original, best : TopChain
        The reference, which is the chain of the request with naive values for placeholders, and the
        best chain found. `TopChain.order` has the indices of its calls in the request.
    before, after : ChainPrediction
        Predictions for `original` and for `best`.
    free, not_free
        The variables that were free, and those that the plan opens and that were not, with the
        reasons. Their subgoals, and those of `curves`, are the calls of the request.
    complete : bool
        Whether the search was completed; otherwise `best` is the best found until the deadline.
    work : Work
        How much of the search is done, to estimate the deadline that the whole needs.
    error : GainError
        What the models may be wrong by in the predicted gain in duration.
    comparison : bool
        Whether it would have been refined, but `original` runs, to measure the gain of refinement.
    """

    refined: bool
    reason: str
    original: TopChain
    best: TopChain
    before: ChainPrediction
    after: ChainPrediction
    free: tuple[FreeVariable, ...] = ()
    not_free: tuple[NotFree, ...] = ()
    curves: tuple[SubgoalCurve, ...] = ()
    complete: bool = True
    work: Work = field(default_factory=Work)
    error: GainError = field(default_factory=GainError)
    comparison: bool = False

    @property
    def gain(self) -> float:
        """The predicted gain of `best` over `original`, in s where only durations count."""
        return self.before.cost - self.after.cost

    @property
    def saved(self) -> float:
        """The expected gain in duration, in s: the predicted one and its expected error.

        Delays by being held up count where they depend on the situation.
        """
        gain = self.before.duration - self.after.duration + self.error.expected
        return gain + self.before.delay - self.after.delay

    @property
    def uncertainty(self) -> float:
        """Of `saved`, in s."""
        return self.error.deviation

    @property
    def chain(self) -> TopChain:
        """The chain to execute: the best one found, or the original if no subgoal is changed."""
        return self.best if self.refined else self.original

    @property
    def predicted(self) -> ChainPrediction:
        """The prediction of the chain to execute."""
        return self.after if self.refined else self.before


class Refiner:
    """Rewrites the subgoals of chains so that the whole chain performs best.

    Parameters
    ----------
    models : mapping
        Action name to performance model, such as those of `models_for`.
    gate : Gate, optional
        Decides from the predictions whether refinement pays; by default it always does.
    ranges : mapping, optional
        Goal variable to its range: those of a domain are `TopLibrary.ranges`; by default the usual
        ones.
    failure_cost : float
        Time in s that one failure costs where a request has no objective of its own, see
        `expected_time`.
    """

    def __init__(
        self,
        robot: Robot,
        models: Mapping[str, PredictsPerformance],
        gate: Gate = NO_GATE,
        *,
        ranges: Ranges = USUAL_RANGES,
        failure_cost: float = 0.0,
    ) -> None:
        self.robot = robot
        self.failure_cost = failure_cost
        self.models = models
        self.gate = gate
        self.ranges = ranges

    def refine(
        self,
        world: World,
        chain: TopChain,
        objective: Objective | None = None,
        *,
        placeholders: bool = False,
        deadline: Deadline = no_deadline,
    ) -> Refinement:
        """Find the best free variables of `chain` from the state `world`; the gate decides.

        Raises RefinementError if the chain is empty or too long, an action has no model, or no
        candidate has a finite prediction. Raises InvalidChainError if its precedences cannot hold.

        Parameters
        ----------
        world, chain
            The request; whether the chain is a valid plan is not checked.
        objective : Objective, optional
            Defines the cost; by default `expected_time` with the refiner's failure cost.
        placeholders : bool
            The values of free variables are placeholders: the reference is the naive chain.
        deadline : callable, optional
            Returns whether time is up; then the answer is the best chain found until then. Naive
            values that the models have not predicted until then are those of `naive_on_paths`.
        """
        objective = objective if objective is not None else expected_time(self.failure_cost)
        ordering = ordering_of(chain)
        analysis, regions = self.bounded(world, chain)
        names = names_of(chain, analysis.free)
        work = Work(expected=expected_work(_axes(chain, analysis)))
        if placeholders:
            chain = naive_on_paths(world, chain, self.robot, self.ranges)
            chain = self._fastest_alone(world, chain, analysis.free, regions, deadline, work)
        model = ChainModel(
            world, chain, self.robot, models=self.models, names=names, objective=objective
        )
        reference = _Searched(chain, analysis, regions, model, unsearched(model.given, math.nan))
        may_pass = any(variable.name == STOP for variable in analysis.free)
        if ordering.is_open or may_pass:
            best = self._ordered(world, reference, ordering, deadline, work)
        elif analysis.free:
            best = self._searched(world, reference, reference.model, deadline, work)
        else:
            return self._left_alone(chain, analysis, model)
        kept = KEPT_NAIVE if placeholders else KEPT_AS_SENT
        return self._answer(world, reference, best, work, kept)

    def _searched(
        self,
        world: World,
        start: _Searched,
        reference: ChainModel,
        deadline: Deadline,
        work: Work,
        given: TopChain | None = None,
    ) -> _Searched:
        """Return a chain with the best values of its free variables; unchanged without time.

        `given` has the values from which a searched chain is searched again.
        """
        if deadline():
            return start
        model = start.model
        optimum = search(
            model.step_costs,
            _axes(start.chain, start.analysis),
            model.given if given is None else values_of(given, model.names),
            allowed=start.regions.allowing(),
            first_costs=start.optimum.first_costs,
            deadline=deadline,
            work=work,
        )
        found = dataclasses.replace(start, optimum=optimum)
        if any({"x", "y"} & set(own) for own in model.names):
            return self._at_its_places(world, start, found, reference)
        return found

    def _at_its_places(
        self,
        world: World,
        start: _Searched,
        found: _Searched,
        reference: ChainModel,
    ) -> _Searched:
        """Return a chain whose places were searched, with the prediction for them.

        A search assumes that the robot comes to each place in the direction from that before it as
        they were at its start. If the prediction for the places found is no better than that for
        the values at the start, these are the best ones.
        """
        chain = found.refined
        model = ChainModel(
            world,
            chain,
            self.robot,
            models=self.models,
            names=found.model.names,
            objective=reference.objective,
            reference=reference,
        )
        cost = model.predict().cost
        before = start.predicted()
        optimum = dataclasses.replace(found.optimum, cost=cost, first_costs=())
        if cost <= before.optimum.cost:
            return dataclasses.replace(found, model=model, optimum=optimum)
        kept = dataclasses.replace(optimum, values=before.optimum.values, cost=before.optimum.cost)
        return dataclasses.replace(found, model=before.model, optimum=kept)

    def _ordered(
        self,
        world: World,
        reference: _Searched,
        ordering: Ordering,
        deadline: Deadline,
        work: Work,
    ) -> _Searched:
        """Return the chain in the best order and with the best stops, with the best values.

        Only the values of other free variables than `STOP` are searched again without a grid.
        """
        chain = reference.chain
        model = reference.model
        orders = OrderSearch(
            world,
            chain,
            ordering,
            self.robot,
            models=self.models,
            objective=model.objective,
            names=model.names,
            axes=_axes(chain, reference.analysis),
            allowed=reference.regions.allowing(),
        ).chains(_MOST_ORDERS, deadline, work)
        starts = []
        for candidate, cost in orders:
            starts.append((candidate, cost))
            if candidate.order == chain.order:  # its own values may lead to better ones
                starts.append((chain, cost))
        if not starts and not deadline():  # no order on the grid is a valid plan
            starts.append((chain, math.inf))
        best = reference.predicted()
        found: list[_Searched] = []
        for candidate, cost in starts:
            if cost > _PROMISING * starts[0][1] or (found and deadline()):
                break
            found.append(self._searched_from(world, candidate, reference, deadline, work))
            best = self._better(world, best, found[-1])
        # A search may end in a valley beside the best one, above all on a map, where routes change
        # at once: another start decides between orders that are nearly the best.
        for each in found:
            is_near = each.optimum.cost <= _NEAR * best.optimum.cost
            if not is_near or deadline() or any(call.passing for call in each.chain.calls):
                continue
            free = each.analysis.free
            naive = self._fastest_alone(world, each.chain, free, each.regions, deadline, work)
            again = self._searched(world, each, model, deadline, work, naive)
            best = self._better(world, best, again)
        best = self._with_other_stops(world, best, reference, deadline, work)
        optimum = dataclasses.replace(best.optimum, complete=not deadline())
        return dataclasses.replace(best, optimum=optimum)

    def _with_other_stops(
        self,
        world: World,
        best: _Searched,
        reference: _Searched,
        deadline: Deadline,
        work: Work,
    ) -> _Searched:
        """Return the best chain after each stop was tried the other way.

        On the table a robot passes a call in one of few directions. Where sharp turns are held up,
        a few degrees decide.
        """
        chain = best.refined
        cost = best.optimum.cost
        changed = chain
        for variable in reference.analysis.free:
            if variable.name != STOP or deadline():
                continue
            place = chain.order.index(reference.chain.order[variable.subgoal])
            goal = changed.calls[place].goal
            other = changed.with_goal(place, with_values(goal, {STOP: 1.0 - goal.values[STOP]}))
            if other.violations(world, self.robot):
                continue
            predicted = predict_chain(
                world, other, self.models, self.robot, reference.model.objective
            )
            if predicted.cost < cost:
                changed = other
                cost = predicted.cost
        if changed is chain:
            return best
        found = self._searched_from(world, changed, reference, deadline, work)
        return self._better(world, best, found)

    def _searched_from(
        self,
        world: World,
        chain: TopChain,
        reference: _Searched,
        deadline: Deadline,
        work: Work,
    ) -> _Searched:
        """Return a chain in another order than the reference, searched from its values."""
        analysis, regions = self.bounded(world, chain, stops_decided=True)
        model = ChainModel(
            world,
            chain,
            self.robot,
            models=self.models,
            names=names_of(chain, analysis.free),
            objective=reference.model.objective,
            reference=reference.model,
        )
        start = _Searched(chain, analysis, regions, model, unsearched(model.given, math.nan))
        return self._searched(world, start, reference.model, deadline, work).predicted()

    def _better(self, world: World, best: _Searched, other: _Searched) -> _Searched:
        """Return the one with the lower cost; `other` only if it is a valid plan."""
        if other.optimum.cost >= best.optimum.cost:
            return best
        return best if other.refined.violations(world, self.robot) else other

    def naive(self, world: World, chain: TopChain) -> TopChain:
        """Return the paper's reference: each subgoal is optimal for the action that leads to it.

        Free variables with a rest value (arrival speed: 0) take it, and `STOP` keeps its value. The
        others take the value at which the action is predicted to be fastest. Where no model uses
        them, the value is that of `naive_on_paths`. Raises RefinementError as `refine` does.
        """
        analysis, regions = self.bounded(world, chain)
        on_paths = naive_on_paths(world, chain, self.robot, self.ranges)
        return self._fastest_alone(world, on_paths, analysis.free, regions, no_deadline, Work())

    def _fastest_alone(
        self,
        world: World,
        chain: TopChain,
        free: Sequence[FreeVariable],
        regions: Regions,
        deadline: Deadline,
        work: Work,
    ) -> TopChain:
        """Return `chain` with naive values of its free variables, by models until the deadline."""
        for variable in free:
            if variable.domain.rest is not None and variable.name != STOP:
                chain = replaced(chain, variable.subgoal, {variable.name: variable.domain.rest})
        searched = [
            v
            for v in free
            if v.domain.rest is None
            and direct_name(v.name) in self.models[chain.calls[v.subgoal].top.action].used_variables
        ]
        alone_at = {
            index: [variable for variable in searched if variable.subgoal == index]
            for index in sorted({variable.subgoal for variable in searched})
        }
        domains = {index: [[v.domain for v in alone]] for index, alone in alone_at.items()}
        work.expected += math.fsum(map(expected_work, domains.values()))
        first = 0  # the step before the one that is searched, which starts in `world`
        for index, alone in alone_at.items():
            if deadline():
                break
            for call in chain.calls[first : max(index - 1, 0)]:
                world = projected(world, call, self.robot)
            first = max(first, index - 1)
            part = TopChain(chain.calls[first : index + 1])
            names = tuple(variable.name for variable in alone)
            model = ChainModel(
                world,
                part,
                self.robot,
                models=self.models,
                names=[*[()] * (index - first), names],
                objective=Objective(),
            )
            costs = model.costs_of_step(index - first)
            allowed = regions.of_subgoal(chain, index, names)
            try:
                optimum = search(costs, domains[index], allowed=allowed, deadline=deadline)
            except NoCandidateError:  # the region is tiny: the given value is the only candidate
                continue
            finally:  # the evaluations are few, and it takes as long as estimated to set them up
                work.done += expected_work(domains[index])
            if not math.isfinite(optimum.cost):
                raise RefinementError(
                    f"{chain.step_name(index)}: expected a finite prediction, got none"
                )
            fastest = dict(zip(names, optimum.values[0], strict=True))
            chain = replaced(chain, index, fastest)
        return chain

    def bounded(
        self, world: World, chain: TopChain, *, stops_decided: bool = False
    ) -> tuple[Analysis, Regions]:
        """Return the free variables of `chain`, bounded by regions, and the regions.

        `stops_decided` is as for `analyze`. Raises RefinementError if the chain is empty or too
        long, or an action has no model.
        """
        if not 1 <= len(chain.calls) <= LONGEST_CHAIN:
            raise RefinementError(
                f"chain: expected 1 to {LONGEST_CHAIN} actions, got {len(chain.calls)}"
            )
        if lacking := {call.top.action for call in chain.calls} - self.models.keys():
            raise RefinementError(
                f"expected a performance model of each action, found none of "
                f"{', '.join(sorted(lacking))}"
            )
        analysis = analyze(chain, self.models, self.robot, self.ranges, stops_decided=stops_decided)
        outside = outside_experience(world, chain, self.models, self.robot)
        analysis = dataclasses.replace(analysis, outside=outside)
        regions = Regions(world, chain, self.robot, names_of(chain, analysis.free))
        if not regions.narrow:
            return analysis, regions
        analysis = within_regions(analysis, regions, chain)
        return analysis, Regions(world, chain, self.robot, names_of(chain, analysis.free))

    def _answer(
        self,
        world: World,
        reference: _Searched,
        found: _Searched,
        work: Work,
        kept: str,
    ) -> Refinement:
        """Return the answer after a search: the gate decides."""
        chain = reference.chain
        best = found.refined
        analysis = found.analysis
        optimum = found.optimum
        objective = found.model.objective
        before, after, error = found.model.compare(reference.model.given, optimum.values)
        if math.isnan(optimum.cost):
            optimum = unsearched(optimum.values, after.cost)
        if not math.isfinite(optimum.cost):
            raise RefinementError(
                "expected a finite prediction for some candidate, got none: check the distances"
            )
        free = _as_sent(analysis.free, best.order)
        not_free = _as_sent(analysis.not_free, best.order)
        if analysis is not reference.analysis:  # the stops are decided in it
            stops = [each for each in reference.analysis.free if each.name == STOP]
            kept_stops = [each for each in reference.analysis.not_free if each.name == STOP]
            free = (*free, *_as_sent(stops, chain.order))
            not_free = (*not_free, *_as_sent(kept_stops, chain.order))
        gain = _gain(before, after, objective)
        known = None
        if _in_seconds(before, objective):
            gain = self.gate.judged(gain, error)
            known = error.deviation
        refine, reason = self.gate.decide(gain, known, kept)
        limited = any(variable.limits for variable in analysis.free)
        invalid = best.violations(world, self.robot) if limited else []
        if invalid:
            reason = f"the best chain found is no valid plan: {'; '.join(invalid)}"
        others = objective.of_unknown_uncertainty
        if refine and known is not None and others:
            reason = f"{reason}; the uncertainty of {' and '.join(others)} is unknown"
        if best.order != chain.order:
            reason = f"{reason}; best order {_numbers(best.order)}"
        if not optimum.complete:
            if optimum.searched or best != chain:
                reason = f"{reason}; {ITS_DEADLINE} cut the search short"
            else:
                reason = f"{kept} without a search, as {ITS_DEADLINE} had passed"
        possible = best != chain and not invalid
        if known is not None and self.gate.least < gain <= self.gate.factor * known:
            reason += self._not_varied(chain)
        comparison = possible and not refine and self.gate.drawn and self.gate.pays(gain, known)
        return Refinement(
            refine and possible,
            reason + self._remarks(best, analysis, analysis.not_free),
            original=chain,
            best=best,
            before=before,
            after=after,
            free=free,
            not_free=not_free,
            curves=tuple(
                SubgoalCurve(best.order[index], names, *curve)
                for index, (names, curve) in enumerate(
                    zip(found.model.names, optimum.curves, strict=True)
                )
                if names
            ),
            complete=optimum.complete,
            work=work,
            error=error,
            comparison=comparison,
        )

    def _left_alone(
        self,
        chain: TopChain,
        analysis: Analysis,
        model: ChainModel,
    ) -> Refinement:
        """Return the answer if no variable is free."""
        prediction = model.predict()
        reason = "nothing is open: the plan commits to every goal variable"
        if any(call.open for call in chain.calls):
            reason = f"nothing is free: {_described(chain, analysis.not_free)}"
        return Refinement(
            False,
            reason + self._remarks(chain, analysis, ()),
            original=chain,
            best=chain,
            before=prediction,
            after=prediction,
            not_free=_as_sent(analysis.not_free, chain.order),
        )

    def _not_learned(self, chain: TopChain) -> str:
        """Return a remark on the actions whose models predict path times; may be empty."""
        actions = dict.fromkeys(call.top.action for call in chain.calls)
        return path_times_remark(
            name for name in actions if not getattr(self.models[name], "is_learned", True)
        )

    def _not_varied(self, chain: TopChain) -> str:
        """Return a remark on features that no drive varied, after a semicolon; may be empty."""
        actions = dict.fromkeys(call.top.action for call in chain.calls)
        by_action = {name: getattr(self.models[name], "not_varied", ()) for name in actions}
        found = [f"{' and '.join(names)} of {name}" for name, names in by_action.items() if names]
        return f"; no drive varied {_listed(found)}" if found else ""

    def _remarks(
        self,
        chain: TopChain,
        analysis: Analysis,
        not_free: Sequence[NotFree],
    ) -> str:
        """Return remarks to add to the reason; empty, or they begin with a semicolon."""
        # Variables opened by "*" appear only in `Refinement.not_free`: few of them are expected to
        # be free.
        text = ""
        named = [each for each in not_free if each.name in chain.calls[each.subgoal].open]
        if named:
            text += f"; not free: {_described(chain, named)}"
        if not_learned := self._not_learned(chain):
            text += f"; {not_learned}"
        if analysis.outside:
            text += f"; extrapolated: {_listed(analysis.outside)}"
        return text


@dataclass(frozen=True, slots=True)
class _Searched:
    """A chain in one order, what is free in it, its model, and the best values found.

    The cost of values that were not searched is NaN until it is `predicted`.
    """

    chain: TopChain
    analysis: Analysis
    regions: Regions
    model: ChainModel
    optimum: Optimum

    def predicted(self) -> _Searched:
        """Return it with a known cost."""
        if not math.isnan(self.optimum.cost):
            return self
        cost = self.model.predict().cost
        return dataclasses.replace(self, optimum=unsearched(self.model.given, cost))

    @property
    def refined(self) -> TopChain:
        """The chain with the best values found."""
        chain = self.chain
        for index, names in enumerate(self.model.names):
            if names:
                values = dict(zip(names, self.optimum.values[index], strict=True))
                chain = replaced(chain, index, values)
        return chain


def _axes(chain: TopChain, analysis: Analysis) -> list[list[Range]]:
    """Return the ranges of the free variables of each subgoal."""
    return [
        [variable.domain for variable in analysis.free if variable.subgoal == index]
        for index in range(len(chain))
    ]


_Variable = TypeVar("_Variable", FreeVariable, NotFree)


def _as_sent(found: Sequence[_Variable], order: Sequence[int]) -> tuple[_Variable, ...]:
    """Return the variables with the indices of their calls as they were sent."""
    return tuple(dataclasses.replace(each, subgoal=order[each.subgoal]) for each in found)


def _numbers(order: Sequence[int]) -> str:
    """Return the numbers of the first calls of an order, from 1."""
    more = ", …" if len(order) > _MOST_NUMBERS else ""
    return ", ".join(str(index + 1) for index in order[:_MOST_NUMBERS]) + more


def _gain(
    before: ChainPrediction,
    after: ChainPrediction,
    objective: Objective,
) -> float:
    """Return the gain in s of duration, whatever the scale of the weights.

    As a share of the cost where durations do not dominate it.
    """
    gain = before.cost - after.cost
    if _in_seconds(before, objective):
        return gain / objective.weights["duration"]
    return gain / before.cost if 0.0 < before.cost < math.inf else gain


def _in_seconds(before: ChainPrediction, objective: Objective) -> bool:
    """Return whether durations dominate the cost; the usual cost of failures is a time, too."""
    weight = objective.weights.get("duration", 0.0)
    if not weight or not objective.of_unknown_uncertainty:
        return weight > 0.0
    return weight * before.duration >= _DOMINANT * before.cost


def replaced(
    chain: TopChain,
    index: int,
    values: Mapping[str, float],
) -> TopChain:
    """Return the chain with some goal variables of a subgoal replaced."""
    return chain.with_goal(index, with_values(chain.calls[index].goal, values))


def _described(chain: TopChain, not_free: Sequence[NotFree]) -> str:
    return _listed(
        [f"{each.name} of {chain.step_name(each.subgoal)} is {each.reason}" for each in not_free]
    )


def _listed(items: Sequence[str]) -> str:
    """Join the first items, and the number of the others."""
    more = len(items) - _MOST_LISTED
    return "; ".join(items[:_MOST_LISTED]) + (f"; and {more} more" if more > 0 else "")


# Alternatives


Judged = Refinement | str
"""One of several chains: its refinement, or why it was skipped."""


def rank(judged: Judged) -> float:
    """Return the sort key of a chain: its cost; skipped ones come last."""
    return math.inf if isinstance(judged, str) else judged.predicted.cost


@dataclass(frozen=True, slots=True)
class Selection:
    """The chains of a request in their order; index and refinement of the best one."""

    judged: tuple[Judged, ...]
    number: int
    refinement: Refinement

    @property
    def complete(self) -> bool:
        """Whether the search of every chain was completed."""
        return all(isinstance(each, str) or each.complete for each in self.judged)

    @property
    def share_done(self) -> float:
        """The share of the search of all chains that is done, estimated and rather too small."""
        works = [each.work for each in self.judged if not isinstance(each, str)]
        expected = math.fsum(work.expected for work in works)
        return min(math.fsum(work.done for work in works) / expected, 1.0) if expected else 1.0


def choose(
    refiner: Refiner,
    world: World,
    chains: Sequence[TopChain | str],
    objective: Objective | None = None,
    *,
    placeholders: bool = False,
    deadline: Deadline = no_deadline,
) -> Selection:
    """Refine each of `chains` and choose the best; after the deadline, chains are only predicted.

    Raises RefinementError with the reason for each chain if none can be used.

    Parameters
    ----------
    refiner, world, objective, placeholders, deadline
        As for `Refiner.refine`.
    chains : sequence of TopChain or str
        The chains, or why one cannot be used. A chain that is no valid plan from `world` in any
        order that it leaves open is skipped. The reference of one that is no valid plan as it is
        has the first order in which it is one.
    """
    judged: list[Judged] = []
    for chain in chains:
        if isinstance(chain, str):
            judged.append(chain)
            continue
        try:
            valid = in_valid_order(chain, world, refiner.robot, deadline)
            judged.append(
                refiner.refine(
                    world, valid, objective, placeholders=placeholders, deadline=deadline
                )
            )
        except InvalidChainError as error:
            judged.append(f"no valid plan: {error}")
        except RefinementError as error:
            judged.append(str(error))
    number = min(range(len(judged)), key=lambda index: rank(judged[index]))
    best = judged[number]
    if isinstance(best, str):
        room = max(_SHORTEST_REASON, _LONGEST_REASONS // len(judged))
        first, *others = (printable(reason, room) for reason in judged)
        reasons = [first, *(f"alternative {index}: {why}" for index, why in enumerate(others, 1))]
        raise RefinementError("; ".join(reasons))
    return Selection(tuple(judged), number, best)
