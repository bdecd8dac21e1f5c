"""State of the view: the edited draft, the answer of refinement, and the executions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from ator_ros.geometry import Pose
from ator_ros.nodes.network import NodesError, UnavailableError
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft, first_draft, situation_draft
from ator_ros.view.runs import OTHERS, Answer, Run
from ator_ros.world.state import World

NAIVE, REFINED = "naive", "refined"
_RETRY_STEPS = 25  # steps after which refinement is called again if it was not running
_FOLLOW_PERIOD = 0.2  # s of the robot's clock between two updates of a draft that follows the robot


class Editor:
    """Edits a draft, keeps refinement's answer up to date, and executes chains; for one thread."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.domain = backend.domain
        self.libraries = backend.libraries
        self.seed = 0
        self.index = 0
        self.answer: Answer | None = None  # for the draft
        self.problem = ""  # the last error
        self.runs: list[Run] = []  # executions since the last edit, the newest last; two are a race
        self.edition = 0  # increases with every change of draft or answer
        self._waiting: list[Run] = []
        self._stale = True  # refinement must be called
        self._displaced = True  # robot and objects may be elsewhere than in the draft
        self._follows = False  # whether the draft follows the robot
        self._followed_at = -math.inf  # s, of the robot's clock
        self._retry = 0  # steps until refinement is called again
        self._external: tuple[object, ...] = ()  # state of another client's goal in the draft
        library = next(iter(self.libraries.values()))
        self.chain_name, self.draft = first_draft(self.domain, library)

    # Situations

    def situation(
        self,
        *,
        chain: str = "",
        seed: int | None = None,
        index: int | None = None,
    ) -> None:
        """Switch to another chain of the domain, or to another situation of it."""
        name = chain or self.chain_name
        seed = self.seed if seed is None else seed
        index = self.index if index is None else index
        library = self.libraries[self.draft.action_set]
        draft = situation_draft(self.domain, library, name, seed=seed, index=index)
        self.chain_name = name
        self.seed = seed
        self.index = index
        self.draft = replace(draft, weights=self.draft.weights)
        self.reset()

    def reset(self) -> None:
        """Place robot and objects at the draft's start."""
        self.stop()
        self._set_draft(self.draft)
        self._displaced = True
        self._follows = False

    def select(self, backend: Backend) -> None:
        """Switch to another robot; the previous one continues its chain.

        Nothing is placed. The draft follows robot and objects until something is moved or executed.
        """
        self.backend = backend
        self._waiting.clear()
        self.runs.clear()
        self.answer = None  # it was for another robot
        self._stale = True
        self._external = ()
        self._follow_robot()

    def _follow_robot(self) -> None:
        """Let the draft follow the robot from now on."""
        self._displaced = False
        self._follows = True
        self._followed_at = -math.inf

    # Edits

    def move_robot(self, pose: Pose) -> None:
        """Place the robot, unless a chain is executed."""
        if self.executing:
            return
        self._restore()
        self._set_draft(self.draft.with_robot(pose))
        self.backend.place_robot(pose)

    def move_object(self, name: str, pose: Pose) -> None:
        """Place an object; while a chain is executed, only in the world, not in the draft."""
        if not self.executing:
            self._restore()
            self._set_draft(self.draft.with_object(name, pose.x, pose.y))
        self.backend.place_object(name, pose.x, pose.y)

    def edit(self, change: Callable[..., Draft], *arguments: object) -> None:
        """Replace the draft by the result of `change`, called with the draft and the arguments."""
        self._set_draft(change(self.draft, *arguments))

    def move_goal(self, step: int, pose: Pose) -> None:
        """Move the goal of a step, unless a chain is executed: races have the same goals."""
        if not self.executing:
            self.edit(Draft.with_goal, step, pose)

    def _set_draft(self, draft: Draft) -> None:
        self.draft = draft
        self._stale = True
        if not self.executing:
            self.runs.clear()

    def _restore(self) -> None:
        """Place everything as in the draft if an execution has moved it; one attempt."""
        displaced = self._displaced
        self._displaced = False
        self._follows = False
        if displaced and self.backend.can_place:
            self.backend.place(self.draft.world)
            self.backend.pause(paused=False)

    # Execution

    @property
    def executing(self) -> bool:
        """Whether a chain is executed or waits for execution."""
        return bool(self._waiting) or self._is_active

    @property
    def _is_active(self) -> bool:
        return any(not run.ended for run in self.runs)

    def execute(self, *labels: str) -> None:
        """Execute the chain from the draft's start: `NAIVE`, `REFINED`, or both, a race."""
        self.stop()
        self.runs.clear()
        self._waiting = [Run(label) for label in labels]

    def stop(self) -> None:
        """Cancel the active chain of any client, and those that wait."""
        self._waiting.clear()
        if self._is_active:
            self.backend.stop()

    @property
    def verdict(self) -> str:
        """The result of a race; empty until both chains have ended."""
        if len(self.runs) < 2 or self._is_active:
            return ""
        failed = [run.label for run in self.runs if math.isnan(run.duration)]
        if failed:
            return f"{' and '.join(failed)} failed"
        first, second = self.runs
        gain = first.duration - second.duration
        percent = 100.0 * gain / (first.duration or math.inf)
        times = ", ".join(f"{run.label} {run.duration:.2f} s" for run in self.runs)
        return f"{times}: gain {gain:+.2f} s ({percent:+.0f} %)"

    # The loop

    def step(self, commands: Sequence[Callable[[], None]] = ()) -> None:
        """Process commands, refine a changed draft, and start chains that wait."""
        for command in commands:
            self._try(command)
        world = self.backend.world()
        if world is None:
            return
        self._follow_external()
        is_free = not (self._waiting or self.backend.can_place)
        if not self._is_active and (self._follows or is_free):
            self._follow(world)
        if self._stale:
            self._stale = False
            self._refine()
        elif self._retry:
            self._retry -= 1
            self._stale = not self._retry
        if self._is_active:
            return
        if self._waiting and not self._stale:
            self._try(self._start)
        elif self._displaced and not self.runs and not self._waiting:
            self._try(self._restore)

    def _try(self, command: Callable[[], None]) -> None:
        try:
            command()
            return
        except LookupError:  # another page has changed the chain
            self.problem = "expected a step, variable, chain or action set that exists"
        except (NodesError, ValueError) as error:
            self.problem = str(error)
        self.edition += 1
        self._waiting.clear()

    def _follow_external(self) -> None:
        """Make an active goal of another client the draft, unless this view executes a chain."""
        goal = self.backend.external
        if goal is None or goal.draft is None or goal.ended or self._waiting:
            return
        if any(not run.ended and run.label != OTHERS for run in self.runs):
            return
        record = goal.record
        state = (record.chain_id, goal.driven, record.refined, record.refined_again)
        if state == self._external:
            return
        self._external = state
        self.runs = [goal]
        self._follow_robot()
        self.draft = replace(goal.draft, weights=self.draft.weights)
        self._stale = False
        self._refine(as_given=goal.driven and not record.refined)
        chain = goal.draft.chain
        if record.order:
            chain = chain.reordered(record.order)
        if self.answer is None:  # the chain is drawn without predictions
            self.answer = Answer(chain, chain, record.refined, goal.reason)
            self.problem = ""
            self._retry = 0
        elif goal.driven:
            self.answer = replace(
                self.answer, chain=chain, refined=record.refined, reason=goal.reason
            )

    def _follow(self, world: World) -> None:
        """Set the draft's start to the current state of robot and objects."""
        if abs(world.time - self._followed_at) < _FOLLOW_PERIOD:
            return
        self._followed_at = world.time
        draft = self.draft.at(world)
        if draft.differs(self.draft):
            self.draft = draft
            self._stale = True

    def _refine(self, *, as_given: bool = False) -> None:
        try:
            self.answer = self.backend.refine(self.draft, as_given=as_given)
            self.problem = ""
        except (NodesError, ValueError) as error:  # ValueError: an invalid answer
            self.answer = None
            self.problem = str(error)
            self._retry = _RETRY_STEPS if isinstance(error, UnavailableError) else 0
        self.edition += 1

    def _start(self) -> None:
        """Execute the first chain that waits."""
        if self.answer is None:
            raise NodesError(self.problem or "expected a chain that can be executed")
        run = self._waiting.pop(0)
        if self.backend.can_place and not self._follows:
            self.backend.place(self.draft.world)
        self._displaced = True
        self._follows = False
        self.runs.append(run)
        refine = run.label == REFINED
        naive = replace(self.draft, chain=self.answer.naive, alternatives=())
        try:
            self.backend.execute(run, self.draft if refine else naive, refine=refine)
        except NodesError:
            run.problem = "could not start"
            raise
