"""Files of recordings, MCAP and SQLite, read in the order of time and in bounded memory.

A file may be hostile or damaged. Sizes are checked before they are allocated; parts that cannot be
read are skipped and counted.
"""

from __future__ import annotations

import contextlib
import heapq
import io
import itertools
import shutil
import sqlite3
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ator_ros.experience.databases import connected, require_table, signals_raised, text_of
from ator_ros.experience.definitions import LARGEST_DEFINITION, checked_definition
from ator_ros.printable import printable
from ator_ros.resources import share_folder

Topic = tuple[str, str]
"""Name of a topic, and type of its messages as in nav_msgs/msg/Odometry."""
_COMPRESSED = (".zstd", ".zst")
"""Suffixes of files that were compressed as a whole."""
_ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of data compressed with zstd; messages in CDR begin with a zero."""
LARGEST_MESSAGE = 4 << 20
"""Bytes of the largest message that is read, decompressed: a path of 40,000 poses."""
_LARGEST_CHUNK = 64 << 20  # bytes; recorders write chunks of 1 MB, or of one image
_MOST_DEFINITIONS = 16 << 20  # bytes of all message definitions of a file
_MOST_TOPICS = 1000  # and types, of a file; Nav2 has about 100
_LONGEST_NAME = 1000  # characters of a topic or type
_MOST_RATIO = 200  # of compressed data; odometry of a robot at rest reaches 50
_ANY_RATIO = 16 << 20  # bytes of a file up to which any ratio is accepted
_ANY_RATIO_MESSAGE = 64 << 10  # the same of a message that is compressed alone
_LARGEST_FILE = 16 << 30  # bytes of a file that was compressed as a whole
_BLOCK = 1 << 20  # bytes that are decompressed at once
_REORDERED = 32 << 20  # bytes of messages among which the order of time is restored
_MOST_AT_ONCE = 1000  # messages of one time that are compared
_OVERHEAD = 200  # bytes of a message in Python, besides its data


class _Raw(NamedTuple):
    """A message as recorded: time of arrival in ns, topic, data in CDR, and its definition's number."""

    time: int
    topic: Topic
    data: bytes
    definition: int


class _Opcode(IntEnum):
    """What a record of an .mcap file contains."""

    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    DATA_END = 15


_READ = (_Opcode.SCHEMA, _Opcode.CHANNEL, _Opcode.MESSAGE)
_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, times of arrival and of publication
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the compression


