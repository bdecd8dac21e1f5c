"""The node `learning` without ROS: when to learn, and what to report."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ator_ros.experience.episode import Episode
from ator_ros.experience.store import RecordStore, StoreInfo
from ator_ros.files import FileError, content_of, read_json, save
from ator_ros.learning.gains import ChainGain, Gains, add_chain, read_gains
from ator_ros.learning.process import RoundProcess
from ator_ros.learning.sets import (
    RECORDS,
    Manifest,
    current_set,
    publish,
    read_manifest,
    remove_old,
)
from ator_ros.schema import SchemaError

ROUND, KIND = "round.json", "round of learning"
FROZEN = "frozen"
# real s; a round of 20,000 episodes takes some seconds, but at the lowest priority
_LONGEST_ROUND = 1800.0
_MOST_WAITING = 1000  # records; older ones are lost
_SHARE = 0.02  # new records, as a share of all, after which to learn again


class Learner:
    """Stores records, starts rounds of learning, and publishes sets with better models.

    No other process may write to the folder of the learned sets, see `exclusive_folder`.

    Parameters
    ----------
    begin : callable
        Starts a round.
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
    problem : str
        The last problem, which diagnostics warn of; empty without one.
    taken, left_out, lost : int
        Records given to `take` and `take_chain`, rejected by the caller, and never written.

    Raises
    ------
    FileError, OSError
        The folder is of another robot or domain, or cannot be written.
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
        self._folder, self._begin, self._batch, self._most = folder, begin, batch, most
        self._start = start
        self._store = RecordStore(folder / RECORDS, info, most=most)
        remove_old(folder)
        # Functions that write a record each, while the disk is full.
        self._waiting: deque[Callable[[], None]] = deque(maxlen=_MOST_WAITING)
        self._round: RoundProcess | None = None
        # its real time in s, and `stored` when it started
        self._round_began, self._round_ends = 0.0, 0
        self._requested = False
        self._last: dict[str, Any] = {}  # result of the last round, the content of round.json
        with contextlib.suppress(FileError, SchemaError):  # without the file a round is due
            self._last = content_of(read_json(folder / ROUND), KIND)
        self.problem = ""
        self.gains = Gains()
        self.taken = self.left_out = self.lost = 0
        self.has_room = True
        self.manifest: Manifest | None = None
        place = current_set(folder)
        if place is not None:
            try:
                self.manifest = read_manifest(place)
            except FileError as error:
                self.problem = str(error)
        self._read_gains()

    @property
    def frozen(self) -> bool:
        """Whether publishing is frozen; persists across restarts."""
        return (self._folder / FROZEN).exists()

    def freeze(self, frozen: bool) -> None:
        """Freeze or unfreeze publishing; freezing ends a running round."""
        if frozen:
            (self._folder / FROZEN).touch()
            self._end_round()
        else:
            (self._folder / FROZEN).unlink(missing_ok=True)

    def learn_now(self) -> str:
        """Request a round; return why it cannot start, empty if it can."""
        if self.frozen:
            return "learning is frozen"
        self._requested = True
        return ""

    def take(self, action_set: str, episode: Episode) -> None:
        """Store a record; it is kept in memory while the disk is full."""
        self.taken += 1
        self._put(lambda: self._store.append(action_set, episode))

    def take_chain(self, chain: ChainGain) -> None:
        """Add a chain to the gains of the set in use.

        It is kept in memory while the disk is full.
        """
        models = self.gains.models

        def write() -> None:
            if self.gains.models == models:
                self.gains = add_chain(self._folder, self.gains, chain)

        self.taken += 1
        self._put(write)

    def _put(self, write: Callable[[], None]) -> None:
        self.lost += len(self._waiting) == self._waiting.maxlen
        self._waiting.append(write)
        self._write_waiting()

    def work(self, now: float, *, may_begin: bool = True) -> str | None:
        """Start or finish a round at the real time `now` (s); return a message when a round ends.

        No round starts unless `may_begin`.
        """
        self._write_waiting()
        due = max(self._batch, _SHARE * min(self.stored, self._most))
        if self._round is not None:
            if self._round.done:
                done, self._round = self._round, None
                return self._finish(done.result())
            if now - self._round_began > _LONGEST_ROUND:
                self._end_round()
                return self._finish({"failed": f"it took longer than {_LONGEST_ROUND:g} s"})
        elif may_begin and not self.frozen and (self._requested or self.new >= due):
            self._round, self._round_began, self._requested = self._begin(), now, False
            self._round_ends = self.stored
        return None

    @property
    def stored(self) -> int:
        """Records that were ever stored in the folder."""
        return self._store.stored

    @property
    def new(self) -> int:
        """Records since the last round."""
        return self.stored - int(self._last.get("ends", 0))

    def _finish(self, result: dict[str, Any]) -> str:
        if "failed" in result:
            self.problem = f"learning failed: {result['failed']}"
            result = {**self._last, "ends": self._round_ends}
        elif result["made"] and not self.frozen:
            try:
                place = publish(self._folder, Path(result["made"]))
                self.manifest = read_manifest(place)
                self._read_gains()
                remove_old(self._folder)
                self.problem = ""
            except (OSError, FileError) as error:
                self.problem = f"a new set could not be published: {error}"
                for verdict in result["actions"].values():
                    verdict["kind"] = ""
        else:
            self.problem = ""
        self._last = {**result, "made": "", "ends": self._round_ends}
        with self._reporting_full_disk():
            save(self._folder / ROUND, KIND, self._last)
        return self.problem or self._summary()

    def _read_gains(self) -> None:
        models = self._start if self.manifest is None else self.manifest.digest
        try:
            self.gains = read_gains(self._folder, models)
        except FileError as error:
            self.gains, self.problem = Gains(models), str(error)

    def _summary(self) -> str:
        """Return the result of the last round: durations, and other measures whose tree was replaced."""
        verdicts = self._last.get("actions", {}).items()
        # "SET/ACTION" is the duration of an action, "SET/ACTION/MEASURE" another measure.
        shown = {
            name: verdict for name, verdict in verdicts if verdict["kind"] or name.count("/") == 1
        }
        return (
            "; ".join(f"{name}: {verdict['reason']}" for name, verdict in shown.items())
            or "none yet"
        )

    def diagnostics(self) -> dict[str, object]:
        """Return the values of the diagnostics, by name."""
        values: dict[str, object] = {
            "records stored": self.stored,
            "records taken": self.taken,
            "records left out": self.left_out,
            "records waiting for room on the disk": len(self._waiting),
            "records lost": self.lost,
            "records since the last round": self.new,
            "frozen": self.frozen,
            "learning": "under way" if self._round is not None else "waiting for records",
            "set": "that of the start" if self.manifest is None else self.manifest.digest,
            "last switch": "never" if self.manifest is None else self.manifest.time,
        }
        values |= self.gains.diagnostics()
        for name, verdict in self._last.get("actions", {}).items():
            values[f"{name}: episodes"] = verdict["episodes"]
            values[f"{name}: {'switched' if verdict['kind'] else 'not switched'}"] = verdict[
                "reason"
            ]
        return values

    def close(self) -> None:
        """End a running round and close the store; records that cannot be written are lost."""
        self._end_round()
        self._write_waiting()
        self.lost += len(self._waiting)
        self._waiting.clear()
        self._store.close()

    def _end_round(self) -> None:
        if self._round is not None:
            self._round.kill()
            self._round = None

    def _write_waiting(self) -> None:
        if self._waiting:  # without a write, a report of a full disk must not be cleared
            with self._reporting_full_disk():
                while self._waiting:
                    self._waiting[0]()
                    self._waiting.popleft()

    @contextlib.contextmanager
    def _reporting_full_disk(self) -> Iterator[None]:
        """Report a full disk until writing succeeds again."""
        try:
            yield
        except OSError as error:
            self.has_room = False
            self.problem = f"{self._folder}: expected room on the disk: {error.strerror}"
        else:
            if not (self.has_room or self._waiting):
                self.has_room, self.problem = True, ""
