"""The panel of a page: buttons and fields that ask a desk for something, and texts."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import viser

from ator_ros.evaluation.trials import Trial
from ator_ros.refinement.objective import MEASURES, MOST_WEIGHT
from ator_ros.viewing.desk import NAIVE, REFINED, Desk
from ator_ros.viewing.inbox import Inbox
from ator_ros.viewing.stage import NO_STAGES, ViewStage

_SPEEDS = {"0.2 x": 0.2, "1 x": 1.0, "3 x": 3.0, "10 x": 10.0}
_VARIABLES = ("yaw", "speed")
_NONE = "(choose one)"
_MOST_SEED = 2**31 - 1


class Controls:
    """Buttons and fields; each event is put into the inbox and fulfilled by the desk's thread.

    Parameters
    ----------
    server : ViserServer
        The page's server.
    desk : Desk
        Whom the events are for.
    inbox : Inbox
        Where they wait.
    runs : sequence of (str, Trial)
        Situations of an evaluation with their labels, the worst first; may be empty.
    stages : mapping
        The robots that can be chosen, by name; may be empty.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        desk: Desk,
        inbox: Inbox,
        runs: Sequence[tuple[str, Trial]] = (),
        stages: Mapping[str, ViewStage] = NO_STAGES,
    ) -> None:
        self._gui, self._desk, self._inbox = server.gui, desk, inbox
        self._boxes: list[Any] = []
        self._boxed: object = None
        if len(stages) > 1:
            robot = self._gui.add_dropdown("Robot", tuple(stages))
            self._changed(robot, lambda name: desk.control(stages[name]))
        self.clock = self._gui.add_markdown("")
        with self._gui.add_folder("Play"):
            self._button("Play naive", lambda: desk.play(NAIVE))
            self._button("Play refined", lambda: desk.play(REFINED))
            self._button("Race: naive, then refined", lambda: desk.play(NAIVE, REFINED))
            if desk.stage.can_place:
                self._time()
            else:
                self._button("Stop", desk.stop)
            self.verdict = self._gui.add_markdown("")
        with self._gui.add_folder("Times"):
            self.times = self._gui.add_markdown("")
            self.gate = self._gui.add_markdown("")
        with self._gui.add_folder("Situation", expand_by_default=desk.stage.can_place):
            self._situation(runs)
        self._opened = self._gui.add_folder("Open variables")
        with self._gui.add_folder("What counts", expand_by_default=False):
            self._objective()
        with self._gui.add_folder("Alternatives", expand_by_default=False):
            self._button("Keep this chain as an alternative", desk.keep_alternative)
            self._button("Forget alternatives", desk.forget_alternatives)
        with self._gui.add_folder("Rules of the models", expand_by_default=False):
            self.rules = self._gui.add_markdown("")

    def _time(self) -> None:
        desk = self._desk
        wishes: dict[str, Callable[[], None]] = {
            "pause": lambda: desk.pause(paused=True),
            "go on": lambda: desk.pause(paused=False),
            "back": desk.back,
        }
        buttons = self._gui.add_button_group("Time", tuple(wishes))
        buttons.on_click(lambda _: self._put("time", wishes, buttons.value))
        speed = self._gui.add_button_group("Speed", tuple(_SPEEDS))
        speeds = {label: partial(self._set_factor, factor) for label, factor in _SPEEDS.items()}
        speed.on_click(lambda _: self._put("speed", speeds, speed.value))

    def _put(self, key: str, wishes: Mapping[str, Callable[[], None]], chosen: str) -> None:
        """Pass on a wish; a client that is no browser may choose one that is none."""
        if chosen in wishes:
            self._inbox.put(key, wishes[chosen])

    def _set_factor(self, factor: float) -> None:
        self._desk.stage.set_factor(factor)

    def _situation(self, runs: Sequence[tuple[str, Trial]]) -> None:
        desk, gui = self._desk, self._gui
        chain = gui.add_dropdown("Chain", tuple(desk.domain.chains), initial_value=desk.chain_name)
        self._changed(chain, lambda name: desk.situation(chain=name))
        seed = gui.add_number("Seed", desk.seed, min=0, max=_MOST_SEED, step=1)
        self._changed(seed, lambda value: desk.situation(seed=int(value)))
        index = gui.add_number("Number", desk.index, min=0, max=_MOST_SEED, step=1)
        self._changed(index, lambda value: desk.situation(index=int(value)))
        self._button("Random situation", lambda: self._random(seed))
        sets = gui.add_dropdown("Actions", tuple(desk.libraries), initial_value=desk.draft.action_set)
        self._changed(sets, desk.use_actions)
        if runs:
            named = dict(runs)
            worst = gui.add_dropdown("Worst runs", (_NONE, *named))
            self._changed(worst, lambda label: desk.show(named[label]) if label in named else None)

    def _objective(self) -> None:
        desk = self._desk
        for name, measure in MEASURES.items():
            label = name if measure.unit == "s" else f"{name} (s per {measure.unit})"
            weight = desk.draft.objective.weights.get(name, 0.0)
            field = self._gui.add_number(label, weight, min=0.0, max=MOST_WEIGHT, step=0.1)
            self._changed(field, partial(desk.weigh, name))

    def _random(self, field: Any) -> None:
        field.value = random.randrange(_MOST_SEED)
        self._desk.situation(seed=field.value)

    def show_open(self) -> None:
        """Show a box for each variable that can be opened, ticked as the draft has it."""
        chain = self._desk.draft.chain
        tops = [call.top.name for call in chain.calls]
        if self._boxed != tops:
            self._boxed = tops
            self._add_boxes()
        for step, name, box in self._boxes:
            if box.value != (value := chain.calls[step].opens(name)):
                box.value = value

    def _add_boxes(self) -> None:
        for _, _, box in self._boxes:
            box.remove()
        self._boxes = []
        with self._opened:
            for step, call in enumerate(self._desk.draft.chain.calls):
                for name in _VARIABLES:
                    label = f"{step + 1}. {call.top.name}: {name}"
                    box = self._gui.add_checkbox(label, call.opens(name))
                    self._changed(box, self._opener(step, name))
                    self._boxes.append((step, name, box))

    def _opener(self, step: int, name: str) -> Callable[[bool], None]:
        return lambda value: self._desk.open(step, name, is_open=value)

    def _button(self, label: str, wish: Callable[[], None]) -> None:
        button = self._gui.add_button(label)
        button.on_click(lambda _: self._inbox.put(label, wish))

    def _changed(self, field: Any, wish: Callable[[Any], None]) -> None:
        """Pass on what a client enters; what we set ourselves is no wish."""

        def take(event: Any) -> None:
            value = field.value
            if event.client is not None:
                self._inbox.put(field.label, lambda: wish(value))

        field.on_update(take)
