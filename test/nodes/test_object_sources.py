"""Objects from each kind of source."""

from typing import Any

import pytest

from ator_ros.nodes.messages import object_odometry_of, stamp_of
from ator_ros.nodes.subscriptions import TYPES
from ator_ros.world.readers import MessageError, ObjectReader, ObjectSource
from ator_ros.world.state import ObjectState
from ator_ros.world.transforms import Placement


def message_of(kind: str, time: float, x: float, y: float, frame: str = "map") -> Any:
    if kind == "Odometry":
        return object_odometry_of(time, ObjectState(x, y, 0.5, -0.2), frame=frame, height=0.0)
    message = TYPES[kind]()
    message.header.stamp, message.header.frame_id = stamp_of(time), frame
    pose = message.pose.pose if kind == "PoseWithCovarianceStamped" else message.pose
    pose.position.x, pose.position.y = x, y
    return message


def placement(x: float, y: float) -> Placement:
    return Placement((x, y, 0.3), (0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize("kind", [*sorted(TYPES), "tf"])
def test_position_and_velocity_are_read_or_estimated(kind: str) -> None:
    reader = ObjectReader(
        ObjectSource("cart", type=kind, frame="cart_link" if kind == "tf" else ""), "map"
    )
    for tick in range(20):
        time, x, y = 5.0 + 0.02 * tick, 1.0 + 0.01 * tick, 2.0 - 0.004 * tick
        if kind == "tf":
            stamp, there = reader.read_placement(time, placement(x, y))
        else:
            stamp, there = reader.read(message_of(kind, time, x, y))
    assert stamp == pytest.approx(time)
    assert (there.x, there.y, there.vx, there.vy) == pytest.approx((1.19, 1.924, 0.5, -0.2))
    if kind == "tf":
        with pytest.raises(MessageError, match=r"^cart in tf.x: expected a finite number"):
            reader.read_placement(6.0, placement(1e9, 0.0))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"type": "tf", "topic": "cart"}, "topic: expected none with type tf; got 'cart'"),
        ({"frame": "cart_link"}, "frame: expected none with type Odometry; got 'cart_link'"),
        ({"type": "tf", "frame": "/cart link"}, "frame: expected the name of a frame"),
    ],
)
def test_a_source_is_a_topic_or_a_frame(given: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        ObjectSource("cart", **given)
    assert ObjectSource("cart", type="tf").topic_or_frame == "cart"
    assert ObjectSource("cart", type="tf", frame="/cart_link").topic_or_frame == "cart_link"
