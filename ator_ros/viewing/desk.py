"""The desk of a view: what is edited, what refinement says of it, and what is executed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.trials import Trial
from ator_ros.geometry import Pose
from ator_ros.refinement import RefinementError
from ator_ros.tops.library import TopLibrary
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import OTHERS
from ator_ros.viewing.onlooker import Onlooker
from ator_ros.viewing.runs import Race, Run
from ator_ros.viewing.situations import drawn, first
from ator_ros.viewing.stage import AbsentError, StageError, ViewStage
from ator_ros.world.state import World

_PATIENCE = 25
"""Steps after which a refinement that was not there is asked again."""
_LOOK_AGAIN = 0.2
"""Seconds of the robot's clock between two looks at where it is."""
_MISTAKES = (StageError, RefinementError, ValueError, TypeError, ArithmeticError)
"""What wishes raise; a client may send any value, or speak of a chain that another client has changed."""
NAIVE, REFINED = "naive", "refined"


class Desk:
    """Edits a draft, keeps what refinement says of it up to date, and plays chains. For one thread only.

    Parameters
    ----------
    stage : ViewStage
        Where everything happens.
    domain : Domain
        Source of situations.
    libraries : mapping of str to TopLibrary
        By action set; the first one is used at the start.

    Attributes
    ----------
    draft : Draft
        What is edited.
    advice : Advice or None
        What refinement says of it; None while `problem` says why not.
    problem : str
        What went wrong last; empty if nothing did.
    runs : list of Run
        The executions since the last edit, the newest last.
    paused : bool
        Whether time stands still.
    edition : int
        Grows with every change of draft or advice.
    """

    def __init__(self, stage: ViewStage, domain: Domain, libraries: Mapping[str, TopLibrary]) -> None:
        self.stage, self.domain, self.libraries = stage, domain, libraries
        self.seed, self.index = 0, 0
        self.advice: Advice | None = None
        self.problem, self.paused = "", False
        self.runs: list[Run] = []
        self.race: Race | None = None
        self.edition = 0
        self._waiting: list[Run] = []
        self._stale, self._displaced = True, True
        self._follows, self._looked = False, -math.inf
        self._absent = 0
        self._onlooker = Onlooker()
        self.chain_name, self.draft = first(domain, libraries)

    # Situations

    def situation(self, *, chain: str = "", seed: int | None = None, index: int | None = None) -> None:
        """Go to a situation of a chain of the domain; what is not named stays."""
        named = chain or self.chain_name
        number = self.seed if seed is None else seed
        place = self.index if index is None else index
        draft = drawn(self.domain, self.libraries, named, seed=number, index=place, like=self.draft)
        self.chain_name, self.seed, self.index = named, number, place  # where there is one
        self.take(draft)

    def show(self, trial: Trial) -> None:
        """Go to a situation with its plan as it is, such as one of an evaluation."""
        self.take(Draft(trial.world, trial.chain, self.draft.action_set, self.draft.objective))

    def take(self, draft: Draft) -> None:
        """Go to another draft: what is executed is stopped, and robot and objects are placed."""
        self.stop()
        self._edited(draft)
        self._displaced, self._follows = True, False

    # Edits

    def move_robot(self, pose: Pose) -> None:
        """Put the robot somewhere; not while a chain is executed, though another client may still drag it."""
        if self.playing:
            return
        self._restored()
        self._edited(self.draft.with_robot(pose))
        self.stage.place_robot(pose)

    def move_object(self, name: str, x: float, y: float) -> None:
        """Put an object somewhere (m), also while a chain is executed: then only in the world."""
        if not self.playing:
            self._restored()
            self._edited(self.draft.with_object(name, x, y))
        self.stage.place_object(name, x, y)

    def move_goal(self, step: int, pose: Pose) -> None:
        """Put the goal of a step somewhere, likewise: both chains of a race have the same."""
        if self.playing:
            return
        self._edited(self.draft.with_goal(step, pose))

    def open(self, step: int, name: str, *, is_open: bool) -> None:
        """Open a goal variable of a step, or commit to it."""
        self._edited(self.draft.with_open(step, name, is_open=is_open))

    def use_actions(self, action_set: str) -> None:
        """Execute the chain with the actions of another set."""
        self._edited(self.draft.with_library(self.libraries[action_set]))

    def weigh(self, measure: str, weight: float) -> None:
        """Let a measure count with a weight in what refinement makes small."""
        self._edited(self.draft.with_weight(measure, weight))

    def keep_alternative(self) -> None:
        """Keep the chain as it is as an alternative: what is edited from now on is another one."""
        self._edited(self.draft.with_alternative())

    def forget_alternatives(self) -> None:
        """Stop letting refinement choose."""
        self._edited(dataclasses.replace(self.draft, alternatives=()))

    def _edited(self, draft: Draft) -> None:
        self.draft, self._stale = draft, True
        if not self.playing:
            self.runs.clear()
            self.race = None

    def _restored(self) -> None:
        """Put everything where the draft has it, if an execution has moved it; tried once."""
        displaced, self._displaced, self._follows = self._displaced, False, False
        if displaced and self.stage.can_place:
            self.paused = False
            self.stage.place(self.draft.world)
            self.stage.pause(paused=False)

    # Playing

    @property
    def playing(self) -> bool:
        """Whether a chain is executed, or one waits for its turn."""
        return bool(self._waiting) or self._executing

    @property
    def _executing(self) -> bool:
        return any(not run.ended for run in self.runs)

    def play(self, *labels: str) -> None:
        """Execute the chain from the draft's start: `NAIVE`, `REFINED`, or one after the other, a race."""
        self.stop()
        self.runs.clear()
        self._waiting = [Run(label) for label in labels]
        self.race = Race(*self._waiting) if len(self._waiting) == 2 else None

    def control(self, stage: ViewStage) -> None:
        """Switch to an existing robot where it stands; the other one continues its chain.

        Nothing is placed, and the draft follows robot and objects until something is moved or played.
        """
        self.stage = stage
        self._waiting.clear()
        self.runs.clear()
        self.race = self.advice = None  # both were about another robot
        self._stale, self._follows, self._looked = True, True, -math.inf
        self._displaced, self.paused = False, False
        self._onlooker.leave()

    def stop(self) -> None:
        """Cancel what is executed, whoever sent it, and what waits for its turn."""
        self._waiting.clear()
        if self._executing:
            self.stage.stop()

    def back(self) -> None:
        """Put everything back to the draft's start."""
        self.take(self.draft)

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
        self.stage.pause(paused=paused)
        self.paused = paused

    @property
    def shown(self) -> tuple[Draft, Advice | None]:
        """What is drawn: the draft and its advice, or those of a chain of others while it is under way."""
        return self._onlooker.shown or (self.draft, self.advice)

    @property
    def run(self) -> Run | None:
        """The newest execution; None if there is none."""
        return self.runs[-1] if self.runs else None

    def ghost(self) -> Pose | None:
        """Return where the first of a race was as long after its start as the second is now."""
        if self.race is None or len(self.runs) < 2:
            return None
        return self.race.first.pose_at(self.race.second.elapsed)

    # The loop

    def step(self, wishes: Sequence[Callable[[], None]] = ()) -> None:
        """Fulfil wishes, ask refinement if the draft has changed, follow what is executed."""
        for wish in wishes:
            self._tried(wish)
        world = self.stage.world()
        if world is None:
            return
        self._look_on()
        if (self._follows and not self._executing) or not (self.playing or self.stage.can_place):
            self._follow(world)
        if self._stale:
            self._stale = False
            self._ask()
        elif self._absent:
            self._absent -= 1
            self._stale = not self._absent
        run = self.run
        if run is not None and not run.ended:
            run.saw(world.time, world.robot.pose)
            self.stage.watch()
        elif self._waiting and not self._stale:
            self._tried(self._begin)
        elif self._displaced and not self.runs and not self._waiting:
            self._tried(self._restored)

    def _look_on(self) -> None:
        """Show a chain of others that is under way; what is played here goes first."""
        ours = self._waiting or any(not run.ended and run.label != OTHERS for run in self.runs)
        looking = self._onlooker
        if not (looking.leave() if ours else looking.look(self.stage, self.draft.objective)):
            return
        self.edition += 1
        if looking.guest is None:
            self._stale = True
        elif self.run is not looking.guest.run:
            self.runs, self.race = [looking.guest.run], None
            self._displaced, self._follows, self._looked = False, True, -math.inf

    def _tried(self, wish: Callable[[], None]) -> None:
        try:
            wish()
            return
        except LookupError:
            self.problem = "expected something of the present chain"
        except _MISTAKES as error:
            self.problem = str(error)
        self.edition += 1
        self._waiting.clear()

    def _follow(self, world: World) -> None:
        """Let the draft start where robot and objects are."""
        if abs(world.time - self._looked) < _LOOK_AGAIN:
            return
        self._looked = world.time
        draft = self.draft.at(world)
        if draft.differs(self.draft):
            self.draft, self._stale = draft, True

    def _ask(self) -> None:
        try:
            self.advice, self.problem = self.stage.refine(self.draft), ""
        except StageError as error:
            self.advice, self.problem = None, str(error)
            self._absent = _PATIENCE if isinstance(error, AbsentError) else 0
        self.edition += 1

    def _begin(self) -> None:
        """Execute the chain that waits longest."""
        if self.advice is None:
            raise StageError(self.problem or "expected a chain that can be executed")
        run = self._waiting.pop(0)
        if self.stage.can_place and not self._follows:
            self.stage.place(self.draft.world)
        self.paused, self._displaced, self._follows = False, True, False
        refine = run.label == REFINED
        run.predicted = list(self.advice.predicted if refine else self.advice.before)
        self.runs.append(run)
        naive = dataclasses.replace(self.draft, chain=self.advice.naive, alternatives=())
        try:
            self.stage.execute(run, self.draft if refine else naive, refine=refine)
        except StageError:
            run.ended, run.status = True, "could not start"
            raise
