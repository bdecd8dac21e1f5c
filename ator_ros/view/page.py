"""The page: the editor's scene and panel, for any number of clients at once."""

from __future__ import annotations

import asyncio
import dataclasses
import math
import random
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any, TypeVar

from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.nodes.segments import (
    BLUE,
    ORANGE,
    YELLOW,
    Label,
    alternative_shapes,
    polyline,
    refinement_shapes,
    station_labels,
)
from ator_ros.performance.model import PerformanceModel
from ator_ros.refinement.chain_prediction import chain_situations
from ator_ros.refinement.objective import MOST_WEIGHT
from ator_ros.tops.chain import TopChain
from ator_ros.view.backend import Backend
from ator_ros.view.draft import Draft
from ator_ros.view.editor import NAIVE, REFINED, Editor
from ator_ros.view.floor import LOOPBACK, Canvas, Handle, RobotModel, serve
from ator_ros.view.runs import OTHERS, Answer, Run, plain, seconds
from ator_ros.world.state import World

T = TypeVar("T")

_STATE_TIMEOUT = 2.0  # real s
_VARIABLES = ("yaw", "speed")
_WEIGHTS = {
    "duration": "duration",
    "success": "success (s per failure)",
    "accuracy": "accuracy (s per m)",
}
_MOST_SEED = 2**31 - 1
_TRAILS = {NAIVE: ORANGE, REFINED: BLUE, OTHERS: BLUE}
_TEXT_PERIOD = 0.2  # s between two updates of texts and trails
_TRAIL_WIDTH = 0.025  # m
_GOAL_RADIUS = 0.16  # m
_NAME_HEIGHT = 0.6  # m, above a robot


