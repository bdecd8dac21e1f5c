"""Files that appear whole or not at all, and say how they were made."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

_DIGITS = 300


@contextlib.contextmanager
def replaced(path: Path | str) -> Iterator[Path]:
    """Give a temporary file beside `path` to write to; it takes the place of `path` when the block ends well.

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


def is_name(value: object) -> bool:
    """Say whether `value` may name an action or a set of them, and so a file or a folder."""
    return isinstance(value, str) and value.isascii() and value.isidentifier()


def portable_command(name: str, words: Sequence[str]) -> str:
    """Give a command line as it is to be recorded: files without the folders of this machine."""
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


def read_json(path: Path, **options: Any) -> Any:
    """Read a JSON file; `options` are those of ``json.loads``.

    Raises
    ------
    UnreadableError
        The file cannot be read, is no JSON, or is nested beyond reason.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"), parse_int=_whole, **options)
    except (OSError, RecursionError, ValueError) as error:
        raise UnreadableError(f"{path}: expected a readable JSON file: {error}") from error
