"""Sets of models that were learned, in a folder of their own.

    FOLDER/sets/000003-1f0c…/    a set: laid out as models/, with set.manifest; never changed
    FOLDER/current               link to the set in use; replaced atomically

Readers resolve `current` first and then read one folder, so that two sets are never mixed.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from ator_ros.files import (
    LARGEST_JSON,
    DamagedFileError,
    FileError,
    load,
    read_bytes,
    save,
    set_aside,
)
from ator_ros.performance.model_file import models_folder
from ator_ros.schema import Within

KIND = "learned set"
MANIFEST = "set.manifest"
CURRENT = "current"
RECORDS = "records"
KEPT = 10  # newest sets that are kept, besides the one in use
_SETS = "sets"
_NAME = re.compile(r"[0-9]{6}-\w+", re.ASCII)  # of a set: its number, and its digest

Count = Annotated[int, Within(0, 10**12)]
"""A number of records."""


@dataclass(frozen=True)
class Manifest:
    """The fields of set.manifest: digest of the other files, and time as in 2026-01-31T12:00:00Z.

    `episodes` are numbers of records by SET/ACTION. By the same names, with /MEASURE but for
    durations, `seen` are the numbers from which on records are new to it, and `reasons` why trees
    were replaced.
    """

    digest: str
    time: str
    episodes: dict[str, Count]
    seen: dict[str, Count]
    reasons: dict[str, str]


def digest_of(folder: Path, files: Iterable[Path] | None = None) -> str:
    """Return a short digest of files in a folder: by default those of a set, without its manifest.

    Raises OSError, and DamagedFileError for a file that is missing, too large, or no ordinary file.
    """
    sha = hashlib.sha256()
    for file in sorted(folder.rglob("*.json") if files is None else files):
        try:
            content = read_bytes(file, LARGEST_JSON)
        except (FileNotFoundError, ValueError) as error:
            raise DamagedFileError(f"{file}: expected a model: {error}") from error
        sha.update(str(file.relative_to(folder)).encode() + b"\0" + content + b"\0")
    return sha.hexdigest()[:16]


def digest_of_start(models: Path, action_sets: Iterable[str]) -> str:
    """Return the digest of the models of the start; empty if one cannot be read."""
    try:
        files = [
            file for name in action_sets for file in models_folder(models, name).glob("*.json")
        ]
        return digest_of(models, files)
    except (FileError, OSError):
        return ""


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a set.

    Raises FileError, and DamagedFileError if files are missing or have another digest.
    """
    file = folder / MANIFEST
    try:
        if not file.exists():
            raise DamagedFileError(f"{file}: expected the manifest of a set, there is none")
        manifest = load(file, KIND, Manifest)
        found = digest_of(folder)
    except OSError as error:
        raise FileError(f"{folder}: expected a set of models: {error}") from error
    if found != manifest.digest:
        expected = f"expected files with the digest {manifest.digest}"
        raise DamagedFileError(f"{folder}: {expected}, got {found}")
    return manifest


def current_set(folder: Path) -> Path | None:
    """Return the set in use; None if none was published, or `current` is no link to a set.

    Raises OSError if the folder cannot be read.
    """
    try:
        target = (folder / CURRENT).readlink()
    except FileNotFoundError:
        return None
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        return None  # no link: a damaged folder
    place = folder / target
    return place if place.parent == folder / _SETS and _NAME.fullmatch(place.name) else None


def repair(folder: Path) -> str:
    """Set a damaged set in use aside, and let `current` point to the newest set that is intact.

    Without one, `current` is removed. Return what was repaired, else "". Raises OSError if the
    folder cannot be read or written.
    """
    link = folder / CURRENT
    place = current_set(folder)
    if place is None:
        if not os.path.lexists(link):
            return ""
        # What it points to is left alone: it may be anything.
        problem = f"{link}: expected a link to a set; renamed to {set_aside(link).name}"
    else:
        try:
            read_manifest(place)
            return ""
        except DamagedFileError as error:
            problem = str(error)
        except FileError as error:
            raise OSError(errno.EIO, str(error)) from error
        if place.exists():
            problem += f"; renamed to {set_aside(place).name}"
    for other in reversed(sets_in(folder)):
        try:
            read_manifest(other)
        except FileError:
            continue
        point_to(folder, other)
        return f"{problem}; {other.name} is used"
    link.unlink(missing_ok=True)
    return f"{problem}; the models of the start are used"


def new_set_folder(folder: Path) -> Path:
    """Return an empty folder for a new set; see `publish`."""
    place = folder / _SETS / f".new-{os.getpid()}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    return place


def seal(made: Path, manifest: Manifest) -> None:
    """Write the manifest of a new set, with the digest of its files."""
    save(made / MANIFEST, KIND, replace(manifest, digest=digest_of(made)))
    for file in filter(Path.is_file, made.rglob("*")):
        _sync(file)


def publish(folder: Path, made: Path) -> Path:
    """Give a sealed set its final name and let `current` point to it; return its folder.

    Raises FileError for a damaged set, and OSError if it cannot be written; `current` then stays as
    it is.
    """
    digest = read_manifest(made).digest
    newest = sets_in(folder)[-1:]
    number = 1 + int(newest[0].name.partition("-")[0]) if newest else 1
    place = folder / _SETS / f"{number:06d}-{digest}"
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
    """Return all published sets, oldest first; other names are no sets."""
    return sorted(place for place in (folder / _SETS).glob("*") if _NAME.fullmatch(place.name))


def remove_old(folder: Path) -> None:
    """Remove unfinished sets, and all but the newest `KEPT` and the one in use."""
    used = current_set(folder)
    for place in (*(folder / _SETS).glob(".new-*"), *sets_in(folder)[:-KEPT]):
        if place != used:
            shutil.rmtree(place, ignore_errors=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
