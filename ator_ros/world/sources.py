"""Where the states of objects come from: topics and kinds of messages, or tf. Nothing here knows ROS."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from ator_ros.files import is_name
from ator_ros.schema import require

Kind = Literal["Odometry", "PoseStamped", "PoseWithCovarianceStamped", "tf"]
"""Message types of objects, or tf. Where they lack a velocity, it is estimated from the positions."""
RESERVED = ("robot", "hold", "goal")
"""What conditions speak of beside objects."""
_FRAME = re.compile(r"/?[A-Za-z0-9_][\w.-]*(/[\w.-]+)*", re.ASCII)
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True, slots=True)
class ObjectSource:
    """An object, and the topic that tells where it is.

    Attributes
    ----------
    name : str
        As conditions name it.
    topic : str
        Relative to the node's namespace, or absolute; empty: the name. None where `type` is tf.
    type : str
        Kind of the messages; tf: the transforms on /tf and /tf_static.
    optional : bool
        Whether diagnostics are silent where it is not known. A TOP whose conditions name it needs it anyway.
    frame : str
        Where `type` is tf: the object's frame there; empty: the name.
    """

    name: str
    topic: str = ""
    type: Kind = "Odometry"
    optional: bool = False
    frame: str = ""

    def __post_init__(self) -> None:
        """Check the names."""
        named = is_name(self.name) and self.name not in RESERVED
        require(named, "name", f"a name of letters, digits and _, none of {', '.join(RESERVED)}", self.name)
        right = not self.topic or bool(_TOPIC.fullmatch(self.topic))
        require(right, "topic", "the name of a topic", self.topic)
        named = not self.frame or bool(_FRAME.fullmatch(self.frame))
        require(named, "frame", "the name of a frame", self.frame)
        other = "frame" if self.type != "tf" else "topic"
        require(not getattr(self, other), other, f"none with type {self.type}", getattr(self, other))

    @property
    def listened(self) -> str:
        """The name of the topic, or of the frame, of which tf2 ignores a leading slash."""
        return self.topic or self.frame.removeprefix("/") or self.name
