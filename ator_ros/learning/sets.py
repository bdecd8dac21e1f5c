"""Sets of models, gates and calibrations that were learned, in a folder of their own.

    FOLDER/sets/000003-1f0c…/    a set: laid out as models/, with set.manifest; never changed
    FOLDER/current               link to the set in use; replaced atomically
    FOLDER/lock                  held by the node that writes here

Readers resolve `current` first and then read one folder, so that two sets are never mixed.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from ator_ros.files import load, save
from ator_ros.schema import Within

KIND = "learned set"
MANIFEST = "set.manifest"
CURRENT = "current"
RECORDS = "records"
KEPT = 10
"""Sets that are kept: the newest, and the one in use."""
_SETS = "sets"


class LearnedSetError(ValueError):
    """A folder of learned sets, or a set, that cannot be used; the message names it."""


@dataclass(frozen=True)
class Change:
    """Why a tree of an action's model was replaced.

    Attributes
    ----------
    action_set, action : str
        Names of both.
    kind : str
        Name of the new tree, see `candidates`.
    tested : int
        Number of records on which both trees were compared; neither was learned from them.
    before, after : float or None
        Mean loss of the predictions of these, see `RoundVerdict`; None: there was no tree.
    chance : float
        p-value, see `Comparison`.
    measure : str
        Measure that the tree predicts.
    """

    action_set: str
    action: str
    kind: str
    tested: int
    before: float | None
    after: float
    chance: Annotated[float, Within(0.0, 1.0)]
    measure: str = "duration"


@dataclass(frozen=True)
class Manifest:
    """The fields of set.manifest.

    Attributes
    ----------
    digest : str
        Digest of the files of the set, without this one.
    time : str
        When it was learned, as in 2026-01-31T12:00:00Z.
    parent : str
        Name of the set before; empty: the models that the node was started with.
    episodes : mapping
        Number of records by action set and action.
    seen : mapping
        Number from which on records are new to it, by action set, action and, but for durations, measure.
    changes : tuple of Change
        The trees that were replaced.
    """

    digest: str
    time: str
    parent: str
    episodes: dict[str, int]
    seen: dict[str, int]
    changes: tuple[Change, ...] = field(default=())


def digest_of(folder: Path) -> str:
    """Return a short digest of the files of a set, without its manifest."""
    sha = hashlib.sha256()
    for file in sorted(folder.rglob("*.json")):
        if file.name != MANIFEST:
            sha.update(str(file.relative_to(folder)).encode() + b"\0" + file.read_bytes() + b"\0")
    return sha.hexdigest()[:16]


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a set and check the digest of its files.

    Raises
    ------
    LearnedSetError
        The manifest cannot be read, or the files have another digest.
    """
    file = folder / MANIFEST
    manifest = load(file, KIND, Manifest, error=LearnedSetError)
    try:
        found = digest_of(folder)
    except OSError as error:
        raise LearnedSetError(f"{file}: expected a set of models: {error}") from error
    if found != manifest.digest:
        raise LearnedSetError(f"{folder}: expected files with the digest {manifest.digest}, got {found}")
    return manifest


def current_set(folder: Path) -> Path | None:
    """Return the set in use; None if none was published."""
    try:
        name = (folder / CURRENT).readlink()
    except OSError:
        return None
    return folder / name


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder of learned sets against other writers during the block; a killed process frees it.

    Raises
    ------
    LearnedSetError
        Another process holds the lock.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # Opening a pipe would wait for its other end.
    with open(folder / "lock", "a", opener=lambda path, flags: os.open(path, flags | os.O_NONBLOCK)) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise LearnedSetError(
                f"{folder}: expected a folder of its own, another node learns here"
            ) from error
        yield


def new_set_folder(folder: Path) -> Path:
    """Return an empty folder for a new set; see `publish`."""
    sets = folder / _SETS
    sets.mkdir(parents=True, exist_ok=True)
    place = sets / f".new-{os.getpid()}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    return place


def seal(made: Path, manifest: Mapping[str, object], changes: tuple[Change, ...]) -> str:
    """Write the manifest of a new set, and return its digest."""
    digest = digest_of(made)
    content = {"digest": digest, **manifest, "changes": [asdict(change) for change in changes]}
    save(made / MANIFEST, KIND, content)
    for file in filter(Path.is_file, made.rglob("*")):
        _sync(file)
    return digest


def publish(folder: Path, made: Path) -> Path:
    """Give a sealed set its final name and let `current` point to it; return its folder.

    Raises
    ------
    LearnedSetError
        The set is damaged.
    OSError
        It cannot be written; then `current` is as it was.
    """
    digest = read_manifest(made).digest
    numbers = [int(name.name.partition("-")[0]) for name in sets_in(folder)]
    place = folder / _SETS / f"{max(numbers, default=0) + 1:06d}-{digest}"
    made.rename(place)
    _sync(place.parent)
    point_to(folder, place)
    return place


def point_to(folder: Path, place: Path) -> None:
    """Let `current` point to a set; atomic."""
    link = folder / f".{CURRENT}-{os.getpid()}"
    link.unlink(missing_ok=True)
    link.symlink_to(place.relative_to(folder))
    os.replace(link, folder / CURRENT)
    _sync(folder)


def sets_in(folder: Path) -> list[Path]:
    """Return all published sets, oldest first."""
    places = (folder / _SETS).iterdir() if (folder / _SETS).is_dir() else ()
    return sorted(place for place in places if place.name[:6].isdecimal())


def remove_old(folder: Path) -> None:
    """Remove unfinished sets, and all but the newest `KEPT` and the one in use."""
    used = current_set(folder)
    for place in (folder / _SETS).glob(".new-*"):
        shutil.rmtree(place, ignore_errors=True)
    for place in sets_in(folder)[:-KEPT]:
        if place != used:
            shutil.rmtree(place, ignore_errors=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
