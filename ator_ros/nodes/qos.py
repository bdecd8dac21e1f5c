"""The quality of service of our topics."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

SENSOR_DATA = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For sensor topics, and for subscribing to commands: only the newest message counts."""

STATES = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""For publishing sensor data: fits best-effort and reliable subscriptions of volatile durability."""

COMMANDS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""For publishing commands: fits best-effort and reliable subscriptions of volatile durability."""

RESULTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""For records, all of which must arrive."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""For state that late subscribers must receive: the last record, the robot's description."""

SERVICES = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=2000, reliability=ReliabilityPolicy.RELIABLE)
"""For services and actions, and their clients.

Requests beyond the depth are lost silently, and rclpy's depth of 10 is soon reached. Keep-all would not help:
it waits for clients that have died, and a client keeps no more of its requests than its own depth.
"""
