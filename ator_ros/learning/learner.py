"""The node `learning` without ROS: when to learn, and what to report."""

from __future__ import annotations

import contextlib
import errno
import itertools
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ator_ros.experience.store import RecordStore, StoreInfo, is_store
from ator_ros.experience.table import Episode
from ator_ros.files import (
    DamagedFileError,
    FileError,
    exclusive_folder,
    identity_of,
    load,
    save,
    set_aside,
)
from ator_ros.learning.gains import GAINS, ChainGain, Gains, add_chains, read_gains
from ator_ros.learning.process import RoundProcess
from ator_ros.learning.sets import (
    RECORDS,
    Count,
    Manifest,
    current_set,
    publish,
    read_manifest,
    remove_old,
    repair,
)
from ator_ros.schema import SchemaError, structured

ROUND = "round.json"
KIND = "round of learning"
FROZEN = "frozen"
# real s; a round of 20,000 episodes takes some seconds, but at the lowest priority
_LONGEST_ROUND = 1800.0
_MOST_WAITING = 1000  # records in memory, about 2 MB; older ones are lost
_WRITING = 1.0  # real s of writing between which other records are taken
_BLOCK = 100  # records of a transaction, for which a busy disk needs up to 80 ms
_SHARE = 0.02  # new records, as a share of all, after which to learn again


@dataclass(frozen=True)
class Verdict:
    """Result of a round for a measure of an action: the fields of `RoundVerdict` but the tree."""

    episodes: Count
    reason: str
    kind: str


@dataclass(frozen=True)
class RoundResult:
    """The fields of round.json: what `learn` returned, and the records stored when it began."""

    made: str = ""
    actions: dict[str, Verdict] = field(default_factory=dict)
    ends: Count = 0


