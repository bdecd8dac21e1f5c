"""What a view shows of a chain that somebody else lets the executor execute."""

from __future__ import annotations

import dataclasses

from ator_ros.refinement.objective import Objective
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import Guest
from ator_ros.viewing.stage import AbsentError, StageError, ViewStage


class Onlooker:
    """Looks on while a chain of others is under way, and asks refinement what it says of it.

    Attributes
    ----------
    guest : Guest or None
        The chain that is shown.
    """

    def __init__(self) -> None:
        self.guest: Guest | None = None
        self._answer: Advice | None = None
        self._asked: tuple[object, ...] = ()

    @property
    def shown(self) -> tuple[Draft, Advice] | None:
        """Where the chain starts, and what is drawn of it; None where there is none."""
        return None if self.guest is None else (self.guest.draft, self.guest.advice(self._answer))

    def leave(self) -> bool:
        """Look away; return whether something was shown."""
        former, self.guest, self._asked = self.guest, None, ()
        return former is not None

    def look(self, stage: ViewStage, objective: Objective) -> bool:
        """Look at what is under way now.

        Parameters
        ----------
        stage : ViewStage
            Where it happens.
        objective : Objective
            What refinement shall make small: which one the others want is not told.

        Returns
        -------
        bool
            Whether there is something new to show, or nothing any more.
        """
        guest = stage.guest
        if guest is None or guest.run.ended:
            return self.leave()
        if guest is self.guest:
            return False
        self.guest = guest
        if guest.question != self._asked:
            self._asked, self._answer = guest.question, None
            self._ask(stage, guest, objective)
        return True

    def _ask(self, stage: ViewStage, guest: Guest, objective: Objective) -> None:
        draft = dataclasses.replace(guest.draft, objective=objective)
        try:
            self._answer = stage.refine(draft, as_given=guest.as_given)
        except AbsentError:
            self._asked = ()  # it may come
        except StageError:
            return  # what the executor tells is drawn without it
