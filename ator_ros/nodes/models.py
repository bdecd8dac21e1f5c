"""The models of each action set: read at the start, and replaced by learned sets."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.files import FileError
from ator_ros.learning.gains import GAINS, Gains, read_gains
from ator_ros.learning.sets import Manifest, current_set, digest_of_start, read_manifest
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.parameters import Parameter
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import NoModelsError, RobotMismatchWarning, load_models
from ator_ros.tops.library import TopLibrary

LEARNED = Parameter(
    "learned",
    "",
    "folder of the node `learning`: its set in use replaces `models` once there is one; empty: none",
)
_PERIOD = 0.5


@dataclass(frozen=True)
class ModelSet:
    """The performance models of one action set, by action.

    `absent` is why there are none. `problem` is what is wrong: a damaged file, another robot. It is no
    problem to have none.
    """

    models: Mapping[str, PerformanceModel]
    absent: str = ""
    problem: str = ""


class LearnedSets:
    """The models of a node: those of its parameter `models`, or the set that `learned` has in use.

    `warm_up` is called with the library of an action set and its models before they are used, in a thread
    when a learned set is new.

    Attributes
    ----------
    present : dict of str to ModelSet
        The models in use, by action set.
    gains : Gains
        What chains refined with them have gained; the node `learning` measures it.
    """

    def __init__(
        self,
        node: Node,
        domain: Domain,
        libraries: Mapping[str, TopLibrary],
        settings: Mapping[str, Any],
        warm_up: Callable[[TopLibrary, ModelSet], None] = lambda *_: None,
    ) -> None:
        models, learned = settings["models"], settings["learned"]
        self._node, self._domain, self._libraries, self._warm_up = node, domain, libraries, warm_up
        self._folder = Path(learned).expanduser() if learned else None
        self._threads = ThreadPoolExecutor(1)
        self._loading: Future[tuple[Manifest, dict[str, ModelSet]]] | None = None
        self._seen = None if self._folder is None else current_set(self._folder)
        self._manifest: Manifest | None = None
        self._source = f"models in {models}" if models else "shipped models"
        place = Path(models) if models else domain.shipped_models
        if self._seen is not None:
            try:
                self._manifest = read_manifest(self._seen)
                self._source, place = f"learned set {self._manifest.digest}", self._seen
            except FileError as error:
                self._log_failure(error)
        self._gains_of: tuple[str, int] | None = None
        self._start = digest_of_start(Path(models) if models else domain.shipped_models, libraries)
        self.gains = Gains()
        node.get_logger().info("loading models; the first start compiles code, which may take a minute")
        self._place = place
        self.present = self._load(place)
        if self._folder is not None:
            self._look_at_gains()
            node.create_timer(_PERIOD, self._look, clock=STEADY)

    def _load(self, place: Path) -> dict[str, ModelSet]:
        """Read the models in a folder of every action set; log what is wrong."""
        return {name: self._read(library, place) for name, library in self._libraries.items()}

    def _read(self, library: TopLibrary, place: Path) -> ModelSet:
        name, known = library.action_set, self._domain.known_features
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", RobotMismatchWarning)
                models = load_models(library.robot, known, action_set=name, folder=place)
            # Models of another robot mostly come together.
            read = ModelSet(models, problem=str(caught[0].message) if caught else "")
        except NoModelsError as error:
            read = ModelSet({}, absent=str(error))
        except (FileError, OSError) as error:
            read = ModelSet({}, absent=str(error), problem=str(error))
        if read.problem and (read.absent or name == DEFAULT_SET):  # others are seldom used
            self._node.get_logger().warning(f"action set {name}: {read.problem}")
        if read.models:
            self._warm_up(library, read)
        return read

    def _new(self, place: Path) -> tuple[Manifest, dict[str, ModelSet]]:
        """Load a learned set; raise FileError if some of it cannot be used."""
        manifest, read = read_manifest(place), self._load(place)
        if broken := [each.problem for each in read.values() if each.absent and each.problem]:
            raise FileError("; ".join(broken))
        return manifest, read

    def _look(self) -> None:
        """Take over a set that has been loaded, or begin to load a new one; read the gains that changed."""
        assert self._folder is not None
        self._look_at_gains()
        if self._loading is None:
            place = current_set(self._folder)
            if place is not None and place != self._seen:
                self._seen = place
                self._loading = self._threads.submit(self._new, place)
        elif self._loading.done():
            loading, self._loading = self._loading, None
            try:
                self._manifest, self.present = loading.result()
                assert self._seen is not None
                self._place = self._seen
            except Exception as error:  # whatever it is, the node continues with what it has
                self._log_failure(error)
            else:
                self._node.get_logger().info(f"switched to the learned set {_described(self._manifest)}")

    def _look_at_gains(self) -> None:
        """Read what refined chains have gained with the models in use, if that changed."""
        assert self._folder is not None
        file = self._folder / GAINS
        models = self._start if self._manifest is None else self._manifest.digest
        state = models, file.stat().st_mtime_ns if file.exists() else 0
        if state != self._gains_of:
            self._gains_of = state
            try:
                self.gains = read_gains(self._folder, models)
            except FileError as error:
                self.gains = Gains(models)
                self._node.get_logger().warning(f"gains of refined chains are not used: {error}")

    def _log_failure(self, error: Exception) -> None:
        name = "" if self._seen is None else self._seen.name
        self._node.get_logger().warning(f"the learned set {name} is not used: {str(error) or repr(error)}")

    def load_again(self, domain: Domain, libraries: Mapping[str, TopLibrary]) -> None:
        """Load the models in use for a domain on another map."""
        self._domain, self._libraries = domain, libraries
        self.present = self._load(self._place)
        if self._loading is not None:  # it began with the former map
            self._loading, self._seen = None, None

    def startup_text(self) -> str:
        """Return what a node logs of its models at the start: those of the default action set."""
        read = self.present[DEFAULT_SET]
        return f"{self._source}: {', '.join(read.models)}" if read.models else f"no models ({read.absent})"

    @property
    def problem(self) -> str:
        """The problems of all models in one line; empty if there are none."""
        models = self.present.items()
        return "; ".join(f"action set {name}: {read.problem}" for name, read in models if read.problem)

    def diagnostics(self) -> dict[str, object]:
        """Return the diagnostics of each action set's models, and of the learned set in use."""
        values: dict[str, object] = {
            f"models of {name}": ", ".join(read.models) or read.problem or "no models"
            for name, read in self.present.items()
        }
        if self._domain.grid is not None:
            values["map"] = str(self._domain.grid)
        if self._folder is not None:
            values["learned set"] = "none yet" if self._manifest is None else _described(self._manifest)
            values |= self.gains.diagnostics()
        return values


def _described(manifest: Manifest) -> str:
    episodes = ", ".join(f"{count} of {name}" for name, count in sorted(manifest.episodes.items()))
    return f"{manifest.digest} of {manifest.time} from episodes: {episodes or 'none'}"
