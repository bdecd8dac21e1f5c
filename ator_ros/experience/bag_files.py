"""Files of recordings, MCAP and SQLite, read in the order of time and in bounded memory.

A file may be hostile or damaged. Sizes are checked before they are allocated; parts that cannot be
read are skipped and counted. Needs the packages mcap-ros2-support and, for files without
definitions of messages, rosbags.
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
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap_ros2.decoder import DecoderFactory

from ator_ros.experience.databases import connected, require_table, signals_raised, text_of
from ator_ros.experience.definitions import LARGEST_DEFINITION, checked_definition
from ator_ros.printable import printable
from ator_ros.resources import share_folder

Topic = tuple[str, str]
"""Name of a topic, and type of its messages as in nav_msgs/msg/Odometry."""
_ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of data compressed with zstd; messages in CDR begin with a zero."""
_LARGEST_MESSAGE = 4 << 20  # bytes, decompressed: a path of 40,000 poses
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
_TOO_LARGE = "messages of more than 4 MiB"
_TOO_LARGE_CHUNK = "chunks of more than 64 MiB"
_OTHER_ENCODING = "topics in another encoding than cdr"


class _Raw(NamedTuple):
    """A message as recorded: time of arrival in ns, topic, data in CDR, and its definition."""

    time: int
    topic: Topic
    data: bytes
    definition: str


class _File:
    """A file of a recording.

    Attributes
    ----------
    topics : set of Topic
        Those with messages in CDR.
    damage : Counter of str
        What was skipped, and how often.
    skipped_end : str
        Why the end was skipped; empty: it was not.
    """

    def __init__(self) -> None:
        self.topics: set[Topic] = set()
        self.damage: Counter[str] = Counter()
        self.skipped_end = ""

    def messages(self, topics: Collection[Topic]) -> Iterator[_Raw]:
        """Yield the messages on some topics, about in the order of time."""
        raise NotImplementedError


# MCAP


_READ = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, times of arrival and of publication
_UNREADABLE = (
    McapError,
    struct.error,
    ValueError,
    RuntimeError,  # of lz4
    zstandard.ZstdError,
)
"""Errors of damaged records."""


