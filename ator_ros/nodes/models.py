"""The performance models of a node: read at the start, and replaced by learned sets."""

from __future__ import annotations

import errno
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.available_models import with_path_times
from ator_ros.domains.domain import Domain
from ator_ros.files import DamagedFileError, FileError
from ator_ros.learning.gains import GAINS, Gains, read_gains
from ator_ros.learning.sets import Manifest, current_set, digest_of_start, read_manifest
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.parameters import Parameter, map_topic
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import NoModelsError, RobotMismatchWarning, load_models
from ator_ros.performance.path_times import path_times_remark
from ator_ros.printable import one_line
from ator_ros.tops.library import TopLibrary

LEARNED = Parameter(
    "learned",
    "",
    "folder of the node `learning`, whose set replaces `models` once there is one; empty: none",
)
_PERIOD = 0.5  # real s between two looks at the learned folder
_LONGEST_READ = 90.0  # real s; a new set may compile for a minute
_LONGEST_ANSWER = 2.0  # real s of the file system, while the main thread waits for it


@dataclass(frozen=True)
class ModelSet:
    """The performance models of one action set: of each of its actions.

    Actions without a learned model have `path_time_model`. `absent` is the reason if none was
    learned. `problem` is a fault, such as a damaged file or another robot; to have no learned
    models is none.
    """

    models: Mapping[str, PerformanceModel]
    absent: str = ""
    problem: str = ""

    def __str__(self) -> str:
        """Return the actions, and which of them have no learned model."""
        learned = [name for name, model in self.models.items() if model.is_learned]
        others = path_times_remark(name for name in self.models if name not in learned)
        return "; ".join(filter(None, (", ".join(learned), others)))


@dataclass(frozen=True)
class LearnedModels:
    """What was read from a learned folder.

    `place` is the set in use, None without one. `manifest` and `models` are None unless it has
    changed; `failure` is why a new one cannot be used. `gains` are None unless they have changed;
    `gains_state` are digest of the models and time stamp of the file (ns) that were read last.
    """

    place: Path | None
    gains_state: tuple[str, int]
    gains: Gains | None = None
    gains_problem: str = ""
    manifest: Manifest | None = None
    models: Mapping[str, ModelSet] | None = None
    failure: str = ""


