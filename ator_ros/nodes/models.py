"""The performance models of a node: read at the start, and replaced by learned sets."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
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
_PERIOD = 0.5  # s


@dataclass(frozen=True)
class ModelSet:
    """The performance models of one action set, by action.

    `absent` is the reason if there are none. `problem` is a fault, such as a damaged file or
    another robot; to have no models is none.
    """

    models: Mapping[str, PerformanceModel]
    absent: str = ""
    problem: str = ""


class LearnedSets:
    """The models of a node: those of its parameter `models`, or the set in use of its parameter `learned`.

    `present` are the models in use by action set, `gains` the measured gains of chains refined with
    them. `warm_up` is called with the library of an action set and its models before they are used,
    in a thread for a new learned set.
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
        self._place = domain.models_root(models)
        self._source = f"models in {models}" if models else "shipped models"
        self._start = digest_of_start(self._place, libraries)
        self._folder = Path(learned).expanduser() if learned else None
        self._newest = None if self._folder is None else current_set(self._folder)
        self._manifest: Manifest | None = None  # of the learned set in use
        if self._newest is not None:
            try:
                self._manifest = read_manifest(self._newest)
                self._source, self._place = f"learned set {self._manifest.digest}", self._newest
            except FileError as error:
                self._log_failure(error)
        node.get_logger().info(
            "loading models; the first start compiles code, which may take a minute"
        )
        self.present = self._load(self._place)
        self.gains, self._gains_state = Gains(), ("", 0)
        self._threads = ThreadPoolExecutor(1)
        self._loading: Future[tuple[Manifest, dict[str, ModelSet]]] | None = None
        if self._folder is not None:
            self._check_gains(self._folder)
            node.create_timer(_PERIOD, partial(self._check_folder, self._folder), clock=STEADY)

    def _load(self, place: Path) -> dict[str, ModelSet]:
        """Read the models of every action set from a folder; log faults."""
        return {name: self._read(library, place) for name, library in self._libraries.items()}

    def _read(self, library: TopLibrary, place: Path) -> ModelSet:
        name, known = library.action_set, self._domain.known_features
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", RobotMismatchWarning)
                models = load_models(library.robot, known, action_set=name, folder=place)
            # All models of a folder are usually of the same robot: the first warning suffices.
            read = ModelSet(models, problem=str(caught[0].message) if caught else "")
        except NoModelsError as error:
            read = ModelSet({}, absent=str(error))
        except (FileError, OSError) as error:
            read = ModelSet({}, absent=str(error), problem=str(error))
        if read.problem and (read.absent or name == DEFAULT_SET):  # other sets are rarely used
            self._node.get_logger().warning(f"action set {name}: {read.problem}")
        if read.models:
            self._warm_up(library, read)
        return read

    def _load_learned(self, place: Path) -> tuple[Manifest, dict[str, ModelSet]]:
        """Load a learned set; raise FileError if some of it cannot be used."""
        manifest, read = read_manifest(place), self._load(place)
        if broken := [each.problem for each in read.values() if each.absent and each.problem]:
            raise FileError("; ".join(broken))
        return manifest, read

    def _check_folder(self, folder: Path) -> None:
        """Switch to a set that has been loaded, or start to load a new one.

        Read gains that changed.
        """
        self._check_gains(folder)
        if self._loading is None:
            place = current_set(folder)
            if place is not None and place != self._newest:
                self._newest = place
                self._loading = self._threads.submit(self._load_learned, place)
        elif self._loading.done():
            loading, self._loading = self._loading, None
            try:
                self._manifest, self.present = loading.result()
                self._place = self._newest or self._place
            except Exception as error:  # after any error the node continues with the previous set
                self._log_failure(error)
            else:
                self._node.get_logger().info(
                    f"switched to the learned set {_described(self._manifest)}"
                )

    def _check_gains(self, folder: Path) -> None:
        file = folder / GAINS
        models = self._start if self._manifest is None else self._manifest.digest
        state = models, file.stat().st_mtime_ns if file.exists() else 0
        if state != self._gains_state:
            self._gains_state = state
            try:
                self.gains = read_gains(folder, models)
            except FileError as error:
                self.gains = Gains(models)
                self._node.get_logger().warning(f"gains of refined chains are not used: {error}")

    def _log_failure(self, error: Exception) -> None:
        name = "" if self._newest is None else self._newest.name
        self._node.get_logger().warning(
            f"the learned set {name} is not used: {str(error) or repr(error)}"
        )

    def load_again(self, domain: Domain, libraries: Mapping[str, TopLibrary]) -> None:
        """Load the models in use for a domain on another map."""
        self._domain, self._libraries = domain, libraries
        self.present = self._load(self._place)
        if self._loading is not None:  # its thread uses the previous map
            self._loading, self._newest = None, None

    def startup_text(self) -> str:
        """Return the source and names of the models of the default action set."""
        read = self.present[DEFAULT_SET]
        return (
            f"{self._source}: {', '.join(read.models)}"
            if read.models
            else f"no models ({read.absent})"
        )

    @property
    def problem(self) -> str:
        """The problems of all models in one line; empty if there are none."""
        models = self.present.items()
        return "; ".join(
            f"action set {name}: {read.problem}" for name, read in models if read.problem
        )

    def diagnostics(self) -> dict[str, object]:
        """Return values for /diagnostics."""
        values: dict[str, object] = {
            f"models of {name}": ", ".join(read.models) or read.problem or "no models"
            for name, read in self.present.items()
        }
        if self._domain.grid is not None:
            values["map"] = str(self._domain.grid)
        if self._folder is not None:
            values["learned set"] = (
                "none yet" if self._manifest is None else _described(self._manifest)
            )
            values |= self.gains.diagnostics()
        return values


def _described(manifest: Manifest) -> str:
    episodes = ", ".join(f"{count} of {name}" for name, count in sorted(manifest.episodes.items()))
    return f"{manifest.digest} of {manifest.time} from episodes: {episodes or 'none'}"