class _Mcap:
    """An .mcap file.

    It is read from the beginning, without its summary, so that a file which was cut off is read up
    to there.

    Attributes
    ----------
    topics : set of Topic
        Those with messages in CDR.
    damage : Counter of str
        What was skipped, and how often.
    skipped_end : str
        Why the end was skipped; empty: it was not.
    """

    def __init__(self, path: Path, stack: contextlib.ExitStack) -> None:
        self._file = stack.enter_context(path.open("rb"))
        self._size = path.stat().st_size
        if self._file.read(8) != b"\x89MCAP0\r\n":
            raise ValueError("expected an MCAP file, got other first bytes")
        self.damage: Counter[str] = Counter()
        self.skipped_end = ""
        self._definitions: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, tuple[Topic, int]] = {}
        self._spare = 0  # bytes that chunks may still have in this pass, decompressed
        used = set[int]()
        spare = _MOST_DEFINITIONS
        for opcode, content in self._records(self.damage):
            if opcode == _Opcode.MESSAGE:
                used.add(int.from_bytes(content[:2], "little"))
            elif opcode == _Opcode.SCHEMA and (schema := _schema_in(bytes(content))) is not None:
                number, name, text = schema
                if number in self._definitions:
                    continue
                if len(text) > spare or len(self._definitions) == _MOST_TOPICS:
                    self.damage[f"types of messages after {_MOST_TOPICS:,} or 16 MiB"] += 1
                    continue
                self._definitions[number] = name, text
                spare -= len(text)
            elif opcode == _Opcode.CHANNEL and (channel := _channel_in(bytes(content))) is not None:
                number, name, encoding, schema_number = channel
                kind, _ = self._definitions.get(schema_number, ("", ""))
                if encoding == "cdr" and kind:
                    self._channels[number] = (name, kind), schema_number
                elif encoding != "cdr":
                    _count_encoding(encoding, self.damage)
        self.topics = {topic for number, (topic, _) in self._channels.items() if number in used}

    def definition(self, number: int) -> str:
        """Return a definition in the file as text; empty: it is in another language than ros2msg."""
        return self._definitions[number][1]

    def messages(self, topics: Collection[Topic]) -> Iterator[_Raw]:
        """Yield the messages on some topics, about in the order of time."""
        wanted = {
            number: channel for number, channel in self._channels.items() if channel[0] in topics
        }
        for opcode, content in self._records(Counter()):
            if opcode != _Opcode.MESSAGE:
                continue
            number, _, time, _ = _MESSAGE_HEAD.unpack_from(content)
            if number in wanted:
                topic, definition = wanted[number]
                yield _Raw(time, topic, bytes(content[_MESSAGE_HEAD.size :]), definition)

    def _records(self, damage: Counter[str]) -> Iterator[tuple[int, memoryview]]:
        """Yield opcode and content of schemas, channels and messages, also of those in chunks."""
        begin = 8
        self._spare = max(_ANY_RATIO, _MOST_RATIO * self._size)
        while begin + _RECORD_HEAD.size <= self._size:
            self._file.seek(begin)
            opcode, length = _RECORD_HEAD.unpack(self._file.read(_RECORD_HEAD.size))
            end = begin + _RECORD_HEAD.size + length
            if opcode in (_Opcode.DATA_END, _Opcode.FOOTER):
                return
            if opcode == 0 or end > self._size:
                break
            begin = end
            if opcode == _Opcode.CHUNK:
                yield from self._chunk(length, damage)
            elif opcode in _READ and _fits(opcode, length, damage):
                yield opcode, memoryview(self._file.read(length))
        self.skipped_end = f"after {begin:,} bytes: it was cut off or is damaged"

    def _chunk(self, length: int, damage: Counter[str]) -> Iterator[tuple[int, memoryview]]:
        if length > _LARGEST_CHUNK + _BLOCK:
            damage["chunks of more than 64 MiB"] += 1
            return
        content = self._file.read(length)
        try:
            _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(content)
            begin = _CHUNK_HEAD.size + name_length
            compression = content[_CHUNK_HEAD.size : begin].decode()
            (stored,) = struct.unpack_from("<Q", content, begin)
            packed = memoryview(content)[begin + 8 : begin + 8 + stored]
            if size > _LARGEST_CHUNK:
                damage["chunks of more than 64 MiB"] += 1
                return
            self._spare -= size
            if self._spare < 0:
                damage[f"chunks beyond {_MOST_RATIO} times the size of the file"] += 1
                return
            records = _UNPACK[compression](packed, size)
        except (struct.error, ValueError, KeyError, RuntimeError, EOFError, _zstd_error()):
            damage["damaged chunks"] += 1
            return
        if crc not in (0, zlib.crc32(records)):
            damage["chunks with a wrong CRC"] += 1
            return
        yield from _inner_records(memoryview(records), damage)


def _fits(opcode: int, length: int, damage: Counter[str]) -> bool:
    """Return whether a record has a plausible length, and count it if it has none."""
    least = _MESSAGE_HEAD.size if opcode == _Opcode.MESSAGE else 4
    if length > LARGEST_MESSAGE:
        damage["messages of more than 4 MiB"] += 1
    elif length < least:
        damage["damaged messages"] += 1
    return least <= length <= LARGEST_MESSAGE


def _inner_records(records: memoryview, damage: Counter[str]) -> Iterator[tuple[int, memoryview]]:
    place = 0
    while place + _RECORD_HEAD.size <= len(records):
        opcode, length = _RECORD_HEAD.unpack_from(records, place)
        begin = place + _RECORD_HEAD.size
        if opcode == 0 or begin + length > len(records):
            break
        place = begin + length
        if opcode in _READ and _fits(opcode, length, damage):
            yield opcode, records[begin:place]
    if place != len(records):
        damage["damaged chunks"] += 1


def _texts_in(content: bytes, place: int, count: int) -> Iterator[str]:
    """Yield the texts at a place of a record, each after its length."""
    for _ in range(count):
        (length,) = struct.unpack_from("<I", content, place)
        begin, place = place + 4, place + 4 + length
        yield content[begin:place].decode()


def _schema_in(content: bytes) -> tuple[int, str, str] | None:
    """Return number, name and text of a schema; None if it is damaged."""
    try:
        (number,) = struct.unpack_from("<H", content)
        name, encoding, text = _texts_in(content, 2, 3)
    except (struct.error, UnicodeDecodeError):
        return None
    return (number, name, text if encoding == "ros2msg" else "") if _is_short(name) else None


def _channel_in(content: bytes) -> tuple[int, str, str, int] | None:
    """Return number, topic, encoding of the messages and number of the schema; None if it is damaged."""
    try:
        number, schema_number = struct.unpack_from("<HH", content)
        name, encoding = _texts_in(content, 4, 2)
    except (struct.error, UnicodeDecodeError):
        return None
    return (number, name, encoding, schema_number) if _is_short(name) else None


