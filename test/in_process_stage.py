"""A view's stage without ROS: shipped models refine, the simulator executes a whole chain at once."""

from __future__ import annotations

import dataclasses
import math

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.performance.model_file import load_models
from ator_ros.refinement import RefinementError
from ator_ros.refinement.refiner import Refiner, choose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.viewing.advice import Advice, advice_of
from ator_ros.viewing.desk import Desk
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import Guest
from ator_ros.viewing.history import History
from ator_ros.viewing.runs import Run
from ator_ros.viewing.stage import StageError
from ator_ros.world.state import ObjectState, RobotState, World


class InProcessStage:
    """Answers at once; `asked` and `calls` tell what was asked for."""

    def __init__(self, domain: Domain, robot: Robot) -> None:
        self.domain, self.robot, self.can_place = domain, robot, True
        self.libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        models = load_models(robot, domain.known_features, folder=domain.shipped_models)
        self.refiner = Refiner(robot, models)
        self.state = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
        self.asked: list[Draft] = []
        self.calls: list[str] = []
        self.history, self.learned, self.silence, self.refused = History(), "", 0.0, ""
        self.executed: list[TopChain] = []
        self.guest: Guest | None = None

    def way(self) -> FloatArray | None:
        return None

    def world(self) -> World | None:
        return self.state

    def refine(self, draft: Draft, *, as_given: bool = False) -> Advice:
        self.asked.append(draft)
        violations = draft.chain.violations(draft.world, self.robot)
        if violations:
            raise StageError(violations[0])
        try:
            chains, objective = (draft.chain, *draft.alternatives), draft.objective
            selection = choose(self.refiner, draft.world, chains, objective, placeholders=not as_given)
            return advice_of(selection.refinement, selection if draft.alternatives else None)
        except RefinementError as error:
            raise StageError(str(error)) from error

    def place_robot(self, pose: Pose) -> None:
        self.state = World(self.state.time, RobotState(pose), self.state.objects)

    def place_object(self, name: str, x: float, y: float) -> None:
        self.state = self.state.with_object(name, ObjectState(x, y))

    def place(self, world: World) -> None:
        self.calls.append("place")
        self.state = World(self.state.time, world.robot, world.objects)

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        assert self.state.robot.pose == self.asked[-1].world.robot.pose, "a run begins at the draft's start"
        here = dataclasses.replace(draft, world=self.state)
        chain = self.refine(here).chain if refine else draft.chain
        self.executed.append(chain)
        done = run_chain(self.robot, self.libraries[draft.action_set], self.state, chain)
        run.actual[:] = done.actions
        run.duration = done.duration if done.success else math.nan
        run.ended, run.status = True, "done"
        self.place_robot(chain.calls[-1].goal.pose)

    def watch(self) -> None:
        pass

    def stop(self) -> None:
        self.calls.append("stop")

    def pause(self, *, paused: bool) -> None:
        self.calls.append("pause" if paused else "go on")

    def set_factor(self, factor: float) -> None:
        self.calls.append(f"factor {factor:g}")


def desk_in_control(stage: InProcessStage) -> Desk:
    """Return a desk that has seen its stage once, and pauses it and sets its pace."""
    desk = Desk(stage, stage.domain, stage.libraries)
    desk.control(stage)
    desk.step()
    return desk
