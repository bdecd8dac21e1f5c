"""Reads messages of recordings with rosbags; also those of actions, which recordings do not define."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Self

from ator_ros.experience.action_definitions import types_of
from ator_ros.experience.errors import ExperienceError
from ator_ros.files import limited_memory
from ator_ros.printable import printable
from ator_ros.resources import ResourceError

_LARGEST_MESSAGE = 100_000  # bytes; odometry and records have about a thousand
_MOST_BYTES = 4_000_000_000  # of memory


class RecordingError(ExperienceError):
    """A recording that holds no experience; the message names it and says what was expected."""


class Recording:
    """A recording that is open for reading, as a context manager.

    Parameters
    ----------
    file : Path
        An .mcap file, or the folder that ``ros2 bag record`` made.
    actions : collection of str
        Types of actions, as nav2_msgs/action/NavigateToPose, that service events may be of.

    Attributes
    ----------
    topics : list of (str, str)
        Name and type of each topic, in the order of their names; a topic may have several types.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged.
    """

    def __init__(self, file: Path, actions: Collection[str] = ()) -> None:
        self._file, self._actions = file, actions
        self._stack = contextlib.ExitStack()
        self.topics: list[tuple[str, str]] = []

    def __enter__(self) -> Self:
        """Open the file."""
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise RecordingError("recordings need the package rosbags: pip install rosbags") from error
        with _reading(self._file), contextlib.ExitStack() as stack:
            _refuse_pipes(self._file)
            usual = get_typestore(Stores.ROS2_JAZZY)
            with _only_messages_defined():
                self._reader = stack.enter_context(AnyReader([self._file], default_typestore=usual))
            self.topics = sorted({(link.topic, link.msgtype) for link in self._reader.connections})
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._stack.close()

    def messages(self, topics: Collection[tuple[str, str]]) -> Iterator[tuple[str, str, Any]]:
        """Yield topic, type and message of some of `topics` in the order of arrival.

        Types that neither the recording nor this installation defines are left out.
        """
        store = self._reader.typestore
        with _reading(self._file), limited_memory(_MOST_BYTES):
            _define(store, {kind for _, kind in topics}, self._actions)
            links = [link for link in self._reader.connections if (link.topic, link.msgtype) in topics]
            readable = [link for link in links if link.msgtype in store.fielddefs]
            for link, _, raw in self._reader.messages(connections=readable) if readable else ():
                if len(raw) > _LARGEST_MESSAGE:
                    raise ValueError(f"a message of {len(raw)} bytes on {link.topic}")
                yield link.topic, link.msgtype, self._reader.deserialize(raw, link.msgtype)


@contextlib.contextmanager
def _reading(file: Path) -> Iterator[None]:
    """Raise RecordingError for whatever rosbags raises about a damaged file, MemoryError included."""
    try:
        yield
    except Exception as error:
        why = "it needs too much memory" if isinstance(error, MemoryError) else printable(error, 200)
        raise RecordingError(f"{file}: expected a recording of ros2 bag record -s mcap: {why}") from error


def _refuse_pipes(file: Path) -> None:
    """Raise ValueError where a recording has a pipe or a device: opening one may wait for ever."""
    for part in (file, *(file.iterdir() if file.is_dir() else ())):
        if part.exists() and not (part.is_file() or part.is_dir()):
            raise ValueError(f"{part.name} is a pipe or a device")


@contextlib.contextmanager
def _only_messages_defined() -> Iterator[None]:
    """Let rosbags pass over what a recording says of types that are no messages.

    Recorders leave the definitions of services and actions empty, in an encoding that rosbags does not know,
    or put a whole .srv or .action file there. Either would make the whole recording unreadable.
    """
    from rosbags.rosbag2 import storage_mcap

    original: Any = getattr(storage_mcap, "get_msgdef", None)
    if original is None:
        yield
        return

    def tolerant(schema: Any) -> Any:
        no_message = schema is not None and ("/action/" in schema.name or "/srv/" in schema.name)
        return original(None if no_message else schema)

    storage_mcap.get_msgdef = tolerant
    try:
        yield
    finally:
        storage_mcap.get_msgdef = original


def _define(store: Any, kinds: set[str], actions: Collection[str]) -> None:
    """Add the service events of actions to a store of types, where `kinds` has them."""
    for action in actions:
        if kinds & {f"{action}_SendGoal_Event", f"{action}_GetResult_Event"}:
            with contextlib.suppress(ResourceError):  # not installed: its topics are passed over
                found = types_of(action)
                store.register({name: what for name, what in found.items() if name not in store.fielddefs})