def _count_encoding(encoding: object, damage: Counter[str]) -> None:
    """Count a topic that is not in CDR; all are one kind of damage, which names the first encoding."""
    begin = "topics in another encoding than cdr, such as "
    known = (what for what in damage if what.startswith(begin))
    damage[next(known, f"{begin}{printable(encoding)}")] += 1


def _is_short(name: object) -> bool:
    return isinstance(name, str) and len(name) <= _LONGEST_NAME


# Compression


@cache
def _zstd_error() -> type[Exception]:
    import zstandard

    return zstandard.ZstdError


def _from_zstd(data: bytes | memoryview, size: int) -> bytes:
    """Return the `size` bytes in a frame of zstd; raise ValueError if it has more or fewer."""
    import zstandard

    unpacked = bytearray(size)
    with zstandard.ZstdDecompressor(max_window_size=_LARGEST_CHUNK).stream_reader(data) as stream:
        filled, view = 0, memoryview(unpacked)
        while filled < size and (count := stream.readinto(view[filled:])):
            filled += count
        if filled < size or stream.read(1):
            raise ValueError("another size")
    return unpacked  # type: ignore[return-value]


def _from_lz4(data: bytes | memoryview, size: int) -> bytes:
    """Return the `size` bytes in a frame of lz4; raise ValueError if it has more or fewer."""
    import lz4.frame

    stream = lz4.frame.LZ4FrameDecompressor()
    unpacked: bytes = stream.decompress(data, max_length=size)
    if len(unpacked) != size or not (stream.eof or stream.decompress(b"", max_length=1) == b""):
        raise ValueError("another size")
    return unpacked


def _stored(data: bytes | memoryview, size: int) -> bytes:
    if len(data) != size:
        raise ValueError("another size")
    return bytes(data)


_UNPACK: dict[str, Callable[[bytes | memoryview, int], bytes]] = {
    "": _stored,
    "zstd": _from_zstd,
    "lz4": _from_lz4,
}


def _unpacked_message(data: bytes) -> bytes:
    """Return a message without the compression of each message by ``ros2 bag record``.

    Raises ValueError if it is damaged, larger than `LARGEST_MESSAGE`, or of an implausible ratio.
    """
    if data[:4] != _ZSTD:
        return data
    import zstandard

    most = min(LARGEST_MESSAGE, max(_ANY_RATIO_MESSAGE, _MOST_RATIO * len(data)))
    try:
        reader = zstandard.ZstdDecompressor(max_window_size=_LARGEST_CHUNK).stream_reader(data)
        unpacked: bytes = reader.read(most + 1)
    except zstandard.ZstdError as error:
        raise ValueError(f"expected a message compressed with zstd: {error}") from error
    if len(unpacked) > most:
        raise ValueError(f"expected at most 4 MiB, and {_MOST_RATIO} times its size, decompressed")
    return unpacked


def _unpacked_file(path: Path, stack: contextlib.ExitStack) -> Path:
    """Return a temporary file with the content of a file that was compressed as a whole."""
    import zstandard

    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ator_ros_")))
    unpacked = folder / path.stem
    # Frames without content count as size, so the ratio alone does not protect the disk.
    room = min(_LARGEST_FILE, shutil.disk_usage(folder).free // 2)
    plausible = max(_ANY_RATIO, _MOST_RATIO * path.stat().st_size)
    spare = min(plausible, room)
    try:
        with path.open("rb") as packed, unpacked.open("wb") as file:
            decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_CHUNK)
            reader = decompressor.stream_reader(packed, read_across_frames=True)
            while block := reader.read(_BLOCK):
                spare -= len(block)
                if spare < 0 and room < plausible:
                    raise ValueError(
                        f"{printable(path.name)}: expected at most {room >> 20:,} MiB, decompressed: "
                        f"half of the free space in {folder.parent}, and 16 GiB"
                    )
                if spare < 0:
                    raise ValueError(
                        f"{printable(path.name)}: expected at most {_MOST_RATIO} times its size, "
                        "decompressed: it is not a recording; decompress it with zstd -d if it is"
                    )
                file.write(block)
    except zstandard.ZstdError as error:
        raise ValueError(f"{printable(path.name)}: expected a zstd file: {error}") from error
    return unpacked


# SQLite