class _Mcap(_File):
    """An .mcap file.

    It is read from the beginning, without its summary, so that a file which was cut off is read up
    to there.
    """

    def __init__(self, path: Path, stack: contextlib.ExitStack) -> None:
        super().__init__()
        self._file = stack.enter_context(path.open("rb"))
        self._size = path.stat().st_size
        if self._file.read(8) != b"\x89MCAP0\r\n":
            raise ValueError("expected an MCAP file, got other first bytes")
        self._definitions: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, tuple[Topic, str]] = {}
        self._spare = _MOST_DEFINITIONS
        self._spare_in_chunks = 0  # bytes that chunks may still have in this pass, decompressed
        used = set[int]()
        for opcode, content in self._records(self.damage):
            if opcode == Opcode.MESSAGE:
                used.add(int.from_bytes(content[:2], "little"))
                continue
            with contextlib.suppress(*_UNREADABLE):
                stream = ReadDataStream(io.BytesIO(content))
                if opcode == Opcode.SCHEMA:
                    self._add_schema(Schema.read(stream))
                else:
                    self._add_channel(Channel.read(stream))
        self.topics = {topic for number, (topic, _) in self._channels.items() if number in used}

    def _add_schema(self, schema: Schema) -> None:
        """Keep the type and the text of a definition; the text is empty in another language."""
        if schema.id in self._definitions or not _is_short(schema.name):
            return
        text = schema.data.decode() if schema.encoding == "ros2msg" else ""
        if len(text) > self._spare or len(self._definitions) == _MOST_TOPICS:
            self.damage[f"types of messages after {_MOST_TOPICS:,} or 16 MiB"] += 1
            return
        self._definitions[schema.id] = schema.name, text
        self._spare -= len(text)

    def _add_channel(self, channel: Channel) -> None:
        kind, text = self._definitions.get(channel.schema_id, ("", ""))
        if not _is_short(channel.topic):
            return
        if channel.message_encoding != "cdr":
            self.damage[_OTHER_ENCODING] += 1
        elif kind:
            self._channels[channel.id] = (channel.topic, kind), text

    def messages(self, topics: Collection[Topic]) -> Iterator[_Raw]:
        """Yield the messages on some topics, about in the order of time."""
        wanted = {
            number: channel for number, channel in self._channels.items() if channel[0] in topics
        }
        for opcode, content in self._records(Counter()):
            if opcode != Opcode.MESSAGE:
                continue
            number, _, time, _ = _MESSAGE_HEAD.unpack_from(content)
            if number in wanted:
                topic, definition = wanted[number]
                yield _Raw(time, topic, bytes(content[_MESSAGE_HEAD.size :]), definition)

    def _records(self, damage: Counter[str]) -> Iterator[tuple[int, memoryview]]:
        """Yield opcode and content of schemas, channels and messages, also of those in chunks."""
        begin = 8
        self._spare_in_chunks = max(_ANY_RATIO, _MOST_RATIO * self._size)
        while begin + _RECORD_HEAD.size <= self._size:
            self._file.seek(begin)
            opcode, length = _RECORD_HEAD.unpack(self._file.read(_RECORD_HEAD.size))
            end = begin + _RECORD_HEAD.size + length
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if opcode == 0 or end > self._size:
                break
            begin = end
            if opcode == Opcode.CHUNK:
                yield from _inner_records(self._chunk(length, damage), damage)
            elif opcode in _READ and _fits(opcode, length, damage):
                yield opcode, memoryview(self._file.read(length))
        self.skipped_end = f"after {begin:,} bytes: it was cut off or is damaged"

    def _chunk(self, length: int, damage: Counter[str]) -> bytes:
        """Return the records of a chunk, decompressed; none if it is skipped."""
        if length > _LARGEST_CHUNK + _BLOCK:
            damage[_TOO_LARGE_CHUNK] += 1
            return b""
        try:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(self._file.read(length))))
            size = chunk.uncompressed_size
            if size > _LARGEST_CHUNK:
                damage[_TOO_LARGE_CHUNK] += 1
                return b""
            self._spare_in_chunks -= size
            if self._spare_in_chunks < 0:
                damage[f"chunks beyond {_MOST_RATIO} times the size of the file"] += 1
                return b""
            records = _unpacked(chunk.compression, chunk.data, size + 1)
            if len(records) != size:
                raise ValueError("another size")
        except _UNREADABLE:
            damage["damaged chunks"] += 1
            return b""
        if chunk.uncompressed_crc not in (0, zlib.crc32(records)):
            damage["chunks with a wrong CRC"] += 1
            return b""
        return records


def _fits(opcode: int, length: int, damage: Counter[str]) -> bool:
    """Return whether a record has a plausible length, and count it if it has none."""
    least = _MESSAGE_HEAD.size if opcode == Opcode.MESSAGE else 4
    if length > _LARGEST_MESSAGE:
        damage[_TOO_LARGE] += 1
    elif length < least:
        damage["damaged messages"] += 1
    return least <= length <= _LARGEST_MESSAGE