class Page:
    """Serves a page; the editor's thread calls `update` regularly.

    `models` are performance models by action set and action, whose rules are shown. `robots` are
    the backends of all robots by name, including the editor's. By default only this machine can
    reach the page.
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
        self.commands: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._editor = editor
        self._robot = robot
        self._models = models
        self.server = server = serve(editor.domain, robot, host=host, port=port)
        area = robot.scene.area
        self._chain = Canvas(server, "/chain", area)
        self._trails = Canvas(server, "/trails", area, 0.03)
        self._names = Canvas(server, "/names", area, _NAME_HEIGHT)
        self._robots = robots
        self._robot_models = {
            name: RobotModel(server, f"/robots/{name}", urdf, area) for name in robots
        }
        self._objects = {}
        for name, item in robot.scene.objects.items():
            self._objects[name] = Handle(
                server,
                f"/objects/{name}",
                area,
                radius=item.radius,
                height=2.0 * item.radius,
                color=ORANGE,
                moved=self._queued(partial(editor.move_object, name)),
                sphere=True,
            )
        self._start = Handle(
            server,
            "/start",
            area,
            radius=robot.reach,
            height=0.02,
            color=ORANGE,
            moved=self._queued(editor.move_robot),
        )
        self._goals: list[Handle] = []
        self._gui = server.gui
        self._boxes: list[tuple[int, str, Any]] = []
        self._tops: list[str] = []
        tabs = self._gui.add_tab_group()
        with tabs.add_tab("Now"):
            self._add_fields()
        with tabs.add_tab("History"):
            self._history = self._gui.add_markdown("")
        self._edition = -1  # of the editor, which is shown
        self._written_at = -math.inf

    def _queued(self, command: Callable[[T], None]) -> Callable[[T], None]:
        """Return a function that queues the command with its argument."""
        return lambda value: self.commands.put(partial(command, value))

    def take_commands(self) -> list[Callable[[], None]]:
        """Remove and return the commands of all clients, the oldest first."""
        return [self.commands.get() for _ in range(self.commands.qsize())]

    def update(self, now: float) -> None:
        """Show the current state; `now` is the time of a monotonic clock in s."""
        # In viser's thread, because changing a handle sets asyncio events.
        asyncio.run_coroutine_threadsafe(self._update(now), self.server.get_event_loop()).result()

    async def _update(self, now: float) -> None:
        with self.server.atomic():
            self._show_items()
            if self._edition != self._editor.edition:
                self._edition = self._editor.edition
                self._show_chain()
            self._show_handles()
            if now - self._written_at >= _TEXT_PERIOD:
                self._written_at = now
                self._show_texts()
                self._show_trails()

    def _show_items(self) -> None:
        for name, model in self._robot_models.items():
            world = self._robots[name].world()
            model.show(None if world is None else world.robot.pose)
        world = self._editor.backend.world()
        for name, handle in self._objects.items():
            state = None if world is None else world.objects.get(name)
            handle.show(None if state is None else Pose(state.x, state.y, 0.0))

    def _show_chain(self) -> None:
        draft = self._editor.draft
        answer = self._editor.answer
        start = draft.world.robot.pose
        shapes = alternative_shapes(start, draft.alternatives)
        if answer is not None:
            shapes += refinement_shapes(start, answer.naive, answer.chain, answer.curves)
        self._chain.draw(shapes)
        self._chain.label([] if answer is None else station_labels(answer.chain))
        self._show_draft()

    def _show_handles(self) -> None:
        editor = self._editor
        editable = not editor.executing
        start = editor.draft.world.robot.pose
        self._start.show(start if editable and editor.backend.can_place else None)
        while len(self._goals) < len(editor.draft.chain.calls):
            step = len(self._goals)
            handle = Handle(
                self.server,
                f"/goals/{step}",
                self._robot.scene.area,
                radius=_GOAL_RADIUS,
                height=0.03,
                color=BLUE,
                moved=self._queued(partial(editor.move_goal, step)),
            )
            self._goals.append(handle)
        movable = editor.draft.movable_goals if editable else {}
        for step, handle in enumerate(self._goals):
            handle.show(movable.get(step))

    def _show_trails(self) -> None:
        planned = (
            polyline(f"planned {name}", backend.path, YELLOW, _TRAIL_WIDTH)
            for name, backend in self._robots.items()
        )
        driven = (
            polyline(run.label, run.path, _TRAILS[run.label], _TRAIL_WIDTH)
            for run in self._editor.runs
        )
        self._trails.draw([*planned, *driven])
        if len(self._robots) > 1:
            self._names.label(robot_labels(self._robots))

    # The panel

    def _add_fields(self) -> None:
        """Add buttons, fields and texts; events become commands for the editor's thread."""
        gui = self._gui
        editor = self._editor
        robots = self._robots
        if len(robots) > 1:
            choice = gui.add_dropdown("Robot", tuple(robots))
            self._on_change(choice, lambda name: editor.select(robots[name]))
        self._clock = gui.add_markdown("")
        with gui.add_folder("Play"):
            self._button("Play naive", lambda: editor.execute(NAIVE))
            self._button("Play refined", lambda: editor.execute(REFINED))
            self._button("Race: naive, then refined", lambda: editor.execute(NAIVE, REFINED))
            if editor.backend.can_place:
                self._button("Pause", lambda: editor.backend.pause(paused=True))
                self._button("Resume", lambda: editor.backend.pause(paused=False))
                self._button("Back to the start", editor.reset)
            else:
                self._button("Stop", editor.stop)
            self._verdict = gui.add_markdown("")
        with gui.add_folder("Times"):
            self._times = gui.add_markdown("")
            self._gate = gui.add_markdown("")
        with gui.add_folder("Situation", expand_by_default=editor.backend.can_place):
            self._seed = self._situation()
        self._open_variables = gui.add_folder("Open variables")
        with gui.add_folder("What counts", expand_by_default=False):
            self._weights()
        with gui.add_folder("Alternatives", expand_by_default=False):
            self._button(
                "Keep this chain as an alternative", lambda: editor.edit(Draft.with_alternative)
            )
            forget = partial(dataclasses.replace, alternatives=())
            self._button("Forget alternatives", lambda: editor.edit(forget))
        with gui.add_folder("Rules of the models", expand_by_default=False):
            self._rules = gui.add_markdown("")

    def _situation(self) -> Any:
        editor = self._editor
        gui = self._gui
        chain = gui.add_dropdown(
            "Chain", tuple(editor.domain.chains), initial_value=editor.chain_name
        )
        self._on_change(chain, lambda name: editor.situation(chain=name))
        seed = gui.add_number("Seed", editor.seed, min=0, max=_MOST_SEED, step=1)
        self._on_change(seed, lambda value: editor.situation(seed=int(value)))
        index = gui.add_number("Number", editor.index, min=0, max=_MOST_SEED, step=1)
        self._on_change(index, lambda value: editor.situation(index=int(value)))
        self._button(
            "Random situation", lambda: editor.situation(seed=random.randrange(_MOST_SEED))
        )
        sets = gui.add_dropdown(
            "Actions", tuple(editor.libraries), initial_value=editor.draft.action_set
        )
        self._on_change(
            sets,
            lambda name: editor.edit(Draft.with_library, editor.libraries[name]),
        )
        return seed

    def _weights(self) -> None:
        usual = {"duration": 1.0, "success": self._editor.domain.time_limit, "accuracy": 0.0}
        for name, label in _WEIGHTS.items():
            field = self._gui.add_number(label, usual[name], min=0.0, max=MOST_WEIGHT, step=0.1)
            self._on_change(field, partial(self._editor.edit, Draft.with_weight, name))

    def _show_draft(self) -> None:
        """Show the draft's seed, and a checkbox for each goal variable."""
        chain = self._editor.draft.chain
        self._seed.value = self._editor.seed
        tops = [call.top.name for call in chain.calls]
        if self._tops != tops:
            self._tops = tops
            self._add_boxes()
        for step, name, box in self._boxes:
            box.value = chain.calls[step].opens(name)

    def _add_boxes(self) -> None:
        for _, _, box in self._boxes:
            box.remove()
        self._boxes = []
        with self._open_variables:
            for step, call in enumerate(self._editor.draft.chain.calls):
                for name in _VARIABLES:
                    box = self._gui.add_checkbox(
                        f"{step + 1}. {call.top.name}: {name}", call.opens(name)
                    )
                    self._on_change(box, partial(self._editor.edit, Draft.with_open, step, name))
                    self._boxes.append((step, name, box))

    def _show_texts(self) -> None:
        editor = self._editor
        backend = editor.backend
        answer = editor.answer
        status = editor.runs[-1].status if editor.runs else "drag robot, objects or goals"
        if backend.refused:
            status = f"not moved: {backend.refused}"
        self._clock.content = clock_text(
            backend.world(), backend.state_age(), status, paused=backend.paused
        )
        self._times.content = times_text(answer, editor.runs)
        self._gate.content = gate_text(answer, editor.problem)
        self._verdict.content = editor.verdict
        models = self._models.get(editor.draft.action_set)
        if answer is not None and models is not None:  # their files could be read
            self._rules.content = rules_text(editor.draft.world, answer.chain, self._robot, models)
        learned = f"Learned models in use: {plain(backend.learned)}." if backend.learned else ""
        self._history.content = f"{learned}\n\n{backend.history.report()}"

    def _button(self, label: str, command: Callable[[], None]) -> None:
        self._gui.add_button(label).on_click(lambda _: self.commands.put(command))

    def _on_change(self, field: Any, command: Callable[[Any], None]) -> None:
        """Queue a command for each value that a client enters."""

        def queue(event: Any) -> None:
            if event.client is not None:  # else the page itself has set the value
                self.commands.put(partial(command, field.value))

        field.on_update(queue)