class _Sqlite:
    """A .db3 file; attributes as of `_Mcap`. Only its tables are read."""

    def __init__(self, path: Path, stack: contextlib.ExitStack) -> None:
        # Without a log of changes beside it, the file is complete, also on read-only media.
        whole = not path.with_name(f"{path.name}-wal").exists()
        options = "mode=ro&immutable=1" if whole else "mode=ro"
        database = connected(path, options, longest=_LARGEST_CHUNK)
        self._data = stack.enter_context(contextlib.closing(database))
        self._data.text_factory = text_of
        self.damage: Counter[str] = Counter()
        self.skipped_end = ""
        with signals_raised():
            self._require_table("topics", "id", "name", "type", "serialization_format")
            self._require_table("messages", "id", "topic_id", "timestamp", "data")
            texts = self._texts() if self._has("message_definitions") else {}
            rows = self._rows("SELECT id, name, type, serialization_format FROM topics NOT INDEXED")
            found = [row for row in rows if _is_short(row[1]) and _is_short(row[2])]
        self._topics: dict[int, Topic] = {}
        for number, name, kind, encoding in found:
            if encoding == "cdr":
                self._topics[number] = name, kind
            else:
                _count_encoding(encoding, self.damage)
        self.topics = set(self._topics.values())
        self._definitions = {
            number: texts.get(kind, "") for number, (_, kind) in self._topics.items()
        }

    def definition(self, number: int) -> str:
        """Return a definition in the file; empty: it has none, as before ROS 2 Iron."""
        return self._definitions[number]

    def messages(self, topics: Collection[Topic]) -> Iterator[_Raw]:
        """Yield the messages on some topics, about in the order of time."""
        numbers = [number for number, topic in self._topics.items() if topic in topics]
        marks = ", ".join("?" * len(numbers))
        # All rows are returned, so that each step of the query is short.
        query = f"""
            SELECT id, topic_id, timestamp, length(data), CASE WHEN typeof(data) = 'blob'
            AND length(data) <= ? AND topic_id IN ({marks}) THEN data END
            FROM messages NOT INDEXED
        """  # noqa: S608 (question marks only)
        last = None
        wanted = set(numbers)
        try:
            with signals_raised():
                for row, number, time, length, data in self._data.execute(
                    query, (LARGEST_MESSAGE, *numbers)
                ):
                    if last is not None and row <= last:
                        raise sqlite3.DatabaseError("rows are not in order")
                    last = row
                    if number not in wanted:
                        continue
                    if data is not None and isinstance(time, int):
                        yield _Raw(time, self._topics[number], data, number)
                    else:
                        large = isinstance(length, int) and length > LARGEST_MESSAGE
                        self.damage[
                            "messages of more than 4 MiB" if large else "damaged messages"
                        ] += 1
        except sqlite3.DatabaseError as error:
            self.skipped_end = f"after row {last or 0:,}: {printable(error)}"

    def _has(self, name: str) -> bool:
        return bool(self._rows("SELECT 1 FROM sqlite_master WHERE name = ?", name))

    def _require_table(self, table: str, *names: str) -> None:
        """Raise ValueError unless a table has these columns, and stores them."""
        try:
            require_table(self._data, table, *names)
        except ValueError as error:
            raise ValueError(f"{error}: no recording of ros2 bag record") from error

    def _texts(self) -> dict[str, str]:
        """Return the definitions of messages by type."""
        table = "message_definitions"
        self._require_table(table, "topic_type", "encoding", "encoded_message_definition")
        query = (
            "SELECT topic_type, CAST(encoded_message_definition AS TEXT) "
            "FROM message_definitions NOT INDEXED "
            "WHERE encoding = 'ros2msg' AND length(encoded_message_definition) <= ?"
        )
        return dict(self._rows(query, LARGEST_DEFINITION))

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """Return the first rows of a query."""
        return list(itertools.islice(self._data.execute(query, values), _MOST_TOPICS))


# Recordings

File = _Mcap | _Sqlite
_FILES: dict[str, type[File]] = {".mcap": _Mcap, ".db3": _Sqlite}


def is_recording(path: Path) -> bool:
    """Return whether the name of a file is that of a recording."""
    return _kind(path) in _FILES


