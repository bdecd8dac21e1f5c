"""Listens to tf and looks frames up; needs the messages of tf, not tf2_ros."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ator_ros.nodes.parameters import SetupError
from ator_ros.nodes.qos import RESULTS
from ator_ros.world.messages import transform_from
from ator_ros.world.transforms import MOST_FRAMES, Placement, Transforms

try:
    from tf2_msgs.msg import TFMessage as TFMessage
except ImportError:  # ROS without tf
    TFMessage = None

_FIXED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""For /tf_static, on which each of many publishers keeps its last message."""
_WARNING_PERIOD = 2.0
_MOST_NAMED = 8


class Found(NamedTuple):
    """Where a frame is: stamp in s and placement in another frame."""

    time: float
    placement: Placement


@dataclass
class _Followed:
    """A frame that is looked up in another one."""

    frame: str
    child: str
    take: Callable[[Found], None]
    last: float | None = None

    def look(self, transforms: Transforms) -> None:
        """Pass on where the frame is, if there is a newer stamp, or an older one after a reset."""
        found = transforms.latest(self.frame, self.child)
        if found is not None and found[0] != self.last:
            self.last = found[0]
            self.take(Found(*found))


class TfListener:
    """Subscribes to /tf and /tf_static, once a frame is followed.

    The names are absolute, as those of tf2_ros: where tf has a namespace, remap them (``-r /tf:=tf``).

    Parameters
    ----------
    node : Node
        Who listens, and logs what cannot be used.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._transforms = Transforms()
        self._followed: list[_Followed] = []

    @property
    def used(self) -> bool:
        """Whether any frame is followed."""
        return bool(self._followed)

    def lacking(self, frame: str, child: str) -> str:
        """Return the problem if the place of `child` in `frame` is unknown or old."""
        if self._transforms.latest(frame, child) is not None:
            return f"tf: expected newer transforms from {frame} to {child}"
        frames = self._transforms.frames
        known = f"{', '.join(frames[:_MOST_NAMED])}{' …' if len(frames) > _MOST_NAMED else ''}"
        return f"tf: expected transforms from {frame} to {child}, got the frames: {known or 'none'}"

    def follow(self, frame: str, child: str, take: Callable[[Found], None]) -> None:
        """Pass on each update of the pose of `child` in `frame`, in the order of these calls.

        Raises
        ------
        SetupError
            tf2_msgs is not installed.
        """
        if TFMessage is None:
            raise SetupError(f"{child} is to come from tf: expected the package tf2_msgs, got none")
        if not self.used:
            self._node.create_subscription(TFMessage, "/tf_static", partial(self._hear, fixed=True), _FIXED)
            self._node.create_subscription(TFMessage, "/tf", partial(self._hear, fixed=False), RESULTS)
        self._followed.append(_Followed(frame, child, take))

    def _hear(self, message: Any, *, fixed: bool) -> None:
        for transform in itertools.islice(message.transforms, MOST_FRAMES):
            try:
                self._add(transform, fixed=fixed)
            except ValueError as error:
                logger = self._node.get_logger()
                logger.warning(f"ignored: {error}", throttle_duration_sec=_WARNING_PERIOD)
        for followed in self._followed:
            followed.look(self._transforms)

    def _add(self, message: Any, *, fixed: bool) -> None:
        frame, child, time, placement = transform_from(message)
        self._transforms.add(frame, child, time, placement, fixed=fixed)