def _inner_records(content: bytes, damage: Counter[str]) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and content of the records in a chunk."""
    records = memoryview(content)
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


def _is_short(name: object) -> bool:
    return isinstance(name, str) and len(name) <= _LONGEST_NAME


# Compression


def _unpacked(compression: str, data: bytes, most: int) -> bytes:
    """Return the first bytes of compressed data, at most `most`.

    Damaged data raises one of `_UNREADABLE`.
    """
    if compression == "zstd":
        decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_CHUNK)
        return decompressor.stream_reader(data).read(most)
    if compression == "lz4":
        found: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)
        return found
    if compression:
        raise ValueError("expected zstd or lz4")
    return data


def _unpacked_message(data: bytes) -> bytes:
    """Return a message without the compression of each message by ``ros2 bag record``.

    Raises ValueError if it is larger than `_LARGEST_MESSAGE`, or of an implausible ratio.
    """
    if data[:4] != _ZSTD:
        return data
    most = min(_LARGEST_MESSAGE, max(_ANY_RATIO_MESSAGE, _MOST_RATIO * len(data)))
    unpacked = _unpacked("zstd", data, most + 1)
    if len(unpacked) > most:
        raise ValueError(f"expected at most 4 MiB, and {_MOST_RATIO} times its size, decompressed")
    return unpacked


def _unpacked_file(path: Path, stack: contextlib.ExitStack) -> Path:
    """Return a temporary file with the content of a file that was compressed as a whole."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ator_ros_")))
    unpacked = folder / path.stem
    # Frames without content count as size, so the ratio alone does not protect the disk.
    room = min(_LARGEST_FILE, shutil.disk_usage(folder).free // 2)
    plausible = max(_ANY_RATIO, _MOST_RATIO * path.stat().st_size)
    what = f"{_MOST_RATIO} times its size: decompress it with zstd -d if it is a recording"
    if room < plausible:
        what = f"{room >> 20:,} MiB: half of the free space in {folder.parent}, and 16 GiB"
    with path.open("rb") as packed, unpacked.open("wb") as file:
        decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_CHUNK)
        reader = decompressor.stream_reader(packed, read_across_frames=True)
        while block := reader.read(_BLOCK):
            if file.tell() + len(block) > min(plausible, room):
                raise ValueError(f"{printable(path.name)}: expected at most {what}")
            file.write(block)
    return unpacked


# SQLite


class _Sqlite(_File):
    """A .db3 file. Only its tables are read."""

    def __init__(self, path: Path, stack: contextlib.ExitStack) -> None:
        super().__init__()
        # Without a log of changes beside it, the file is complete, also on read-only media.
        whole = not path.with_name(f"{path.name}-wal").exists()
        options = "mode=ro&immutable=1" if whole else "mode=ro"
        database = connected(path, options, longest=_LARGEST_CHUNK)
        self._data = stack.enter_context(contextlib.closing(database))
        self._data.text_factory = text_of
        with signals_raised():
            self._require_table("topics", "id", "name", "type", "serialization_format")
            self._require_table("messages", "id", "topic_id", "timestamp", "data")
            texts = self._texts()
            rows = self._rows("SELECT id, name, type, serialization_format FROM topics NOT INDEXED")
        self._topics: dict[int, Topic] = {}
        for number, name, kind, encoding in rows:
            if encoding != "cdr":
                self.damage[_OTHER_ENCODING] += 1
            elif _is_short(name) and _is_short(kind):
                self._topics[number] = name, kind
        self.topics = set(self._topics.values())
        self._definitions = {topic: texts.get(topic[1], "") for topic in self.topics}

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
        try:
            with signals_raised():
                for row, number, time, length, data in self._data.execute(
                    query, (_LARGEST_MESSAGE, *numbers)
                ):
                    if last is not None and row <= last:
                        raise sqlite3.DatabaseError("rows are not in order")
                    last = row
                    if number not in numbers:
                        continue
                    if data is not None and isinstance(time, int):
                        topic = self._topics[number]
                        yield _Raw(time, topic, data, self._definitions[topic])
                        continue
                    is_large = isinstance(length, int) and length > _LARGEST_MESSAGE
                    self.damage[_TOO_LARGE if is_large else "damaged messages"] += 1
        except sqlite3.DatabaseError as error:
            self.skipped_end = f"after row {last or 0:,}: {printable(error)}"

    def _require_table(self, table: str, *names: str) -> None:
        """Raise ValueError unless a table has these columns, and stores them."""
        try:
            require_table(self._data, table, *names)
        except ValueError as error:
            raise ValueError(f"{error}: no recording of ros2 bag record") from error

    def _texts(self) -> dict[str, str]:
        """Return the definitions of messages by type; there are none before ROS 2 Iron."""
        table = "message_definitions"
        if not self._rows("SELECT 1 FROM sqlite_master WHERE name = ?", table):
            return {}
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

