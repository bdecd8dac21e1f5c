"""The performance models of a node: read at the start, and replaced by learned sets."""

from __future__ import annotations

import errno
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

from rclpy.node import Node

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.files import DamagedFileError, FileError
from ator_ros.learning.gains import GAINS, Gains, read_gains
from ator_ros.learning.sets import Manifest, current_set, digest_of_start, read_manifest
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.parameters import Parameter
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import NoModelsError, RobotMismatchWarning, load_models
from ator_ros.printable import one_line
from ator_ros.tops.library import TopLibrary

LEARNED = Parameter(
    "learned",
    "",
    "folder of the node `learning`: its set in use replaces `models` once there is one; empty: none",
)
_PERIOD = 0.5  # s
_LONGEST_READ = 90.0  # real s; a new set may compile for a minute


@dataclass(frozen=True)
class ModelSet:
    """The performance models of one action set, by action.

    `absent` is the reason if there are none. `problem` is a fault, such as a damaged file or
    another robot; to have no models is none.
    """

    models: Mapping[str, PerformanceModel]
    absent: str = ""
    problem: str = ""


@dataclass(frozen=True)
class LearnedModels:
    """What a thread read from a learned folder.

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
    """The models of a node: those of its parameter `models`, or the set in use of its parameter `learned`.

    `present` are the models in use by action set, `gains` the measured gains of chains refined with
    them. `warm_up` is called with the library of an action set and its models before they are used,
    in a thread for a new learned set. That thread also watches the learned folder, since a network
    share may hang. While it cannot be read, what is in use is kept. The main thread reads the
    folder at the start and for each new map; if its set cannot be read then, those of `models` are
    used until it can.
    """

    def __init__(
        self,
        node: Node,
        domain: Domain,
        libraries: Mapping[str, TopLibrary],
        settings: Mapping[str, Any],
        warm_up: Callable[[TopLibrary, ModelSet], None] = lambda *_: None,
    ) -> None:
        models = settings["models"]
        learned = settings["learned"]
        self._models = models
        self._node = node
        self._domain = domain
        self._libraries = libraries
        self._warm_up = warm_up
        self._place = domain.models_root(models)
        self._source = f"models in {models}" if models else "shipped models"
        self._start = digest_of_start(self._place, libraries)
        self._folder = Path(learned).expanduser() if learned else None
        self._newest: Path | None = None  # the last published set, also if it cannot be used
        self._manifest: Manifest | None = None  # of the learned set in use
        self._set_problem = self._folder_problem = ""
        if self._folder is not None:
            self._read_at_start(self._folder)
        node.get_logger().info(
            "loading models; the first start compiles code, which may take a minute"
        )
        self.present: Mapping[str, ModelSet] = self._load(self._place)
        self.gains = Gains(self._digest)
        self._gains_state = ("", 0)
        self._reading: Future[LearnedModels] | None = None
        self._reading_began = 0.0  # monotonic s
        if self._folder is not None:
            with suppress(FileError, OSError):  # the timer reports it
                self.gains = read_gains(self._folder, self._digest)
            node.create_timer(_PERIOD, partial(self._check_folder, self._folder), clock=STEADY)

    @property
    def _digest(self) -> str:
        """Digest of the models in use."""
        return self._start if self._manifest is None else self._manifest.digest

    def _read_at_start(self, folder: Path) -> None:
        """Find the set in use."""
        try:
            self._newest = current_set(folder)
            if self._newest is not None:
                self._manifest = read_manifest(self._newest)
                self._source = f"learned set {self._manifest.digest}"
                self._place = self._newest
        except DamagedFileError as error:
            self._report_failure(str(error))
        except (FileError, OSError) as error:
            self._report_failure(str(error))
            self._newest = None  # it is read again

    def _load(self, place: Path) -> dict[str, ModelSet]:
        """Read the models of every action set from a folder; log faults."""
        return {name: self._read(library, place) for name, library in self._libraries.items()}

    def _read(self, library: TopLibrary, place: Path) -> ModelSet:
        name = library.action_set
        known = self._domain.known_features
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
            self._node.get_logger().warning(one_line(f"action set {name}: {read.problem}"))
        if read.models:
            self._warm_up(library, read)
        return read

    def _read_folder(
        self, folder: Path, newest: Path | None, digest: str, gains_state: tuple[str, int]
    ) -> LearnedModels:
        """Read what changed in the learned folder; in a thread.

        `newest` is the last set that was read, `digest` that of the models in use. Raises FileError
        and OSError if the folder cannot be read.
        """
        place = current_set(folder)
        if place is None and newest is not None:
            raise FileError(f"{folder}: expected a set in use, it has disappeared")
        manifest = None
        models = None
        failure = ""
        if place is not None and place != newest:
            try:
                manifest, models = self._load_learned(place)
                digest = manifest.digest
            except Exception as error:  # after any error the node continues with the previous set
                if isinstance(error, OSError):
                    raise
                failure = str(error) or repr(error)
        file = folder / GAINS
        state = digest, file.stat().st_mtime_ns if file.exists() else 0
        gains = None
        problem = ""
        if state != gains_state:
            try:
                gains = read_gains(folder, digest)
            except FileError as error:
                gains = None if manifest is None else Gains(digest)
                state = gains_state
                problem = f"gains of refined chains are not used: {error}"
        return LearnedModels(place, state, gains, problem, manifest, models, failure)

    def _load_learned(self, place: Path) -> tuple[Manifest, dict[str, ModelSet]]:
        """Load a learned set; raise FileError if some of it cannot be used, OSError to try again."""
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
        now = time.monotonic()
        if self._reading is not None:
            if not self._reading.done():
                if now - self._reading_began > _LONGEST_READ:
                    self._folder_problem = f"{folder}: expected an answer of the file system"
                return
            reading = self._reading
            self._reading = None
            try:
                read = reading.result()
            except Exception as error:  # whatever it is, what is in use is kept
                text = str(error) or repr(error)
                self._folder_problem = f"learned: {text}; models in use are kept"
            else:
                self._folder_problem = read.gains_problem
                self._use(read)
        self._reading_began = now
        self._reading = _in_thread(
            partial(self._read_folder, folder, self._newest, self._digest, self._gains_state)
        )

    def _use(self, read: LearnedModels) -> None:
        """Switch to a set and gains that changed."""
        self._newest = read.place
        self._gains_state = read.gains_state
        if read.gains is not None:
            self.gains = read.gains
        if read.failure:
            self._report_failure(read.failure)
        if read.manifest is not None and read.models is not None and read.place is not None:
            self._manifest = read.manifest
            self.present = read.models
            self._place = read.place
            self._set_problem = ""
            text = _described(read.manifest)
            self._node.get_logger().info(f"switched to the learned set {text}")

    def _report_failure(self, reason: str) -> None:
        name = "" if self._newest is None else self._newest.name
        self._set_problem = one_line(f"the learned set {name} is not used: {reason}")
        self._node.get_logger().warning(self._set_problem)

    def load_again(self, domain: Domain, libraries: Mapping[str, TopLibrary]) -> None:
        """Load the models in use for a domain on another map."""
        self._domain = domain
        self._libraries = libraries
        self.present = self._load(self._place)
        broken = _broken(self.present)
        if self._manifest is not None and broken:
            self._report_failure(broken)
            self._place = domain.models_root(self._models)
            self.present = self._load(self._place)
            self._manifest, self._newest = None, None  # the set is loaded again when it is back
        if self._reading is not None:  # its thread may have used the previous map
            self._reading = None
            self._newest = None

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
        of_models = (f"action set {name}: {read.problem}" for name, read in models if read.problem)
        return "; ".join(filter(None, (self._folder_problem, self._set_problem, *of_models)))

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
