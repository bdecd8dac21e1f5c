"""Reads messages of recordings with rosbags; also those of actions, which recordings do not define."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from ator_ros.experience.action_definitions import types_of
from ator_ros.experience.errors import ExperienceError
from ator_ros.files import limited_memory
from ator_ros.printable import printable
from ator_ros.resources import ResourceError

_LARGEST_MESSAGE = 100_000  # bytes; ours have some hundred
_MOST_BYTES = 4_000_000_000  # of memory


class RecordingError(ExperienceError):
    """A recording that holds no experience; the message names it and says what was expected."""


def messages(
    file: Path, wanted: Callable[[str], bool], actions: Collection[str]
) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all topics that are wanted, in the order of their arrival.

    Parameters
    ----------
    file : Path
        An .mcap file, or the folder that ``ros2 bag record`` made.
    wanted : callable
        Returns whether a topic is read.
    actions : collection of str
        Types of actions, as nav2_msgs/action/NavigateToPose, that service events may be of.

    Raises
    ------
    RecordingError
        rosbags is not installed, or the recording is damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RecordingError("recordings need the package rosbags: pip install rosbags") from error
    try:
        _refuse_pipes(file)
        usual = get_typestore(Stores.ROS2_JAZZY)
        with (
            _only_messages_defined(),
            limited_memory(_MOST_BYTES),
            AnyReader([file], default_typestore=usual) as reader,
        ):
            chosen = [link for link in reader.connections if wanted(link.topic)]
            _define(reader.typestore, {link.msgtype for link in chosen}, actions)
            readable = [link for link in chosen if link.msgtype in reader.typestore.fielddefs]
            for link, _, raw in reader.messages(connections=readable) if readable else ():
                if len(raw) > _LARGEST_MESSAGE:
                    raise ValueError(f"a message of {len(raw)} bytes on {link.topic}")
                yield link.topic, reader.deserialize(raw, link.msgtype)
    except Exception as error:  # a damaged file makes rosbags raise anything, MemoryError included
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
