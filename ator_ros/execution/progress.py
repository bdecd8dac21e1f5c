"""The chain of a goal while it is executed, and its prediction."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

from ator_ros.execution.chain_executor import ChainExecutor, ChainStep
from ator_ros.execution.phases import Ending
from ator_ros.execution.predictions import Predictor, remaining
from ator_ros.execution.step_run import ActionRecord
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import at_rest
from ator_ros.world.state import World


class _Predicted(NamedTuple):
    """The prediction of the chain from a step (from 0) on, as of a time in s."""

    step: int
    time: float
    prediction: Callable[[], ChainPrediction | None]


class Progress:
    """Executes the chain of one goal and predicts it; the chain itself belongs to its `ChainExecutor`.

    Attributes
    ----------
    start : World or None
        The state in which the chain started, before that the newest one; None if there was none.
    begun : bool
        Whether the chain has started.

    Parameters
    ----------
    library, predictor
        TOPs with their actions, and predictions of chains.
    chain : TopChain
        The chain to execute.
    time_limit : float
        Time in s that each step may take.
    fetches : int
        Number of times that a lost object may be fetched again.
    """

    def __init__(
        self, library: TopLibrary, predictor: Predictor, chain: TopChain, *, time_limit: float, fetches: int
    ) -> None:
        self.start: World | None = None
        self.begun = False
        self._robot, self._predictor = library.robot, predictor
        self._executor = ChainExecutor(
            library,
            chain,
            time_limit=time_limit,
            predict=lambda *step: functools.partial(predictor.action, *step),
            fetches=fetches,
        )
        self._prediction: Callable[[], ChainPrediction | None] | None = None
        self._rest: _Predicted | None = None

    @property
    def chain(self) -> TopChain:
        """The chain with its present goals."""
        return self._executor.chain

    @property
    def records(self) -> list[ActionRecord]:
        """The actions that have ended."""
        return self._executor.records

    @property
    def elapsed(self) -> float:
        """Time in s since the chain's start."""
        return self._executor.elapsed

    @property
    def index(self) -> int:
        """Index of the step being executed, from 0."""
        return self._executor.index

    @property
    def call(self) -> TopCall:
        """The step being executed."""
        return self.chain.calls[self.index]

    @property
    def fetched(self) -> int:
        """Number of times that a lost object was fetched again."""
        return self._executor.fetched

    @property
    def released(self) -> bool:
        """Whether another program moves the robot: the last tick had no command."""
        return self._executor.released

    def way(self) -> FloatArray | None:
        """Return the planned way of the action under way; see `Action.way`."""
        return self._executor.way()

    @property
    def lost(self) -> str | None:
        """The object whose loss made the last action fail; None if there is none."""
        return self.records[-1].lost if self.records else None

    @property
    def predicted(self) -> ChainPrediction | None:
        """The prediction of the chain; computed on first use, so that it does not delay the first command."""
        return None if self._prediction is None else self._prediction()

    def predicted_remaining(self, now: float) -> float:
        """Return the predicted time in s from `now`, on odometry's clock, to the end; NaN if unknown."""
        rest = self._rest
        predicted = None if rest is None or self.index < rest.step else rest.prediction()
        if rest is None or predicted is None:
            return math.nan
        began = max(rest.time, self.records[-1].end.time) if self.records else rest.time
        return remaining(predicted, self.index - rest.step, now - began)

    def choose(self, chain: TopChain) -> None:
        """Execute `chain` instead of the one given; only before it has started."""
        self._executor.choose(chain)

    def begin(self, world: World) -> None:
        """Start the chain in the state `world`."""
        self.start, self.begun = world, True  # later than the first state if refinement took time
        self._prediction = functools.cache(functools.partial(self._predictor.chain, world, self.chain))
        self._rest = _Predicted(0, world.time, self._prediction)

    def step(self, world: World) -> ChainStep:
        """Execute one tick of the chain, which has begun."""
        return self._executor.step(world)

    def head_for(self, world: World, chain: TopChain) -> bool:
        """Replace the present step and later ones; see `ChainExecutor.head_for`."""
        if not self._executor.head_for(world, chain):
            return False
        rest, resting = TopChain(chain.calls[self.index :]), at_rest(world, self._robot)
        prediction = functools.cache(functools.partial(self._predictor.chain, resting, rest))
        self._rest = _Predicted(self.index, world.time, prediction)
        return True

    def break_off(self, world: World, ending: Ending, why: str) -> None:
        """End the action under way, if any, and record it; see `ChainExecutor.break_off`."""
        self._executor.break_off(world, ending, why)