_OPENED: dict[str, type[_Mcap | _Sqlite]] = {".mcap": _Mcap, ".db3": _Sqlite}


class Bag:
    """The files of recordings of one robot, made at the same time or after each other.

    Use it as a context manager.

    Parameters
    ----------
    paths : sequence of Path
        Files .mcap or .db3, which may be compressed with zstd as a whole.

    Attributes
    ----------
    topics : list of Topic
        The topics with messages.

    Raises
    ------
    ValueError, OSError, sqlite3.Error, zstandard.ZstdError
        A file is no recording.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._stack = contextlib.ExitStack()
        self._damaged = 0
        self._first_damage = ""
        self._repeated = 0
        self._files: list[_File] = []
        with self._stack:
            for path in paths:
                file = path
                if path.suffix not in _OPENED:
                    file = _unpacked_file(path, self._stack)
                self._files.append(_OPENED[file.suffix](file, self._stack))
            self._stack = self._stack.pop_all()
        self.topics = sorted(set().union(*(file.topics for file in self._files)))

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def messages(self, topics: Collection[Topic]) -> Iterator[tuple[Topic, Any]]:
        """Yield the decoded messages on some topics in the order of arrival.

        A message that was recorded twice at one time is yielded once.
        """
        streams = [file.messages(topics) for file in self._files]
        decoders: dict[tuple[str, str], Callable[[bytes], Any]] = {}
        time = -1
        at_once = set[tuple[Topic, bytes]]()
        for raw in _in_order(heapq.merge(*streams, key=attrgetter("time"))):
            if raw.time != time or len(at_once) > _MOST_AT_ONCE:
                time = raw.time
                at_once.clear()
            if (raw.topic, raw.data) in at_once:
                self._repeated += 1
                continue
            at_once.add((raw.topic, raw.data))
            try:
                data = _unpacked_message(raw.data)
                key = raw.topic[1], raw.definition
                if key not in decoders:
                    decoders[key] = _decoder_or_error(*key)
                message = decoders[key](data)
            except ImportError:
                raise
            except Exception as error:  # damaged data raises anything
                self._damaged += 1
                if not self._first_damage:
                    why = printable(str(error) or repr(error), 100)
                    if not raw.definition:
                        why = _without_definition(raw.topic[1])
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


def _in_order(messages: Iterable[_Raw]) -> Iterator[_Raw]:
    """Yield messages that are about in the order of time in that order."""
    waiting: list[tuple[int, int, _Raw]] = []
    size = 0
    for number, raw in enumerate(messages):
        heapq.heappush(waiting, (raw.time, number, raw))
        size += len(raw.data) + _OVERHEAD
        while size > _REORDERED:
            *_, first = heapq.heappop(waiting)
            size -= len(first.data) + _OVERHEAD
            yield first
    while waiting:
        *_, first = heapq.heappop(waiting)
        yield first


def _decoder_or_error(kind: str, definition: str) -> Callable[[bytes], Any]:
    """Return the decoder of a type; it raises ValueError without a usable definition."""
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
    name, text = checked_definition(kind, definition or _known_definition(kind))
    with contextlib.redirect_stderr(io.StringIO()):  # the parser prints what it refuses
        decode = DecoderFactory().decoder_for("cdr", Schema(1, text.encode(), "ros2msg", name))
    assert decode is not None  # it is None for other encodings only
    return decode


def _without_definition(kind: str) -> str:
    """Return why messages cannot be read whose type the recording does not define."""
    source = "this release of ator_ros" if kind.startswith("ator_interfaces/") else "ROS 2 Humble"
    return (
        f"the recording has no definition of {printable(kind)}, and they are not those of "
        f"{source}; record with the definitions"
    )


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
