"""The page: a desk's scene and panel, for any number of clients at once."""

from __future__ import annotations

import contextlib
import io
import logging
import math
from collections.abc import Mapping, Sequence

import viser

from ator_ros.evaluation.trials import Trial
from ator_ros.geometry import Pose
from ator_ros.page.controls import Controls
from ator_ros.page.drawing import NO_ANGLES, Canvas, RobotModel
from ator_ros.page.grips import Grip
from ator_ros.page.history_tab import HistoryTab
from ator_ros.performance.model import PerformanceModel
from ator_ros.robot.description import Robot
from ator_ros.viewing import panel
from ator_ros.viewing.chain_picture import alternatives, picture_of
from ator_ros.viewing.desk import NAIVE, REFINED, Desk
from ator_ros.viewing.inbox import Inbox
from ator_ros.viewing.shapes import BLUE, ORANGE, YELLOW, polyline
from ator_ros.viewing.surroundings import surroundings
from ator_ros.world.state import World

LOOPBACK = "127.0.0.1"
_TRAILS = {NAIVE: ORANGE, REFINED: BLUE}
_WRITE_PERIOD = 0.2
_TRAIL_WIDTH = 0.025
_CAMERA_HEIGHT = 0.85
"""Height of the camera as a share of the area's length."""
_FLOOR = (72, 122, 84)
_GOAL_RADIUS = 0.16


def camera_over(robot: Robot) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Return where a new client's camera is and looks at (m), and its vertical field of view (rad)."""
    area = robot.scene.area
    look_at = (0.0, -0.05 * area.width, 0.0)
    return (0.0, -0.75 * area.width, _CAMERA_HEIGHT * area.length), look_at, math.radians(50.0)


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
        Performance models by action, by action set: their rules are told.
    host, port : str, int
        Where the page is served; by default only this machine can reach it.
    runs : sequence of (str, Trial)
        Situations of an evaluation to choose from.
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
    ) -> None:
        self.inbox = Inbox()
        self._desk, self._robot, self._models = desk, robot, models
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # a browser that goes away is no error
        with contextlib.redirect_stdout(io.StringIO()):  # viser tells its address in a frame
            self.server = server = viser.ViserServer(host=host, port=port, label="ator_ros", verbose=False)
        self._look(server, robot)
        self._chain = Canvas(server, "/chain")
        self._trails = Canvas(server, "/trails", 0.03)
        Canvas(server, "/surroundings", 0.02).draw(surroundings(desk.domain, robot))
        self._model = RobotModel(server, "/robot", urdf)
        self._ghost = RobotModel(server, "/ghost", urdf, ghost=True)
        self._objects = {name: self._object_grip(name) for name in robot.scene.objects}
        self._robot_grip = Grip(
            server, "/start", radius=robot.reach, height=0.02, colour=ORANGE, moved=self._robot_moved
        )
        self._goals: list[Grip] = []
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Now"):
            self._controls = Controls(server, desk, self.inbox, runs)
        self._history = HistoryTab(server.gui, tabs.add_tab("History"))
        self._edition, self._written = -1, -math.inf

    @staticmethod
    def _look(server: viser.ViserServer, robot: Robot) -> None:
        area, (position, look_at, fov) = robot.scene.area, camera_over(robot)
        server.scene.set_up_direction("+z")
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = position, look_at, fov
        size = (area.length + 2.0 * area.margin, area.width + 2.0 * area.margin, 0.02)
        server.scene.add_box(
            "/floor", color=_FLOOR, dimensions=size, position=(0.0, 0.0, -0.01), cast_shadow=False
        )

    def _object_grip(self, name: str) -> Grip:
        radius = self._robot.scene.radius(name)
        return Grip(
            self.server,
            f"/objects/{name}",
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
        for name, grip in self._objects.items():
            there = world.objects.get(name)
            grip.show(None if there is None else Pose(there.x, there.y, 0.0))

    def _show_chain(self) -> None:
        desk = self._desk
        start = desk.draft.world.robot.pose
        others = alternatives(start, desk.draft.alternatives)
        self._chain.draw(others if desk.advice is None else [*others, *picture_of(start, desk.advice)])
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
        self._set(controls.clock, panel.clock(world, paused=desk.paused, status=status))
        self._set(controls.times, panel.times(desk.advice, desk.runs))
        self._set(controls.gate, panel.gate(desk.advice, desk.problem))
        self._set(controls.verdict, desk.race.verdict if desk.race else "")
        self._history.show(desk.stage)
        way = desk.stage.way()
        planned = polyline("planned", [] if way is None else way.tolist(), YELLOW, _TRAIL_WIDTH)
        driven = (
            polyline(run.label, [pose[:2] for pose in run.poses], _TRAILS[run.label], _TRAIL_WIDTH)
            for run in desk.runs
        )
        self._trails.draw([planned, *driven])
        if desk.advice is not None:
            models = self._models.get(desk.draft.action_set, {})
            told = panel.rules(desk.draft.world, desk.advice.chain, self._robot, models)
            self._set(controls.rules, told)

    @staticmethod
    def _set(text: viser.GuiMarkdownHandle, content: str) -> None:
        if text.content != content:
            text.content = content

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()
