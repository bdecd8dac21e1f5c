"""The quality of service of our topics."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

SENSOR_DATA = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For odom and ball, and for listening to commands: only the newest counts, a lost one is not sent again."""

COMMANDS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""For sending commands: reaches every listener, whatever it asks for."""

RESULTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""For results that must all arrive."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""For what a late listener shall still get: the last record, the robot's description."""

SERVICES = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=2000, reliability=ReliabilityPolicy.RELIABLE
)
"""For services and their clients, those of actions too. Requests over the depth are lost without a word, and the
default of 10 is soon reached by clients that come together. Not keep-all: that would wait for a client that has
died. A node takes requests faster than they come, so that only those queue that come while it computes."""
