"""The page: the editor's scene and panel, for any number of clients at once."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from functools import partial
from queue import SimpleQueue

from ator_ros.geometry import Pose
from ator_ros.performance.model import PerformanceModel
from ator_ros.robot.description import Robot
from ator_ros.view.backend import OTHERS, Backend
from ator_ros.view.editor import NAIVE, REFINED, Editor
from ator_ros.view.panel import Commands, Panel
from ator_ros.view.scene import LOOPBACK, Canvas, Handle, RobotModel, serve
from ator_ros.view.shapes import BLUE, ORANGE, YELLOW, Shape, alternative_shapes, polyline, refinement_shapes
from ator_ros.world.state import World

_TRAILS = {NAIVE: ORANGE, REFINED: BLUE, OTHERS: BLUE}
_WRITE_PERIOD = 0.2
_TRAIL_WIDTH = 0.025
_GOAL_RADIUS = 0.16


class Page:
    """Serves a page on one port; `update` is called regularly by the editor's thread.

    Parameters
    ----------
    models : mapping
        Performance models by action, by action set, whose rules are shown.
    robots : mapping of str to Backend
        All robots by name, the editor's among them; all are shown, and one is chosen.
    host, port : str, int
        Where the page is served; by default only this machine can reach it.
    """

    def __init__(
        self,
        editor: Editor,
        robot: Robot,
        urdf: str,
        models: Mapping[str, Mapping[str, PerformanceModel]],
        *,
        robots: Mapping[str, Backend],
        host: str = LOOPBACK,
        port: int = 8080,
    ) -> None:
        self.commands: Commands = SimpleQueue()
        self._editor, self._robot, self._models = editor, robot, models
        self.server = server = serve(editor.domain, robot, host=host, port=port)
        area = robot.scene.area
        self._chain = Canvas(server, "/chain", area)
        self._trails = Canvas(server, "/trails", area, 0.03)
        self._model = RobotModel(server, "/robot", urdf, area)
        self._ghost = RobotModel(server, "/ghost", urdf, area, ghost=True)
        self._robots = robots
        self._others = {name: RobotModel(server, f"/robots/{name}", urdf, area) for name in robots}
        self._objects = {}
        for name, item in robot.scene.objects.items():
            self._objects[name] = Handle(
                server, f"/objects/{name}", area, radius=item.radius, height=2.0 * item.radius,
                color=ORANGE, moved=partial(self._moved, editor.move_object, name), sphere=True,
            )  # fmt: skip
        self._start = Handle(
            server, "/start", area, radius=robot.reach, height=0.02, color=ORANGE,
            moved=partial(self._moved, editor.move_robot),
        )  # fmt: skip
        self._goals: list[Handle] = []
        self._panel = Panel(server.gui, editor, self.commands, robots)
        self._edition, self._written = -1, -math.inf

    def _moved(self, move: Callable[..., None], *arguments: object) -> None:
        self.commands.put(partial(move, *arguments))

    def take_commands(self) -> list[Callable[[], None]]:
        """Remove and return what the clients have entered, the oldest first."""
        return [self.commands.get() for _ in range(self.commands.qsize())]

    def update(self, now: float) -> None:
        """Show what has changed; `now` is the time in s of any clock that does not go back."""
        # In viser's own thread: viser sets asyncio events from whichever thread changes a handle.
        asyncio.run_coroutine_threadsafe(self._update(now), self.server.get_event_loop()).result()

    async def _update(self, now: float) -> None:
        world = self._editor.backend.world()
        with self.server.atomic():
            if world is not None:
                self._show_world(world)
            if self._edition != self._editor.edition:
                self._edition = self._editor.edition
                self._show_chain()
            self._show_handles()
            if now - self._written >= _WRITE_PERIOD:
                self._written = now
                self._write(world)

    def _show_world(self, world: World) -> None:
        self._model.show(world.robot.pose)
        self._ghost.show(self._editor.ghost())
        for name, model in self._others.items():
            other = self._robots[name]
            state = None if other is self._editor.backend else other.world()
            model.show(None if state is None else state.robot.pose)
        for name, handle in self._objects.items():
            there = world.objects.get(name)
            handle.show(None if there is None else Pose(there.x, there.y, 0.0))

    def _show_chain(self) -> None:
        draft, answer = self._editor.shown
        start = draft.world.robot.pose
        shapes: list[Shape] = [*alternative_shapes(start, draft.alternatives)]
        if answer is not None:
            shapes += refinement_shapes(start, answer.naive, answer.chain, answer.curves)
        self._chain.draw(shapes)
        self._panel.show_draft()

    def _show_handles(self) -> None:
        editor = self._editor
        editable = not editor.executing
        start = editor.draft.world.robot.pose
        self._start.show(start if editable and editor.backend.can_place else None)
        while len(self._goals) < len(editor.draft.chain.calls):
            step = len(self._goals)
            handle = Handle(
                self.server, f"/goals/{step}", self._robot.scene.area, radius=_GOAL_RADIUS, height=0.03,
                color=BLUE, moved=partial(self._moved, editor.move_goal, step),
            )  # fmt: skip
            self._goals.append(handle)
        movable = editor.draft.movable_goals if editable else {}
        for step, handle in enumerate(self._goals):
            handle.show(movable.get(step))

    def _write(self, world: World | None) -> None:
        editor, backend = self._editor, self._editor.backend
        self._panel.show_texts(world, self._robot, self._models.get(editor.shown[0].action_set, {}))
        path = backend.path
        planned = polyline("planned", [] if path is None else path.tolist(), YELLOW, _TRAIL_WIDTH)
        driven = (
            polyline(run.label, [pose[:2] for pose in run.poses], _TRAILS[run.label], _TRAIL_WIDTH)
            for run in editor.runs
        )
        self._trails.draw([planned, *driven])

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()
