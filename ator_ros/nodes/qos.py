"""The quality of service of our topics; rclpy's defaults are keep-last, reliable and volatile."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

SENSOR_DATA = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For sensor topics, and for subscribing to commands: only the newest message counts."""

ALL_SENSOR_DATA = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For sensor topics of which every message counts, also those that come while a node is busy."""

NEWEST = QoSProfile(depth=1)
"""For publishing sensor data and commands: fits best-effort and reliable volatile subscriptions."""

RESULTS = QoSProfile(depth=100)
"""For records, all of which must arrive."""

RESULTS_OF_MANY = QoSProfile(depth=1000)
"""For subscribing to records of many publishers, or while each takes long to store."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For state that late subscribers must receive: the last record, the robot's description."""

LATCHED_BY_MANY = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For subscribing to latched topics of many publishers, and to records, which must all arrive."""

SERVICES = QoSProfile(depth=2000)
"""For services, actions and their clients: requests beyond the depth (10) are lost silently."""

ACTION_QUEUES = {
    f"{service}_service_qos_profile": SERVICES for service in ("goal", "result", "cancel")
}
"""Keyword arguments of action servers and action clients, so that they have these queues."""

LEASE = QoSProfile(
    depth=1,
    liveliness=LivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=Duration(seconds=2.0),
)
"""For topics without messages that show whether a client runs; DDS itself gives the signs."""
