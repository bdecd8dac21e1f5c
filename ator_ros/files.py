"""Files that appear whole or not at all, and say how they were made."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import resource
import shlex
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

LARGEST_JSON = 20_000_000
"""Bytes of a JSON file; the largest model that ships has 40 kB."""
_DIGITS = 300
_LONGEST_NAME = 100  # characters; a file's name may have 255 bytes


@contextlib.contextmanager
def replaced(path: Path | str) -> Iterator[Path]:
    """Yield a temporary file beside `path` to write to; it replaces `path` when the block ends well.

    Missing folders are made. When the block raises, `path` is left as it was.
    """
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{file.name}.", suffix=file.suffix, dir=file.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, file)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` as UTF-8 to `path`, whole or not at all."""
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


@contextlib.contextmanager
def reserved(folder: Path | str, size: int) -> Iterator[Callable[[], None]]:
    """Keep room in `folder`, made when missing, for what a long work will write there.

    Parameters
    ----------
    folder : Path or str
        Where the work's results go.
    size : int
        Bytes that they need.

    Yields
    ------
    callable
        Frees the room before the block ends.

    Raises
    ------
    OSError
        There is not so much room, or the folder cannot be written; one line that names it.
    """
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
        # It has no name, so that nothing remains of a process that is killed.
        ballast = tempfile.TemporaryFile(dir=place)  # noqa: SIM115 (the block below closes it)
    except OSError as error:
        raise OSError(f"{place}: expected a folder that can be written: {error.strerror}") from error
    with ballast:
        try:
            os.posix_fallocate(ballast.fileno(), 0, size)
        except OSError as error:
            needed = f"{size / 1e6:.1f} MB"
            raise OSError(f"{place}: expected room for {needed} of results: {error.strerror}") from error
        yield ballast.close


@contextlib.contextmanager
def alone_in(folder: Path | str) -> Iterator[None]:
    """Keep other processes that ask for the same out of `folder`, made when missing, during the block.

    The end of this process, however it dies, frees it. On a file system without locks nobody is kept out.

    Raises
    ------
    OSError
        Another process is in it, or there is no such folder and it cannot be made.
    """
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
        handle = os.open(place, os.O_RDONLY)
    except OSError as error:
        raise OSError(f"{place}: expected a folder that can be written: {error.strerror}") from error
    try:
        if is_locked_elsewhere(handle):
            raise OSError(f"{place}: expected a folder of its own, another command is writing there")
        yield
    finally:
        os.close(handle)


def is_locked_elsewhere(handle: int) -> bool:
    """Lock the file that is open as `handle`; return whether another process has locked it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # no locks here
        return False
    return False


@contextlib.contextmanager
def limited_memory(extra: int) -> Iterator[None]:
    """Let this process take at most `extra` bytes more in the block: a small file may unpack to any size.

    What needs more raises MemoryError. Without Linux's /proc nothing is limited.
    """
    pages = Path("/proc/self/statm")
    if not pages.exists():
        yield
        return
    now = int(pages.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    bounds = [bound for bound in (now + extra, *before) if bound != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(bounds), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def is_name(value: object) -> bool:
    """Return whether `value` may name an action or a set of them, and so a file or a folder."""
    return isinstance(value, str) and len(value) <= _LONGEST_NAME and value.isascii() and value.isidentifier()


def portable_command(name: str, words: Sequence[str]) -> str:
    """Return a command line as it is to be recorded: files without the folders of this machine."""
    return shlex.join([name, *(Path(word).name if "/" in word else word for word in words)])


def _umask() -> int:
    # The umask can only be read by setting it.
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


class UnreadableError(ValueError):
    """A file that holds no JSON; the message names it."""


def _whole(digits: str) -> int:
    # More than anything here needs; a little more, and no float holds it.
    if len(digits) > _DIGITS:
        raise ValueError(f"expected numbers below 1e{_DIGITS}, got one of {len(digits)} digits")
    return int(digits)


def read_text(path: Path, largest: int) -> str:
    """Read a text file of at most `largest` bytes.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is larger, not in UTF-8, or no ordinary file.
    """
    if not path.is_file() and path.exists():  # opening a pipe would wait for its other end
        raise ValueError("expected an ordinary file, got a folder, a pipe or a device")
    with path.open("rb") as file:
        data = file.read(largest + 1)  # not more, whatever kind of file it is
    if len(data) > largest:
        raise ValueError(f"expected at most {largest / 1e6:g} MB, got more")
    return data.decode("utf-8")


def read_json(path: Path, *, largest: int = LARGEST_JSON, **options: Any) -> Any:
    """Read a JSON file; `options` are those of ``json.loads``.

    Raises
    ------
    UnreadableError
        The file cannot be read, has more than `largest` bytes, is no JSON, or is nested beyond reason.
    """
    try:
        return json.loads(read_text(path, largest), parse_int=_whole, **options)
    except FileNotFoundError:
        raise UnreadableError(f"{path}: expected a JSON file, there is none") from None
    except (OSError, RecursionError, ValueError) as error:
        raise UnreadableError(f"{path}: expected a readable JSON file: {error}") from error
