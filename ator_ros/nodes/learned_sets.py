"""Sets of models that the node `learning` publishes: loaded in a thread, taken over between two callbacks."""

from __future__ import annotations

import functools
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from rclpy.node import Node

from ator_ros.learning.sets import LearnedSetError, Manifest, current_set, read_manifest
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.parameters import Parameter

LEARNED = Parameter(
    "learned",
    "",
    "folder of the node `learning`: its set in use replaces `models` once there is one; empty: none",
)
_PERIOD = 0.5
_SWITCHES = 0.0005
"""Interval in real s at which Python switches threads while a set is loaded; the default is 5 ms."""

Loaded = TypeVar("Loaded")


class LearnedSets(Generic[Loaded]):
    """The models of a node: those of its parameter `models`, or the set that `learned` has in use.

    Parameters
    ----------
    node : Node
        Its timers look for new sets.
    models, learned : str
        The parameters.
    load : callable
        Makes what the node works with of a folder of models ("" for those that ship); called in a thread when
        a set is new, and may not touch what the node uses.
    taken : callable, optional
        Called with a set that was loaded in a thread, before it is used: parameters may have changed since.
    """

    def __init__(
        self,
        node: Node,
        models: str,
        learned: str,
        load: Callable[[str], Loaded],
        taken: Callable[[Loaded], None] = lambda _: None,
    ) -> None:
        self._node, self._load, self._taken = node, load, taken
        self._folder = Path(learned).expanduser() if learned else None
        self._thread: threading.Thread | None = None
        self._ready: tuple[Path, Manifest, Loaded] | None = None
        self._failed: tuple[Path, str] | None = None
        self._seen: Path | None = None
        self._manifest: Manifest | None = None
        self._switches = 0
        self.present: Loaded
        self.source: str
        """Where the first models come from, for the log."""
        self._first(models)
        if self._folder is not None:
            node.create_timer(_PERIOD, self._look, clock=STEADY)

    def _first(self, models: str) -> None:
        place = current_set(self._folder) if self._folder is not None else None
        if place is not None:
            self._seen = place
            try:
                self._manifest = read_manifest(place)
                self.present = self._load(str(place))
            except LearnedSetError as error:
                self._tell_failure(place, str(error))
            else:
                self.source = f"learned set {self._manifest.digest}"
                return
        self._manifest = None
        self.source = f"models in {models}" if models else "shipped models"
        self.present = self._load(models)

    def _look(self) -> None:
        """Take over a set that has been loaded, or begin to load a new one."""
        if self._thread is not None:
            if not self._thread.is_alive():
                self._thread = None
                self._take_over()
            return
        assert self._folder is not None
        place = current_set(self._folder)
        if place is not None and place != self._seen:
            self._seen = place
            self._thread = threading.Thread(target=functools.partial(self._load_beside, place), daemon=True)
            self._thread.start()

    def _load_beside(self, place: Path) -> None:
        usual = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCHES)
        try:
            manifest = read_manifest(place)
            self._ready = place, manifest, self._load(str(place))
        except Exception as error:  # whatever it is, the node continues with what it has
            self._failed = place, str(error) or repr(error)
        finally:
            sys.setswitchinterval(usual)

    def _take_over(self) -> None:
        if self._failed is not None:
            (place, why), self._failed = self._failed, None
            self._tell_failure(place, why)
        if self._ready is not None:
            (_, self._manifest, loaded), self._ready = self._ready, None
            self._taken(loaded)
            self.present = loaded
            self._switches += 1
            self._node.get_logger().info(f"switched to the learned set {_told(self._manifest)}")

    def _tell_failure(self, place: Path, why: str) -> None:
        self._node.get_logger().warning(f"the learned set {place.name} is not used: {why}")

    def told(self) -> dict[str, object]:
        """Return the diagnostics of the set in use."""
        if self._folder is None:
            return {}
        return {
            "learned set": "none yet" if self._manifest is None else _told(self._manifest),
            "switches of the learned set": self._switches,
        }


def _told(manifest: Manifest) -> str:
    episodes = ", ".join(f"{count} of {name}" for name, count in sorted(manifest.episodes.items()))
    return f"{manifest.digest} of {manifest.time} from episodes: {episodes or 'none'}"