class Learner:
    """Stores records, starts rounds of learning, and publishes sets with better models.

    The folder is locked for this process. While it cannot be read or written, or has disappeared,
    the newest 1000 records are kept in memory, and written when it is back. Damaged files are
    renamed, see `set_aside`.

    Parameters
    ----------
    begin : callable
        Starts a round; may raise OSError.
    start : str
        Digest of the models of the start, see `digest_of_start`.
    batch : int
        New records after which a round begins, if they are at least 2 % of all.
    most : int
        How many episodes of an action set are kept.

    Attributes
    ----------
    manifest : Manifest or None
        That of the published set in use; None: the models of the start are in use.
    gains : Gains
        Measured gains of the set in use.
    fault : str
        Why records are kept in memory; empty while they are written.
    frozen : bool
        Whether publishing is frozen; persists across restarts.
    taken, left_out, lost : int
        Records given to `take`, `take_chain` and `miss`, rejected by the caller, and never written.

    Raises
    ------
    FileError, OSError
        The folder is of another robot or domain, is used by another process, or cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        info: StoreInfo,
        begin: Callable[[], RoundProcess],
        *,
        start: str,
        batch: int,
        most: int = 20_000,
    ) -> None:
        self._folder = folder
        self._begin = begin
        self._batch = batch
        self._most = most
        self._info = info
        self._start = start
        self._lock = contextlib.ExitStack()
        # Records with their action set, and chains with the digest of the models of their gain.
        self._waiting: deque[tuple[str, Episode | ChainGain]] = deque(maxlen=_MOST_WAITING)
        self._round: RoundProcess | None = None
        self._round_began = 0.0  # real time in s
        self._round_ends = 0  # `stored` when it began
        self._requested = False
        self._last = RoundResult()
        self._is_saved = True  # whether round.json holds `_last`
        self._damage = ""  # what was set aside
        self._round_problem = ""
        self.fault = ""
        self.gains = Gains()
        self.taken = self.left_out = self.lost = 0
        self.manifest: Manifest | None = None
        try:
            self._open()
        except (FileError, OSError):
            self._lock.close()
            raise
        self._last = self._last_round()

    def _open(self) -> None:
        """Lock the folder and open its store; set aside what is damaged."""
        self._lock.close()
        self._lock.enter_context(exclusive_folder(self._folder))
        self._opened = identity_of(self._folder)
        self.frozen = (self._folder / FROZEN).exists()
        self._read_set()
        records = self._folder / RECORDS
        try:
            self._store = self._opened_store(records)
        except DamagedFileError as error:
            self._set_aside(records, error)
            self._store = self._opened_store(records)
        remove_old(self._folder)

    def _opened_store(self, records: Path) -> RecordStore:
        seen = () if self.manifest is None else self.manifest.seen.values()
        first = max(self._last_round().ends, *seen, 0)
        return RecordStore(records, self._info, most=self._most, first=first)

    def _open_again(self) -> None:
        """Open the store that was closed or replaced, also in a folder that came back.

        An empty folder in its place is not used: it may be the mount point of a share.
        """
        is_same = identity_of(self._folder) == self._opened
        records = self._folder / RECORDS
        if not is_store(records):
            if not is_same:
                raise FileNotFoundError(errno.ENOENT, "its records have disappeared")
            deleted = f"{records}: expected a store of records, it was deleted; a new one is used"
            self._damage = self._damage or deleted  # or it was set aside
        self._store.close()
        self._open()

    def _read_set(self) -> None:
        """Read the manifest of the set in use, and its gains."""
        if repaired := repair(self._folder):
            self._damage = repaired
        place = current_set(self._folder)
        self.manifest = None if place is None else read_manifest(place)
        models = self._start if self.manifest is None else self.manifest.digest
        try:
            self.gains = read_gains(self._folder, models)
        except DamagedFileError as error:
            self._set_aside(self._folder / GAINS, error)
            self.gains = Gains(models)

    def _last_round(self) -> RoundResult:
        """Return the last round, from its file at the start; without the file a round is due."""
        file = self._folder / ROUND
        if self._last != RoundResult() or not file.exists():
            return self._last
        try:
            return load(file, KIND, RoundResult)
        except DamagedFileError as error:
            self._set_aside(file, error)
            return RoundResult()

    def _set_aside(self, path: Path, error: Exception) -> None:
        self._damage = f"{error}; renamed to {set_aside(path).name}"

    @property
    def problem(self) -> str:
        """The problems that diagnostics warn of; empty without one."""
        return "; ".join(filter(None, (self.fault, self._damage, self._round_problem)))

    def freeze(self, frozen: bool) -> None:
        """Freeze or unfreeze publishing; freezing ends a running round.

        Raises OSError, and changes nothing, if that cannot be written.
        """
        if frozen:
            (self._folder / FROZEN).touch()
            self._end_round()
        else:
            (self._folder / FROZEN).unlink(missing_ok=True)
        self.frozen = frozen

    def learn_now(self) -> str:
        """Request a round; return why it cannot start, empty if it can."""
        if self.frozen:
            return "learning is frozen"
        self._requested = True
        return ""

    def take(self, action_set: str, episode: Episode) -> None:
        """Take a record, which `work` stores."""
        self._put(action_set, episode)

    def take_chain(self, chain: ChainGain) -> None:
        """Take a chain, which `work` adds to the gains of the set that is in use now."""
        self._put(self.gains.models, chain)

    def miss(self, count: int) -> None:
        """Count records as lost that came faster than they were taken."""
        self.taken += count
        self.lost += count

    def _put(self, key: str, taken: Episode | ChainGain) -> None:
        self.taken += 1
        self.lost += len(self._waiting) == self._waiting.maxlen
        self._waiting.append((key, taken))

    def work(self, now: float, *, may_begin: bool = True) -> str | None:
        """Store what was taken, and start or finish a round at the real time `now` (s).

        Call this several times a second. Returns a message when a round ends. No round starts
        unless `may_begin`.
        """
        self._write_waiting()
        due = max(self._batch, _SHARE * min(self.stored, self._most))
        if self._round is not None:
            if self._round.done:
                result = self._round.result()
                self._round = None
                return self._finish(result)
            if now - self._round_began > _LONGEST_ROUND:
                self._end_round()
                return self._finish({"failed": f"it took longer than {_LONGEST_ROUND:g} s"})
        elif self.fault or self.frozen or not may_begin:
            return None
        elif self._requested or self.new >= due:
            return self._start_round(now)
        return None

    def _start_round(self, now: float) -> str | None:
        """Start a round at the real time `now` (s); return why it could not start."""
        self._requested = False
        self._round_began = now
        self._round_ends = self.stored
        try:
            self._read_set()  # its process refuses a damaged set
            self._round = self._begin()
        except (FileError, OSError) as error:
            return self._finish({"failed": str(error)})
        return None

    @property
    def stored(self) -> int:
        """Records that were ever stored in the folder."""
        return self._store.stored

    @property
    def new(self) -> int:
        """Records since the last round."""
        return max(self.stored - self._last.ends, 0)

    def _finish(self, result: dict[str, Any]) -> str:
        """Publish the set of a round, if it made one; return what to report."""
        self._is_saved = False
        failure = f"learning failed: {result['failed']}" if "failed" in result else ""
        found = RoundResult()
        if not failure:
            try:
                found = structured(result, RoundResult)
            except SchemaError as error:
                failure = f"learning failed: {error}"
        self._round_problem = failure
        if failure:
            self._last = replace(self._last, ends=self._round_ends)
            self._store.close()  # it is checked when it is opened again
        else:
            self._last = replace(found, made="", ends=self._round_ends)
            self._damage = ""
            if found.made and not self.frozen:
                self._publish(Path(found.made))
        self._write_waiting()
        return self._round_problem or self._summary()

    def _publish(self, made: Path) -> None:
        try:
            publish(self._folder, made)
            self._read_set()
            remove_old(self._folder)
        except (OSError, FileError) as error:
            self._round_problem = f"a new set could not be published: {error}"
            kept = {name: replace(each, kind="") for name, each in self._last.actions.items()}
            self._last = replace(self._last, actions=kept)

    def _summary(self) -> str:
        """Return the result of the last round: durations, and what else was replaced."""
        verdicts = self._last.actions.items()
        # "SET/ACTION" is the duration of an action, "SET/ACTION/MEASURE" another measure.
        shown = {
            name: verdict for name, verdict in verdicts if verdict.kind or name.count("/") == 1
        }
        return (
            "; ".join(f"{name}: {verdict.reason}" for name, verdict in shown.items()) or "none yet"
        )

    def diagnostics(self) -> dict[str, object]:
        """Return the values of the diagnostics, by name."""
        values: dict[str, object] = {
            "records stored": self.stored,
            "records taken": self.taken,
            "records left out": self.left_out,
            "records waiting in memory": len(self._waiting),
            "records lost": self.lost,
            "records since the last round": self.new,
            "frozen": self.frozen,
            "learning": "under way" if self._round is not None else "waiting for records",
            "set": "that of the start" if self.manifest is None else self.manifest.digest,
            "last switch": "never" if self.manifest is None else self.manifest.time,
        }
        values |= self.gains.diagnostics()
        for name, verdict in self._last.actions.items():
            values[f"{name}: episodes"] = verdict.episodes
            values[f"{name}: {'switched' if verdict.kind else 'not switched'}"] = verdict.reason
        return values

    def close(self) -> None:
        """End a running round and close the store; records that cannot be written are lost."""
        self._end_round()
        self._write_waiting(within=math.inf)
        self.lost += len(self._waiting)
        self._waiting.clear()
        self._store.close()
        self._lock.close()

    def _end_round(self) -> None:
        if self._round is not None:
            self._round.kill()
            self._round = None

    def _write_waiting(self, within: float = _WRITING) -> None:
        """Write what waits for about `within` s, if the folder is in place.

        `fault` is why it cannot be written.
        """
        try:
            if not self._store.is_in_place():
                self._open_again()
            end = time.monotonic() + within
            while self._waiting and time.monotonic() <= end:
                self._write_oldest()
            if not self._is_saved:
                save(self._folder / ROUND, KIND, self._last)
                self._is_saved = True
        except (FileError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else error
            self.fault = (
                f"{self._folder}: expected a folder that can be written: {reason}; "
                f"the newest {_MOST_WAITING} records wait in memory"
            )
        else:
            self.fault = ""

    def _write_oldest(self) -> None:
        """Write up to `_BLOCK` records that wait longest, as far as they belong together.

        Set the store aside if it is damaged.
        """
        oldest = itertools.islice(self._waiting, _BLOCK)
        (_, key), group = next(itertools.groupby(oldest, lambda each: (type(each[1]), each[0])))
        taken = [each for _, each in group]
        episodes = [each for each in taken if isinstance(each, Episode)]
        chains = [each for each in taken if isinstance(each, ChainGain)]
        try:
            if episodes:
                self._store.append(key, *episodes)
            elif key == self.gains.models:
                self.gains = add_chains(self._folder, self.gains, *chains)
        except DamagedFileError as error:
            self._set_aside(self._folder / RECORDS, error)  # a new store is opened next time
            raise
        for _ in taken:
            self._waiting.popleft()
