"""The page: a desk's scene and panel, for any number of clients at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ator_ros.evaluation.trials import Trial
from ator_ros.geometry import Pose
from ator_ros.page.controls import Controls
from ator_ros.page.drawing import NO_ANGLES, Canvas, RobotModel, write
from ator_ros.page.grips import Grip
from ator_ros.page.history_tab import HistoryTab
from ator_ros.page.serving import LOOPBACK, served
from ator_ros.performance.model import PerformanceModel
from ator_ros.robot.description import Robot
from ator_ros.viewing import panel
from ator_ros.viewing.chain_picture import alternatives, picture_of
from ator_ros.viewing.desk import NAIVE, REFINED, Desk
from ator_ros.viewing.guest import OTHERS
from ator_ros.viewing.inbox import Inbox
from ator_ros.viewing.shapes import BLUE, ORANGE, YELLOW, polyline
from ator_ros.viewing.stage import NO_STAGES, ViewStage
from ator_ros.world.state import World

_TRAILS = {NAIVE: ORANGE, REFINED: BLUE, OTHERS: BLUE}
_WRITE_PERIOD = 0.2
_TRAIL_WIDTH = 0.025
_GOAL_RADIUS = 0.16


class Page:
    """Serves a page on one port; `update` is called regularly by the thread that owns the desk.

    Parameters
    ----------
    desk : Desk
        What is shown.
    robot : Robot
        With its scene.
    urdf : str
        The robot's description for drawing.
    models : mapping
        Performance models by action, by action set, for the display of their rules.
    host, port : str, int
        Where the page is served; by default only this machine can reach it.
    runs : sequence of (str, Trial)
        Situations of an evaluation to choose from.
    stages : mapping
        All robots by name, the desk's among them; all are shown, and one is chosen.
    """

    def __init__(
        self,
        desk: Desk,
        robot: Robot,
        urdf: str,
        models: Mapping[str, Mapping[str, PerformanceModel]],
        *,
        host: str = LOOPBACK,
        port: int = 8080,
        runs: Sequence[tuple[str, Trial]] = (),
        stages: Mapping[str, ViewStage] = NO_STAGES,
    ) -> None:
        self.inbox = Inbox()
        self._desk, self._robot, self._models = desk, robot, models
        self.server = server = served(desk.domain, robot, host=host, port=port)
        area = robot.scene.area
        self._chain = Canvas(server, "/chain", area)
        self._trails = Canvas(server, "/trails", area, 0.03)
        self._model = RobotModel(server, "/robot", urdf, area)
        self._ghost = RobotModel(server, "/ghost", urdf, area, ghost=True)
        self._stages = stages
        self._others = {name: RobotModel(server, f"/robots/{name}", urdf, area) for name in stages}
        self._objects = {name: self._object_grip(name) for name in robot.scene.objects}
        self._robot_grip = Grip(
            server, "/start", area, radius=robot.reach, height=0.02, colour=ORANGE, moved=self._robot_moved
        )
        self._goals: list[Grip] = []
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Now"):
            self._controls = Controls(server, desk, self.inbox, runs, stages)
        self._history = HistoryTab(server.gui, tabs.add_tab("History"))
        self._edition, self._written = -1, -math.inf

    def _object_grip(self, name: str) -> Grip:
        radius = self._robot.scene.radius(name)
        return Grip(
            self.server,
            f"/objects/{name}",
            self._robot.scene.area,
            radius=radius,
            height=2.0 * radius,
            colour=ORANGE,
            moved=lambda pose: self._object_moved(name, pose),
            turns=False,
            sphere=True,
        )

    def _object_moved(self, name: str, pose: Pose) -> None:
        self.inbox.put(("object", name), lambda: self._desk.move_object(name, pose.x, pose.y))

    def _robot_moved(self, pose: Pose) -> None:
        self.inbox.put("robot", lambda: self._desk.move_robot(pose))

    def _goal_grip(self, step: int) -> Grip:
        return Grip(
            self.server,
            f"/goals/{step}",
            self._robot.scene.area,
            radius=_GOAL_RADIUS,
            height=0.03,
            colour=BLUE,
            moved=lambda pose: self.inbox.put(("goal", step), lambda: self._desk.move_goal(step, pose)),
        )

    # Showing

    def update(self, now: float, angles: Mapping[str, float] = NO_ANGLES) -> None:
        """Show what is new.

        Parameters
        ----------
        now : float
            Time in s of any clock that does not go back.
        angles : mapping
            Of the robot's joints in rad, by name.
        """
        world = self._desk.stage.world()
        with self.server.atomic():
            if world is not None:
                self._show_world(world, angles)
            if self._edition != self._desk.edition:
                self._edition = self._desk.edition
                self._show_chain()
            self._show_grips()
            if now - self._written >= _WRITE_PERIOD:
                self._written = now
                self._write(world)

    def _show_world(self, world: World, angles: Mapping[str, float]) -> None:
        self._model.show(world.robot.pose, angles)
        self._ghost.show(self._desk.ghost())
        for name, model in self._others.items():
            other = self._stages[name]
            seen = None if other is self._desk.stage else other.world()
            model.show(None if seen is None else seen.robot.pose)
        for name, grip in self._objects.items():
            there = world.objects.get(name)
            grip.show(None if there is None else Pose(there.x, there.y, 0.0))

    def _show_chain(self) -> None:
        draft, advice = self._desk.shown
        start = draft.world.robot.pose
        others = alternatives(start, draft.alternatives)
        self._chain.draw(others if advice is None else [*others, *picture_of(start, advice)])
        self._controls.show_open()

    def _show_grips(self) -> None:
        desk = self._desk
        shown = not desk.playing
        self._robot_grip.show(desk.draft.world.robot.pose if shown and desk.stage.can_place else None)
        movable = desk.draft.movable_goals if shown else {}
        steps = len(desk.draft.chain.calls)
        while len(self._goals) < steps:
            self._goals.append(self._goal_grip(len(self._goals)))
        for step, grip in enumerate(self._goals):
            grip.show(movable.get(step))

    def _write(self, world: World | None) -> None:
        desk, controls = self._desk, self._controls
        status = "drag robot, objects or goals" if desk.run is None else desk.run.status
        stage = desk.stage
        told = panel.clock(
            world, paused=desk.paused, status=status, silence=stage.silence, refused=stage.refused
        )
        write(controls.clock, told)
        draft, advice = desk.shown
        write(controls.times, panel.times(advice, desk.runs))
        write(controls.gate, panel.gate(advice, desk.problem))
        write(controls.verdict, desk.race.verdict if desk.race else "")
        self._history.show(desk.stage.history, desk.stage.learned)
        way = desk.stage.way()
        planned = polyline("planned", [] if way is None else way.tolist(), YELLOW, _TRAIL_WIDTH)
        driven = (
            polyline(run.label, [pose[:2] for pose in run.poses], _TRAILS[run.label], _TRAIL_WIDTH)
            for run in desk.runs
        )
        self._trails.draw([planned, *driven])
        if advice is not None:
            models = self._models.get(draft.action_set, {})
            told = panel.rules(draft.world, advice.chain, self._robot, models)
            write(controls.rules, told)

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()
