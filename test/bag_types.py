"""The types of recordings, ours included, for tests."""

from __future__ import annotations

from typing import Any

from ator_ros.resources import share_folder


def own_types() -> Any:
    """Return a store of types with our interfaces, read from their files."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for file in sorted(share_folder().glob("ator_interfaces/msg/*.msg")):
        types |= get_types_from_msg(file.read_text(), f"ator_interfaces/msg/{file.stem}")
    store.register(types)
    return store