def _kind(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix in _COMPRESSED else path.suffix


class Bag:
    """The files of recordings of one robot, made at the same time or after each other.

    Use it as a context manager.

    Parameters
    ----------
    paths : sequence of Path
        Files, or folders that ``ros2 bag record`` made.

    Raises
    ------
    ValueError, OSError, sqlite3.Error
        A file is no recording.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._stack = contextlib.ExitStack()
        self._damaged = 0
        self._first_damage = ""
        self._repeated = 0
        with self._stack:
            self._files = [self._opened(file) for path in paths for file in _files_of(path)]
            self._stack = self._stack.pop_all()
        self.topics = sorted(set().union(*(file.topics for file in self._files)))

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _opened(self, path: Path) -> File:
        unpacked = _unpacked_file(path, self._stack) if path.suffix in _COMPRESSED else path
        return _FILES[_kind(path)](unpacked, self._stack)

    def messages(self, topics: Collection[Topic]) -> Iterator[tuple[Topic, Any]]:
        """Yield the decoded messages on some topics in the order of arrival.

        A message that several files have is yielded once.
        """
        streams = [_labeled(file, topics) for file in self._files]
        decoders: dict[tuple[File, int], Callable[[bytes], Any]] = {}
        time, at_once = -1, dict[tuple[Topic, bytes], File]()
        for raw, file in _in_order(heapq.merge(*streams, key=lambda each: each[0].time)):
            if raw.time != time or len(at_once) > _MOST_AT_ONCE:
                time = raw.time
                at_once.clear()
            if at_once.setdefault((raw.topic, raw.data), file) is not file:
                self._repeated += 1
                continue
            try:
                data = _unpacked_message(raw.data)
                key = file, raw.definition
                if key not in decoders:
                    text = file.definition(raw.definition)
                    decoders[key] = _decoder_or_error(raw.topic[1], text)
                message = decoders[key](data)
            except ImportError:
                raise
            except Exception as error:  # damaged data raises anything
                self._damaged += 1
                if not self._first_damage:
                    why = printable(str(error) or repr(error), 100)
                    self._first_damage = f"messages on {printable(raw.topic[0])}: {why}"
                continue
            yield raw.topic, message

    def remarks(self) -> list[str]:
        """Return a line for each kind of data that was skipped."""
        counts: Counter[str] = Counter()
        for file in self._files:
            counts.update(file.damage)
        if self._damaged:
            counts[self._first_damage] = self._damaged
        lines = [f"skipped {count} {what}" for what, count in counts.most_common(8)]
        ends = [file.skipped_end for file in self._files if file.skipped_end]
        lines += [f"skipped the end, {end}" for end in ends[:8]]
        if self._repeated:
            lines.append(f"skipped {self._repeated} messages that were recorded twice")
        return lines


def _files_of(path: Path) -> list[Path]:
    """Return the files of a recording."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    files = [file for file in files if is_recording(file)]
    if not files or not all(file.is_file() for file in files):  # opening a pipe may block
        raise ValueError("expected .mcap or .db3 files, found none")
    return files


def _labeled(file: File, topics: Collection[Topic]) -> Iterator[tuple[_Raw, File]]:
    """Yield the messages of a file with it."""
    for raw in file.messages(topics):
        yield raw, file


def _in_order(
    messages: Iterable[tuple[_Raw, File]],
) -> Iterator[tuple[_Raw, File]]:
    """Yield messages that are about in the order of time in that order."""
    waiting: list[tuple[int, int, _Raw, File]] = []
    size = 0
    for number, (raw, file) in enumerate(messages):
        heapq.heappush(waiting, (raw.time, number, raw, file))
        size += len(raw.data) + _OVERHEAD
        while size > _REORDERED:
            *_, first, source = heapq.heappop(waiting)
            size -= len(first.data) + _OVERHEAD
            yield first, source
    while waiting:
        *_, first, source = heapq.heappop(waiting)
        yield first, source


def _decoder_or_error(kind: str, definition: str) -> Callable[[bytes], Any]:
    """Return the decoder of a type; without a usable definition, it raises the reason as ValueError."""
    try:
        return _decoder(kind, definition)
    except ImportError:
        raise
    except Exception as error:  # of the parser, on a damaged definition
        why = str(error) or repr(error)

    def fail(_: bytes) -> Any:
        raise ValueError(why)

    return fail


def _decoder(kind: str, definition: str) -> Callable[[bytes], Any]:
    """Return the decoder of a type, whose definition may be empty."""
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    name, text = checked_definition(kind, definition or _known_definition(kind))
    with contextlib.redirect_stderr(io.StringIO()):  # the parser prints what it refuses
        decode = DecoderFactory().decoder_for("cdr", Schema(1, text.encode(), "ros2msg", name))
    assert decode is not None  # it is None for other encodings only
    return decode


def _known_definition(kind: str) -> str:
    """Return the definition of a type of ROS 2 Humble, or of ours, for files that have none."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for file in share_folder().glob("ator_interfaces/msg/*.msg"):
        store.register(get_types_from_msg(file.read_text(), f"ator_interfaces/msg/{file.stem}"))
    if kind not in store.fielddefs:
        raise ValueError(f"expected the definition of {printable(kind)}, the recording has none")
    text, _ = store.generate_msgdef(kind, ros_version=2)
    return text
