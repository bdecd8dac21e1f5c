"""A view's backend without ROS: it refines with shipped models and executes chains at once."""

import dataclasses
import math

import numpy as np

from ator_interfaces.msg import ActionPerformance, ChainPerformance, Outcome, Performance
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import Pose
from ator_ros.nodes.network import NodesError
from ator_ros.performance.model_file import load_models
from ator_ros.refinement import RefinementError
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import Refiner, choose
from ator_ros.tops.chain import TopChain
from ator_ros.view.draft import Draft
from ator_ros.view.editor import Editor
from ator_ros.view.runs import Answer, History, Run
from ator_ros.world.state import ObjectState, RobotState, World


def record_of(
    *actions: float,
    code: int = 0,
    reason: str = "",
    duration: float = math.nan,
    refined: bool = False,
    refinement: str = "",
) -> ChainPerformance:
    """Return a record with the durations of actions that have succeeded, and of the chain."""
    outcome = Outcome(code=Outcome.SUCCEEDED)
    return ChainPerformance(
        actions=[
            ActionPerformance(step=step, actual=Performance(duration=each), outcome=outcome)
            for step, each in enumerate(actions)
        ],
        actual=Performance(duration=duration),
        outcome=Outcome(code=code, reason=reason),
        refined=refined,
        refinement=refinement,
    )


class InProcessBackend:
    """Answers immediately; `refined` and `calls` are the requests."""

    def __init__(self) -> None:
        domain, robot = SOCCER, SOCCER.robot()
        self.domain, self.robot, self.can_place = domain, robot, True
        self.paused = False
        self.libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        models = load_models(robot, domain.known_features, folder=domain.shipped_models)
        self.refiner = Refiner(robot, models)
        self.state = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
        self.refined: list[Draft] = []
        self.as_given: list[bool] = []
        self.calls: list[str] = []
        self.fails: NodesError | None = None
        self.history = History()
        self.executed: list[TopChain] = []
        self.external: Run | None = None
        self.path: list[tuple[float, float]] = []
        self.learned = self.refused = self.role = ""

    def editor(self) -> Editor:
        """Return an editor of this backend, after its first step."""
        editor = Editor(self)
        editor.step()
        return editor

    def attached(self) -> Editor:
        """Return an editor attached to this backend's running robot, after its first step."""
        editor = Editor(self)
        editor.select(self)
        editor.step()
        return editor

    def observe(self, time: float, pose: Pose, ball: tuple[float, float]) -> None:
        self.state = World(time, RobotState(pose), {"ball": ObjectState(*ball)})
        if self.external is not None:
            self.external.observe(self.state)

    def world(self) -> World | None:
        return self.state

    def state_age(self) -> float:
        return 0.0

    def refine(self, draft: Draft, *, as_given: bool = False) -> Answer:
        self.as_given.append(as_given)
        if self.fails is not None:
            raise self.fails
        self.refined.append(draft)
        violations = draft.chain.violations(draft.world, self.robot)
        if violations:
            raise NodesError(violations[0])
        objective = Objective({"duration": 1.0, **draft.weights})
        chains = (draft.chain, *draft.alternatives)
        try:
            selection = choose(
                self.refiner, draft.world, chains, objective, placeholders=not as_given
            )
        except RefinementError as error:
            raise NodesError(str(error)) from error
        found = selection.refinement
        return Answer(
            found.original,
            found.chain,
            found.refined,
            found.reason,
            *(
                tuple(prediction.actions[place]["duration"] for place in np.argsort(chain.order))
                for chain, prediction in (
                    (found.original, found.before),
                    (found.best, found.after),
                )
            ),
            found.curves,
            selection.number,
        )

    def place_robot(self, pose: Pose) -> None:
        self.state = World(self.state.time, RobotState(pose), self.state.objects)

    def place_object(self, name: str, x: float, y: float) -> None:
        self.state = self.state.with_object(name, ObjectState(x, y))

    def place(self, world: World) -> None:
        self.calls.append("place")
        self.state = World(self.state.time, world.robot, world.objects)

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        assert self.state.robot.pose == self.refined[-1].world.robot.pose, (
            "a run begins at the draft's start"
        )
        here = dataclasses.replace(draft, world=self.state)
        chain = self.refine(here).chain if refine else draft.chain
        self.executed.append(chain)
        done = run_chain(self.robot, self.libraries[draft.action_set], self.state, chain)
        code = Outcome.SUCCEEDED if done.success else Outcome.FAILED
        run.record = record_of(*done.actions, code=code, duration=done.duration)
        self.place_robot(chain.calls[-1].goal.pose)

    def stop(self) -> None:
        self.calls.append("stop")

    def pause(self, *, paused: bool) -> None:
        self.calls.append("pause" if paused else "go on")
