"""Files: atomic writing, reading with limits, `save` and `load` for the formats of this package.

Such a file is a JSON object whose first fields are ``format`` ("ator_ros study") and
``schema_version``; the others are the fields of a dataclass, see `ator_ros.schema`.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shlex
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml

from ator_ros.printable import ReadableError, printable, quoted
from ator_ros.schema import SchemaError, structured, unstructured

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
VERSION = 1  # of all formats
_FORMAT = "format"
_VERSION = "schema_version"
_LONGEST_NUMBER = 100  # characters; the decimals of a double have 17 digits
LARGEST_JSON = 20_000_000  # bytes; the largest model that ships has 40 kB
_LONGEST_NAME = 100  # characters; file systems allow 255 bytes


@contextlib.contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Yield a temporary file that replaces `path` at the end of the block, unless the block raises.

    Missing folders are created.
    """
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{file.name}.", suffix=file.suffix, dir=file.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0o022)  # the mask can only be read by setting it
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        os.replace(temporary, file)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` as UTF-8 to `path`, atomically."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


@contextlib.contextmanager
def exclusive_folder(folder: Path | str) -> Iterator[None]:
    """Lock `folder` for this process during the block; create it if it is missing.

    Raises OSError if another process holds the lock. A file system without locks gives no
    protection.
    """
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
        handle = os.open(place, os.O_RDONLY)
    except OSError as error:
        raise OSError(
            f"{place}: expected a folder that can be written: {error.strerror}"
        ) from error
    try:
        if not try_lock(handle):
            raise OSError(
                f"{place}: expected a folder that no other process uses, another one writes there"
            )
        yield
    finally:
        os.close(handle)


def identity_of(path: Path) -> tuple[int, int]:
    """Return device and inode of a file or folder, which change if another takes its place.

    Raises OSError.
    """
    state = path.stat()
    return state.st_dev, state.st_ino


def try_lock(handle: int) -> bool:
    """Lock the open file `handle`; return False if another process holds the lock."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # the file system has no locks
        pass
    return True


def is_name(value: object) -> bool:
    """Return whether `value` is a valid name of an action or an action set, and of their files."""
    return (
        isinstance(value, str)
        and len(value) <= _LONGEST_NAME
        and value.isascii()
        and value.isidentifier()
    )


def portable_command(name: str, words: Sequence[str]) -> str:
    """Return a command line for a record: absolute paths are shortened to file names."""
    return shlex.join([name, *map(_portable, words)])


def _portable(word: str) -> str:
    option, equals, value = word.rpartition("=") if word.startswith("-") else ("", "", word)
    path = Path(value)
    # else a topic
    is_file = path.is_absolute() and path.parent != Path("/") and path.parent.is_dir()
    return f"{option}{equals}{path.name if is_file else value}"


class FileError(ReadableError, ValueError):
    """A file or folder cannot be used; the message names it, the field, and what was expected."""


class DamagedFileError(FileError):
    """A file was read, but its content does not fit its format."""


def set_aside(path: Path) -> Path:
    """Rename a damaged file or folder to NAME.damaged, or NAME.damaged-2 and so on; return it."""
    suffixes = ("", *(f"-{number}" for number in range(2, 1000)))
    names = (f"{path.name}.damaged{suffix}" for suffix in suffixes)
    free = next(place for place in map(path.with_name, names) if not os.path.lexists(place))
    return path.rename(free)


def header(kind: str) -> dict[str, Any]:
    """Return the first fields of a file; `kind` is a word such as "study"."""
    return {_FORMAT: f"ator_ros {kind}", _VERSION: VERSION}


def save(
    path: Path | str,
    kind: str,
    content: DataclassInstance | Mapping[str, Any],
    *,
    compact: Collection[str] = (),
) -> None:
    """Write a file of this kind atomically, with one line for each field in `compact`.

    See `unstructured`.
    """
    fields = content if isinstance(content, Mapping) else unstructured(content)
    lines = []
    for name, value in {**header(kind), **fields}.items():
        style: dict[str, Any] = {"separators": (",", ":")} if name in compact else {"indent": 1}
        text = json.dumps(value, allow_nan=name in compact, **style).replace("\n", "\n ")
        lines.append(f" {json.dumps(name)}: {text}")
    write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")


def load(
    path: Path | str,
    kind: str,
    schema: type[T],
) -> T:
    """Read a file of this kind, see `save`.

    Raises FileError, and DamagedFileError if it does not fit the schema.
    """
    data = read_json(Path(path))
    try:
        return structured(content_of(data, kind), schema)
    except SchemaError as error:
        raise DamagedFileError(f"{path}: {error}") from error


def content_of(data: object, kind: str) -> dict[str, Any]:
    """Return the fields without the header; raises SchemaError if kind or version differ."""
    expected = header(kind)
    if not isinstance(data, dict) or data.get(_FORMAT) != expected[_FORMAT]:
        got = quoted(data.get(_FORMAT)) if isinstance(data, dict) else "no table"
        raise SchemaError(f"{_FORMAT}: expected {expected[_FORMAT]!r}, got {got}")
    if type(data.get(_VERSION)) is not int or data[_VERSION] != VERSION:
        raise SchemaError(f"{_VERSION}: expected {VERSION}, got {quoted(data.get(_VERSION))}")
    return {name: value for name, value in data.items() if name not in expected}


def content_with_optional_header(data: object, kind: str) -> object:
    """Return the fields as `content_of` does, or `data` without a header, as users write it."""
    has_header = isinstance(data, dict) and not data.keys().isdisjoint(header(kind))
    return content_of(data, kind) if has_header else data


def read_text(path: Path, largest: int) -> str:
    """Read a text file as `read_bytes` does; raises ValueError also if it is not in UTF-8."""
    return read_bytes(path, largest).decode("utf-8")


def read_bytes(path: Path, largest: int) -> bytes:
    """Read a file.

    Raises OSError if that fails, and ValueError if it has more than `largest` bytes, or is no
    ordinary file.
    """
    if not path.is_file() and path.exists():  # opening a pipe would block
        raise ValueError("expected an ordinary file, got a folder, a pipe or a device")
    with path.open("rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise ValueError(f"expected at most {largest / 1e6:g} MB, got more")
    return data


def read_json(path: Path) -> Any:
    """Read a JSON file of at most 20 MB.

    Raises FileError, and DamagedFileError if it is no JSON.
    """
    try:
        return json.loads(read_text(path, LARGEST_JSON))
    except FileNotFoundError:
        raise FileError(f"{path}: expected a JSON file, there is none") from None
    except OSError as error:
        raise FileError(f"{path}: expected a readable JSON file: {error}") from error
    except (RecursionError, ValueError) as error:
        raise DamagedFileError(f"{path}: expected a readable JSON file: {error}") from error


def read_yaml(path: Path, *, largest: int) -> Any:
    """Read a YAML file of at most `largest` bytes, without aliases and duplicate keys.

    Raises FileError.
    """
    try:
        return yaml.load(read_text(path, largest), Loader=_PlainLoader)  # noqa: S506 (a SafeLoader)
    except (
        Exception
    ) as error:  # PyYAML raises many on malformed dates, tagged values and deep nesting
        raise FileError(f"{path}: expected a readable YAML file: {_problem_of(error)}") from error


def _problem_of(error: Exception) -> str:
    """Return PyYAML's problem and its line number in one line."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"line {error.problem_mark.line + 1}: {printable(error.problem, 200)}"
    return printable(" ".join(str(error).split()), 200)


class _PlainLoader(yaml.SafeLoader):
    """Reject duplicate keys, long numbers, and aliases, which expand a few lines to billions."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Reject an alias."""
        if self.check_event(yaml.AliasEvent):
            event = self.get_event()  # type: ignore[no-untyped-call]
            raise yaml.YAMLError(
                f"line {event.start_mark.line + 1}: expected no alias, got *{event.anchor}"
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Reject a duplicate key, whose earlier value PyYAML would drop silently."""
        seen: set[tuple[str, str]] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if (key.tag, key.value) in seen:
                line = key.start_mark.line + 1
                raise yaml.YAMLError(
                    f"line {line}: expected each key once, got {printable(key.value)} again"
                )
            seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Reject a number that takes long to read, or that Python does not print."""
        if len(node.value) > _LONGEST_NUMBER:
            line = node.start_mark.line + 1
            expected = f"a number of at most {_LONGEST_NUMBER} characters"
            raise yaml.YAMLError(f"line {line}: expected {expected}, got {len(node.value)}")
        return int(super().construct_yaml_int(node))


_PlainLoader.add_constructor("tag:yaml.org,2002:int", _PlainLoader.construct_yaml_int)


# PyYAML reads numbers as in YAML 1.1, where 5e-2 is a text: it has no point, or no sign.
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)
