"""The panel of a replay: play and pause, speed, a slider for the time, and the chain of that time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import viser

from ator_ros.viewing.inbox import Inbox
from ator_ros.viewing.player import Player
from ator_ros.viewing.recording import RecordedRobot

_SPEEDS = {"0.2 x": 0.2, "1 x": 1.0, "3 x": 3.0, "10 x": 10.0}
_STEP = 0.01


class Replay(Protocol):
    """What a panel controls."""

    inbox: Inbox
    player: Player

    @property
    def recorded(self) -> RecordedRobot:
        """The robot that is played."""

    def choose(self, name: str) -> None:
        """Play another robot."""


class ReplayControls:
    """Buttons, a slider and texts; each event is put into the inbox.

    Parameters
    ----------
    gui : GuiApi
        Of the page's server.
    replay : Replay
        Whom the events are for.
    robots : tuple of str
        Namespaces to choose from.
    """

    def __init__(self, gui: viser.GuiApi, replay: Replay, robots: tuple[str, ...]) -> None:
        self._gui, self._replay = gui, replay
        if len(robots) > 1:
            chosen = gui.add_dropdown("Robot", robots)
            self._changed(chosen, replay.choose)
        self.clock = gui.add_markdown("")
        self._place = gui.add_folder("Time")
        with self._place:
            self._buttons("Play", {"play": self._play, "pause": self._pause, "back": lambda: self._seek(0.0)})
            self._buttons("Chains", {"former": self._former, "next": self._next})
            speed = gui.add_button_group("Speed", tuple(_SPEEDS))
            speed.on_click(lambda _: replay.inbox.put("speed", self._speeder(_SPEEDS[speed.value])))
        self._slider = self._added()
        with gui.add_folder("Chain"):
            self.chain = gui.add_markdown("")

    def _added(self) -> Any:  # viser's handle, whose value is read-only for mypy
        most = max(self._replay.player.duration, _STEP)
        with self._place:
            slider = self._gui.add_slider("Seconds", 0.0, most, _STEP, 0.0)
        self._changed(slider, self._seek)
        return slider

    def restart(self) -> None:
        """Start over with a recording of another length."""
        self._slider.remove()
        self._slider = self._added()

    def show(self, player: Player) -> None:
        """Show how far it is."""
        if abs(self._slider.value - player.seconds) >= _STEP:
            self._slider.value = player.seconds

    # What is asked for

    def _play(self) -> None:
        self._replay.player.play()

    def _pause(self) -> None:
        self._replay.player.pause()

    def _seek(self, seconds: float) -> None:
        self._replay.player.seek(seconds)

    def _speeder(self, speed: float) -> Callable[[], None]:
        def wish() -> None:
            self._replay.player.speed = speed

        return wish

    def _former(self) -> None:
        now = self._replay.player.seconds - 0.5  # a second click goes on to the one before
        self._seek(max((one.began for one in self._replay.recorded.chains if one.began < now), default=0.0))

    def _next(self) -> None:
        now = self._replay.player.seconds
        self._seek(min((one.began for one in self._replay.recorded.chains if one.began > now), default=now))

    def _buttons(self, label: str, wishes: dict[str, Callable[[], None]]) -> None:
        group = self._gui.add_button_group(label, tuple(wishes))
        group.on_click(lambda _: self._replay.inbox.put(label, wishes[group.value]))

    def _changed(self, field: Any, wish: Callable[[Any], None]) -> None:
        """Pass on what a client enters; what we set ourselves is no wish."""

        def take(event: Any) -> None:
            value = field.value
            if event.client is not None:
                self._replay.inbox.put(field.label, lambda: wish(value))

        field.on_update(take)
