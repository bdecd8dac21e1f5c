"""Where the states of objects come from: topics and the kinds of their messages. Nothing here knows ROS."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from ator_ros.files import is_name
from ator_ros.schema import require

Kind = Literal["Odometry", "PoseStamped", "PoseWithCovarianceStamped"]
"""Messages that tell of an object. Those without a velocity have it estimated from their positions."""
RESERVED = ("robot", "hold", "goal")
"""What conditions speak of beside objects."""
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True, slots=True)
class ObjectSource:
    """An object, and the topic that tells where it is.

    Attributes
    ----------
    name : str
        As conditions name it.
    topic : str
        Relative to the node's namespace, or absolute; empty: the name.
    type : str
        Kind of the messages.
    optional : bool
        Whether diagnostics are silent where it is not known. A TOP whose conditions name it needs it anyway.
    """

    name: str
    topic: str = ""
    type: Kind = "Odometry"
    optional: bool = False

    def __post_init__(self) -> None:
        """Check the names."""
        named = is_name(self.name) and self.name not in RESERVED
        require(named, "name", f"a name of letters, digits and _, none of {', '.join(RESERVED)}", self.name)
        right = not self.topic or bool(_TOPIC.fullmatch(self.topic))
        require(right, "topic", "the name of a topic", self.topic)

    @property
    def listened(self) -> str:
        """The topic's name."""
        return self.topic or self.name
