"""Execution of a chain that is refined again on the way, as in the executor node, without ROS.

An instance replaces the chain executor in `ator_ros.evaluation.chain_run.run_chain`.
"""

from executions import execution

from ator_ros.actions.base import Status, Step
from ator_ros.domains.trials import Trial
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.toolset import Toolset
from ator_ros.execution.chain_executor import ActionRecord, Ending
from ator_ros.execution.refining import AGAIN_AFTER, Answer
from ator_ros.execution.supervisor import Deadlines
from ator_ros.refinement import RefinementError
from ator_ros.refinement.refiner import Refiner, choose
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World


class RefinedAlong:
    """Executes a chain as `ChainExecutor` does; refinement answers one tick later.

    `chain` was chosen by refinement from `plan`, which has its open variables.
    """

    def __init__(
        self,
        library: TopLibrary,
        chain: TopChain,
        plan: TopChain,
        refiner: Refiner,
        *,
        time_limit: float,
    ) -> None:
        self._chain, self._refiner, self._begun = chain, refiner, False
        deadlines = Deadlines(action=time_limit)
        self._supervisor = execution(
            plan,
            refine=True,
            library=library,
            deadlines=deadlines,
            again_after=AGAIN_AFTER,
            now=0.0,
        )

    @property
    def again(self) -> int:
        return self._supervisor.refining.refined_again

    @property
    def records(self) -> list[ActionRecord]:
        return self._supervisor.executor.records

    def step(self, world: World) -> Step:
        """Return the command of this tick; the first question is answered immediately."""
        run = self._supervisor
        if not self._begun:
            self._begun = True
            run.tick(world, world.time)
            run.answer(Answer(self._chain, True, "as chosen before"))
        self._answer()
        command = run.tick(world, world.time)
        status = Status.RUNNING
        if run.ending is not None:
            status = Status.SUCCEEDED if run.ending is Ending.SUCCEEDED else Status.FAILED
        return Step(command, status, run.reason)

    def interrupt(self, world: World, ending: Ending, why: str) -> None:
        self._supervisor.end(ending, why)

    def _answer(self) -> None:
        """Answer the question of the previous tick, as the refinement node does."""
        run, question = self._supervisor, self._supervisor.question
        if question is None:
            return
        chains = (question.chain, *(chain for _, chain in question.others))
        try:
            choice = choose(self._refiner, question.world, chains)
        except RefinementError as error:
            run.answer(Answer(None, False, str(error)))
            return
        found = choice.refinement
        run.answer(Answer(found.chain, found.refined, found.reason, chosen=choice.number))


def refining_along(
    tools: Toolset, library: TopLibrary, trial: Trial
) -> tuple[TopChain, RefinedAlong]:
    """Return a refined chain (headings and speeds), and its executor with a gate."""
    choice = POLICIES["refined_speed"](tools, trial)
    assert choice.refinement is not None
    plan, refiner = choice.refinement.original, tools.refiner(gated=True)
    limit = tools.domain.time_limit
    return choice.chain, RefinedAlong(library, choice.chain, plan, refiner, time_limit=limit)
