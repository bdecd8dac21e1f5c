"""Sets of models that were learned, in a folder of their own.

    FOLDER/sets/000003-1f0c…/    a set: laid out as models/, with set.manifest; never changed
    FOLDER/current               link to the set in use; replaced atomically

Readers resolve `current` first and then read one folder, so that two sets are never mixed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from ator_ros.files import FileError, load, save
from ator_ros.performance.model_file import models_folder

KIND = "learned set"
MANIFEST = "set.manifest"
CURRENT = "current"
RECORDS = "records"
KEPT = 10  # newest sets that are kept, besides the one in use
_SETS = "sets"


@dataclass(frozen=True)
class Manifest:
    """The fields of set.manifest: digest of the other files, and time as in 2026-01-31T12:00:00Z.

    `episodes` are numbers of records by SET/ACTION. By the same names, with /MEASURE but for
    durations, `seen` are the numbers from which on records are new to it, and `reasons` why trees
    were replaced.
    """

    digest: str
    time: str
    episodes: dict[str, int]
    seen: dict[str, int]
    reasons: dict[str, str]


def digest_of(folder: Path, files: Iterable[Path] | None = None) -> str:
    """Return a short digest of files in a folder: by default those of a set, without its manifest."""
    sha = hashlib.sha256()
    for file in sorted(folder.rglob("*.json") if files is None else files):
        sha.update(str(file.relative_to(folder)).encode() + b"\0" + file.read_bytes() + b"\0")
    return sha.hexdigest()[:16]


def digest_of_start(models: Path, action_sets: Iterable[str]) -> str:
    """Return the digest of the models of the start; empty if one cannot be read."""
    try:
        files = [
            file for name in action_sets for file in models_folder(models, name).glob("*.json")
        ]
        return digest_of(models, files)
    except OSError:
        return ""


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a set; raises FileError, also for files of another digest."""
    manifest = load(folder / MANIFEST, KIND, Manifest)
    try:
        found = digest_of(folder)
    except OSError as error:
        raise FileError(f"{folder}: expected a set of models: {error}") from error
    if found != manifest.digest:
        raise FileError(f"{folder}: expected files with the digest {manifest.digest}, got {found}")
    return manifest


def current_set(folder: Path) -> Path | None:
    """Return the set in use; None if none was published."""
    try:
        name = (folder / CURRENT).readlink()
    except OSError:
        return None
    return folder / name


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
    return sorted(place for place in (folder / _SETS).glob("*") if place.name[:6].isdecimal())


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
