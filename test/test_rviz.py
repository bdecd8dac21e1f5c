"""The configurations of RViz and Foxglove match topics and types of the nodes."""

import json
from collections.abc import Iterator
from typing import Any

import yaml

from ator_ros.resources import share_folder

RVIZ = yaml.safe_load((share_folder() / "rviz" / "ator.rviz").read_text(encoding="utf-8"))
ROOTED = RVIZ["Visualization Manager"]
MESSAGES = {
    "rviz_default_plugins/MarkerArray": "visualization_msgs/MarkerArray",
    "rviz_default_plugins/RobotModel": "std_msgs/String",
    "rviz_default_plugins/Odometry": "nav_msgs/Odometry",
    "rviz_default_plugins/Path": "nav_msgs/Path",
    "rviz_default_plugins/SetGoal": "geometry_msgs/PoseStamped",
}
"""Types that RViz's classes subscribe to or publish."""
FOXGLOVE = json.loads((share_folder() / "rviz" / "ator.foxglove.json").read_text(encoding="utf-8"))


TOPICS = {
    "odom": ("nav_msgs/Odometry", False),
    "robot_description": ("std_msgs/String", True),
    "goal_pose": ("geometry_msgs/PoseStamped", False),
    "planned_path": ("nav_msgs/Path", True),
    **{
        f"{name}_markers": ("visualization_msgs/MarkerArray", True)
        for name in ("scene", "object", "chain", "refinement")
    },
}
"""The types of the topics that nodes draw on or subscribe to, and whether they are latched."""


def with_topics() -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield each display or tool with a topic, and the topic's property."""
    for part in (*ROOTED["Displays"], *ROOTED["Tools"]):
        for name in ("Topic", "Description Topic"):
            if name in part:
                yield part, part[name]


def test_rviz_topics_have_the_types_and_durability_of_ours() -> None:
    for part, topic in with_topics():
        kind, latched = TOPICS[topic["Value"]]
        assert kind == MESSAGES[part["Class"]], topic
        assert topic["Durability Policy"] == ("Transient Local" if latched else "Volatile"), topic


def test_all_drawn_topics_are_displayed() -> None:
    assert {topic["Value"] for _, topic in with_topics()} == set(TOPICS)


def test_foxglove_shows_the_same_topics() -> None:
    panel = FOXGLOVE["configById"][FOXGLOVE["layout"]["first"]]
    (robot,) = [layer for layer in panel["layers"].values() if layer["layerId"] == "foxglove.Urdf"]
    shown = {name for name, settings in panel["topics"].items() if settings["visible"]}
    goal = panel["publish"]["poseTopic"]
    drawn = {f"/{topic['Value']}" for _, topic in with_topics()} - {"/odom"}  # without Odometry
    assert {*shown, robot["topic"], goal} == drawn
    assert panel["publish"]["type"] == "pose"
    assert panel["followTf"] == ROOTED["Global Options"]["Fixed Frame"]
