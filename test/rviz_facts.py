"""What RViz's sources say of the classes and properties that a configuration may name.

Read off ros2/rviz, branch jazzy (14.1.5): plugins_description.xml, panel_factory.cpp, the constructors of the
displays, tools and view controllers, qos_profile_property.cpp, display.cpp and visualization_frame.cpp.
RViz ignores names that it does not know, so a slip would show only as something that is not seen.
"""

from __future__ import annotations

import re
from typing import Any

COLOUR = re.compile(r"\d{1,3}; \d{1,3}; \d{1,3}")
VECTOR = {"X": float, "Y": float, "Z": float}
QOS = {
    "Depth": int,
    "History Policy": {"System Default", "Keep Last", "Keep All"},
    "Reliability Policy": {"System Default", "Reliable", "Best Effort"},
    "Durability Policy": {"System Default", "Transient Local", "Volatile"},
}
TOPIC = {"Value": str, **QOS}
"""A topic's property has its quality of service as children, so that its value is called Value."""
DISPLAY = {"Class": str, "Name": str, "Enabled": bool, "Value": bool}
FILTERED = {"Topic": TOPIC, "Filter size": int}
"""Of the displays that wait for tf."""
DISPLAYS: dict[str, dict[str, Any]] = {
    "rviz_default_plugins/Grid": {
        "Reference Frame": str,
        "Plane Cell Count": int,
        "Normal Cell Count": int,
        "Cell Size": float,
        "Line Style": {"Value": {"Lines", "Billboards"}, "Line Width": float},
        "Color": COLOUR,
        "Alpha": float,
        "Plane": {"XY", "XZ", "YZ"},
        "Offset": VECTOR,
    },
    "rviz_default_plugins/MarkerArray": {"Topic": TOPIC, "Namespaces": dict},
    "rviz_default_plugins/RobotModel": {
        "Visual Enabled": bool,
        "Collision Enabled": bool,
        "Mass Properties": {"Mass": bool, "Inertia": bool},
        "Update Interval": float,
        "Alpha": float,
        "Description Source": {"Topic", "File"},
        "Description File": str,
        "Description Topic": TOPIC,
        "TF Prefix": str,
    },
    "rviz_default_plugins/TF": {
        "Show Names": bool,
        "Show Axes": bool,
        "Show Arrows": bool,
        "Marker Scale": float,
        "Update Interval": float,
        "Frame Timeout": float,
        "Filter (whitelist)": str,
        "Filter (blacklist)": str,
        "Frames": {"All Enabled": bool},
        "Tree": dict,
    },
    "rviz_default_plugins/Odometry": {
        **FILTERED,
        "Position Tolerance": float,
        "Angle Tolerance": float,
        "Keep": int,
        "Shape": {
            "Value": {"Arrow", "Axes"},
            "Color": COLOUR,
            "Alpha": float,
            "Shaft Length": float,
            "Shaft Radius": float,
            "Head Length": float,
            "Head Radius": float,
            "Axes Length": float,
            "Axes Radius": float,
        },
        "Covariance": {"Value": bool},
    },
    "rviz_default_plugins/Path": {
        **FILTERED,
        "Line Style": {"Lines", "Billboards"},
        "Line Width": float,
        "Color": COLOUR,
        "Alpha": float,
        "Buffer Length": int,
        "Offset": VECTOR,
        "Pose Style": {"None", "Axes", "Arrows"},
        "Length": float,
        "Radius": float,
        "Pose Color": COLOUR,
        "Shaft Length": float,
        "Head Length": float,
        "Shaft Diameter": float,
        "Head Diameter": float,
    },
}
MESSAGES = {
    "rviz_default_plugins/MarkerArray": "visualization_msgs/MarkerArray",
    "rviz_default_plugins/RobotModel": "std_msgs/String",
    "rviz_default_plugins/Odometry": "nav_msgs/Odometry",
    "rviz_default_plugins/Path": "nav_msgs/Path",
    "rviz_default_plugins/SetGoal": "geometry_msgs/PoseStamped",
}
"""What a class subscribes to, or publishes."""
TOOLS: dict[str, dict[str, Any]] = {
    "rviz_default_plugins/Interact": {"Hide Inactive Objects": bool},
    "rviz_default_plugins/MoveCamera": {},
    "rviz_default_plugins/Select": {},
    "rviz_default_plugins/FocusCamera": {},
    "rviz_default_plugins/Measure": {"Line color": COLOUR},
    "rviz_default_plugins/SetGoal": {"Topic": TOPIC},
    "rviz_default_plugins/SetInitialPose": {"Topic": TOPIC},
    "rviz_default_plugins/PublishPoint": {"Topic": TOPIC, "Single click": bool},
}
_VIEW = {"Class": str, "Name": str, "Target Frame": str, "Near Clip Distance": float}
VIEWS: dict[str, dict[str, Any]] = {
    "rviz_default_plugins/TopDownOrtho": {
        **_VIEW,
        "Scale": float,
        "Angle": float,
        "X": float,
        "Y": float,
    },
    "rviz_default_plugins/Orbit": {
        **_VIEW,
        "Distance": float,
        "Focal Shape Size": float,
        "Focal Shape Fixed Size": bool,
        "Yaw": float,
        "Pitch": float,
        "Focal Point": VECTOR,
    },
}
PANELS: dict[str, dict[str, Any]] = {
    "rviz_common/Displays": {"Property Tree Widget": dict},
    "rviz_common/Help": {},
    "rviz_common/Selection": {},
    "rviz_common/Time": {"SyncMode": int, "SyncSource": str, "Experimental": bool},
    "rviz_common/Tool Properties": {"Expanded": list, "Splitter Ratio": float},
    "rviz_common/Transformation": {},
    "rviz_common/Views": {"Expanded": list, "Splitter Ratio": float},
}
GLOBAL = {"Fixed Frame": str, "Background Color": COLOUR, "Frame Rate": int}
ROOT = {
    **DISPLAY,
    "Global Options": GLOBAL,
    "Displays": list,
    "Tools": list,
    "Views": dict,
    "Transformation": dict,
}
WINDOW = {"X": int, "Y": int, "Width": int, "Height": int, "QMainWindow State": str}


def faults(where: str, given: Any, known: Any) -> list[str]:
    """Return what RViz would ignore or misread in `given`, a part of a configuration."""
    if isinstance(known, dict):
        if not isinstance(given, dict):  # the value alone is read, too
            return faults(where, given, known["Value"]) if "Value" in known else [f"{where}: {given!r}"]
        return [
            fault
            for name, value in given.items()
            for fault in (
                faults(f"{where}/{name}", value, known[name]) if name in known else [f"{where}: no {name}"]
            )
        ]
    if isinstance(known, set):
        fits = given in known
    elif isinstance(known, re.Pattern):
        fits = isinstance(given, str) and known.fullmatch(given) is not None
    elif known is float:
        fits = isinstance(given, int | float) and not isinstance(given, bool)
    else:
        fits = isinstance(given, known) and (known is bool or not isinstance(given, bool))
    return [] if fits else [f"{where}: {given!r}"]