class LearnedSets:
    """The models of a node.

    They are those of its parameter `models`, or the set in use of its parameter `learned`.
    `warm_up` is called with the library of an action set and its models before they are used, in a
    thread for a new learned set. That thread also watches the learned folder, since a network share
    may hang. While it cannot be read, what is in use is kept. The main thread reads the folder at
    the start and for each new map, but not before the first one if that comes from a topic; if its
    set cannot be read then, the models of `models` are used until it can.

    Attributes
    ----------
    present : mapping of str to ModelSet
        The models in use by action set.
    gains : Gains
        The measured gains of chains refined with them.
    """

    def __init__(
        self,
        node: Node,
        domain: Domain,
        libraries: Mapping[str, TopLibrary],
        settings: Mapping[str, Any],
        warm_up: Callable[[TopLibrary, ModelSet], None] = lambda *_: None,
    ) -> None:
        self._node = node
        self._warm_up = warm_up
        self._models = settings["models"]
        self._needs_map = bool(map_topic(settings))
        learned = settings["learned"]
        self._folder = Path(learned).expanduser() if learned else None
        self._had_set = False  # whether the learned folder has named a set in use
        node.get_logger().info(
            "loading models; the first start compiles code, which may take a minute"
        )
        self.load(domain, libraries)
        if self._folder is not None:
            node.create_timer(_PERIOD, partial(self._check_folder, self._folder), clock=STEADY)

    def load(self, domain: Domain, libraries: Mapping[str, TopLibrary]) -> None:
        """Load all models, at the start and for a domain on another map."""
        self._domain = domain
        self._libraries = libraries
        self._reading: Future[LearnedModels] | None = None  # one may use the previous map
        self._reading_began = 0.0  # monotonic s
        self._newest: Path | None = None  # the last set that was read, also if it cannot be used
        self._manifest: Manifest | None = None  # of the learned set in use
        self._set_problem = ""
        self._folder_problem = ""
        self.present: Mapping[str, ModelSet] = {}
        place = domain.models_root(self._models)
        self.gains = Gains(digest_of_start(place, libraries))
        self._gains_state = ("", 0)
        if self._folder is not None and not self._waits_for_map:
            self._read_now(self._folder)
        if not self.present:
            self.present = self._load(place)

    @property
    def _waits_for_map(self) -> bool:
        """Whether the map of learned models has not come yet, so that they cannot be used."""
        return self._needs_map and self._domain.grid is None

    def _read_now(self, folder: Path) -> None:
        """Use the set and the gains of the learned folder, if it can be read."""
        answer = Thread(target=folder.exists, daemon=True)
        answer.start()
        answer.join(_LONGEST_ANSWER)
        try:
            if answer.is_alive():
                raise OSError(f"{folder}: expected an answer of the file system")
            self._use(self._read_folder(folder))
        except (FileError, OSError) as error:
            self._folder_problem = one_line(f"learned: {error}; those of `models` are used")
            self._node.get_logger().warning(self._folder_problem)

    def _load(self, place: Path) -> dict[str, ModelSet]:
        """Read the models of every action set from a folder; log faults."""
        return {name: self._read(library, place) for name, library in self._libraries.items()}

    def _read(self, library: TopLibrary, place: Path) -> ModelSet:
        name = library.action_set
        known = self._domain.known_features
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", RobotMismatchWarning)
                learned = load_models(library.robot, known, action_set=name, folder=place)
            # All models of a folder are usually of the same robot: the first warning suffices.
            problem = str(caught[0].message) if caught else ""
            absent = ""
        except (FileError, OSError) as error:
            learned = {}
            absent = str(error)
            is_usual = isinstance(error, NoModelsError) or not (self._models or place.is_dir())
            problem = "" if is_usual else absent
        models = with_path_times(learned, self._domain, library.robot, name)
        read = ModelSet(models, absent, problem)
        if read.problem and (read.absent or name == DEFAULT_SET):  # other sets are rarely used
            self._node.get_logger().warning(one_line(f"action set {name}: {read.problem}"))
        if not read.absent or name == DEFAULT_SET:
            self._warm_up(library, read)
        return read

    def _read_folder(self, folder: Path) -> LearnedModels:
        """Read what changed in the learned folder.

        Raises FileError and OSError if it cannot be read.
        """
        place = current_set(folder)
        if place is None and self._had_set:
            raise FileError(f"{folder}: expected a set in use, it has disappeared")
        manifest, models, failure = None, None, ""
        digest = self.gains.models
        if place is not None and place != self._newest:
            try:
                manifest, models = self._load_learned(place)
                digest = manifest.digest
            except Exception as error:  # after any error the node continues with the previous set
                if isinstance(error, OSError):
                    raise
                failure = str(error) or repr(error)
        file = folder / GAINS
        state = digest, file.stat().st_mtime_ns if file.exists() else 0
        gains, problem = None, ""
        if state != self._gains_state:
            try:
                gains = read_gains(folder, digest)
            except FileError as error:
                gains = None if manifest is None else Gains(digest)
                state, problem = self._gains_state, f"gains of refined chains are not used: {error}"
        return LearnedModels(place, state, gains, problem, manifest, models, failure)

    def _load_learned(self, place: Path) -> tuple[Manifest, dict[str, ModelSet]]:
        """Load a learned set.

        Raises FileError if some of it cannot be used, and OSError to try again.
        """
        try:
            manifest = read_manifest(place)
        except DamagedFileError:
            raise
        except FileError as error:  # the file system has a fault
            raise OSError(errno.EIO, str(error)) from error
        models = self._load(place)
        if broken := _broken(models):
            raise FileError(broken)
        return manifest, models

    def _check_folder(self, folder: Path) -> None:
        """Use what a thread has read from the learned folder, and let it read again."""
        if self._waits_for_map:
            return
        now = time.monotonic()
        if self._reading is not None:
            if not self._reading.done():
                if now - self._reading_began > _LONGEST_READ:
                    self._folder_problem = f"{folder}: expected an answer of the file system"
                return
            try:
                read = self._reading.result()
            except Exception as error:  # whatever it is, what is in use is kept
                text = str(error) or repr(error)
                self._folder_problem = f"learned: {text}; models in use are kept"
            else:
                self._use(read)
                if read.manifest is not None:
                    text = _described(read.manifest)
                    self._node.get_logger().info(f"switched to the learned set {text}")
        self._reading_began = now
        self._reading = _in_thread(partial(self._read_folder, folder))

    def _use(self, read: LearnedModels) -> None:
        """Switch to a set and gains that changed."""
        self._newest = read.place
        self._had_set = self._had_set or read.place is not None
        self._gains_state = read.gains_state
        self._folder_problem = read.gains_problem
        if read.gains is not None:
            self.gains = read.gains
        if read.manifest is not None and read.models is not None:
            self._manifest = read.manifest
            self.present = read.models
            self._set_problem = ""
        elif read.failure and read.place is not None:
            text = f"the learned set {read.place.name} is not used: {read.failure}"
            self._set_problem = one_line(text)
            self._node.get_logger().warning(self._set_problem)

    def startup_text(self) -> str:
        """Return the source and names of the models of the default action set, else of others."""
        source = f"models in {self._models}" if self._models else "shipped models"
        if self._manifest is not None:
            source = f"learned set {self._manifest.digest}"
        default = self.present[DEFAULT_SET]
        if not default.absent:  # other sets are rarely requested
            return f"{source}: {default}"
        others = [
            f"{source} of action set {name}: {read}"
            for name, read in self.present.items()
            if not read.absent
        ]
        return "; ".join([f"{default} ({default.absent})", *others])

    @property
    def problem(self) -> str:
        """The problems of all models in one line; empty if there are none."""
        models = self.present.items()
        of_models = (f"action set {name}: {read.problem}" for name, read in models if read.problem)
        return "; ".join(filter(None, (self._folder_problem, self._set_problem, *of_models)))

    def diagnostics(self) -> dict[str, object]:
        """Return values for /diagnostics."""
        values: dict[str, object] = {
            f"models of {name}": read.problem or str(read) for name, read in self.present.items()
        }
        if self._domain.grid is not None:
            values["map"] = str(self._domain.grid)
        if self._folder is not None:
            values["learned set"] = (
                "none yet" if self._manifest is None else _described(self._manifest)
            )
            values |= self.gains.diagnostics()
        return values


def _broken(models: Mapping[str, ModelSet]) -> str:
    """Return why some action sets have no models although there are files; else an empty text."""
    return "; ".join(each.problem for each in models.values() if each.absent and each.problem)


def _in_thread(read: Callable[[], LearnedModels]) -> Future[LearnedModels]:
    """Read in a thread that does not delay the end of the process."""
    future: Future[LearnedModels] = Future()

    def run() -> None:
        try:
            future.set_result(read())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future


def _described(manifest: Manifest) -> str:
    episodes = ", ".join(f"{count} of {name}" for name, count in sorted(manifest.episodes.items()))
    return f"{manifest.digest} of {manifest.time} from episodes: {episodes or 'none'}"
