"""A chain that somebody else lets the executor execute, as a view looks on."""

from __future__ import annotations

import dataclasses

from ator_ros.tops.chain import TopChain
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.runs import Run

OTHERS = "others"
"""The label of a run that this view did not start."""


@dataclasses.dataclass(frozen=True, eq=False)
class Guest:
    """What the executor tells of a chain of others.

    Attributes
    ----------
    key : str
        Which chain it is.
    draft : Draft
        The situation in which it starts, and the chain as it is at present, with open variables.
    run : Run
        How it goes; the same one as long as the key is the same.
    begun : bool
        Whether it is driven; before that, refinement may still change it.
    refined : bool
        Whether refinement has changed it.
    changes : int
        How often refinement has changed it since it was begun.
    reason : str
        Why refinement has changed it or left it alone; before it is begun what it waits for.
    """

    key: str
    draft: Draft
    run: Run
    begun: bool = False
    refined: bool = False
    changes: int = 0
    reason: str = ""

    @property
    def question(self) -> tuple[object, ...]:
        """What must change until refinement has something new to say of it."""
        return self.key, self.begun, self.refined, self.changes

    @property
    def chain(self) -> TopChain:
        """The chain as it is at present."""
        return self.draft.chain

    @property
    def as_given(self) -> bool:
        """Whether its open variables have values that it is driven with, not placeholders."""
        return self.begun and not self.refined

    def advice(self, answer: Advice | None) -> Advice:
        """Return what is shown of it.

        Parameters
        ----------
        answer : Advice or None
            What refinement says of the chain now; None where it says nothing.
        """
        if answer is None:
            return Advice(self.chain, self.chain, self.refined, self.reason)
        if not self.begun:
            return dataclasses.replace(answer, reason=f"{self.reason}; predicted: {answer.reason}")
        return dataclasses.replace(answer, chain=self.chain, refined=self.refined, reason=self.reason)