def clock_text(world: World | None, age: float, status: str, *, paused: bool) -> str:
    """Return time and status in Markdown; `age` are the real s since the robot's last state."""
    if world is None:
        return "waiting for the robot's state from odom or tf"
    if age > _STATE_TIMEOUT and not paused:
        status = f"no state of the robot for {age:.0f} s"
    return f"**{world.time:.2f} s**{' (paused)' if paused else ''} · {plain(status)}"


def times_text(answer: Answer | None, runs: Sequence[Run]) -> str:
    """Return a Markdown table of predicted times of both chains and times of runs.

    It has a column for each call in the order as sent.
    """
    if answer is None:
        return ""
    indices = range(len(answer.chain))
    tops = [plain(answer.chain.sent(index).top.name) for index in indices]
    rows = [
        ("naive, predicted", dict(enumerate(answer.before)), sum(answer.before)),
        ("best, predicted", dict(enumerate(answer.after)), sum(answer.after)),
        *((f"{run.label}, driven", run.actual, run.elapsed) for run in runs),
    ]
    table = [f"| s | {' | '.join(tops)} | chain |", f"|---|{'---|' * (len(tops) + 1)}"]
    for label, values, whole in rows:
        durations = (values.get(index, math.nan) for index in indices)
        cells = [label, *map(seconds, durations), seconds(whole)]
        table.append(f"| {' | '.join(cells)} |")
    return "\n".join(table)


def gate_text(answer: Answer | None, problem: str) -> str:
    """Return the gate's reason in Markdown, or the problem."""
    if problem:
        return f"**not refined:** {plain(problem)}"
    if answer is None:
        return "no chain"
    chosen = f"alternative {answer.chosen}: " if answer.chosen else ""
    return f"{chosen}{plain(answer.reason)}"


def robot_labels(robots: Mapping[str, Backend]) -> list[Label]:
    """Return, at each robot, its name, its role in a team, and the steps of its chain."""
    labels = []
    for name, backend in robots.items():
        world = backend.world()
        if world is None:
            continue
        text = f"{name}: {backend.role}" if backend.role else name
        run = backend.external
        if run is not None and run.draft is not None and not run.ended:
            text += f" ({', '.join(call.top.name for call in run.draft.chain.calls)})"
        labels.append(Label(name, text, world.robot.pose.x, world.robot.pose.y))
    return labels


def rules_text(
    world: World, chain: TopChain, robot: Robot, models: Mapping[str, PerformanceModel]
) -> str:
    """Return in Markdown, by step, the rule that predicts the duration and its terms' values."""
    parts = []
    situations = chain_situations(world, chain, robot, models)
    for call, situation in zip(chain.calls, situations, strict=True):
        text = models[call.top.action].explain(situation)
        parts.append(f"**{plain(call.top.name)}**\n```\n{text}\n```")
    return "\n\n".join(parts)
