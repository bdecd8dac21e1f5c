"""The types of nav2_msgs that the nodes need, with the fields of Jazzy, where ROS has none."""

import ctypes
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documentation import ROOT

FILES = {
    "msg/MissedWaypoint.msg": "uint32 index\ngeometry_msgs/PoseStamped goal\nuint16 error_code\n",
    "action/FollowWaypoints.action": """
uint32 number_of_loops
uint32 goal_index 0
geometry_msgs/PoseStamped[] poses
---
uint16 NONE=0
uint16 UNKNOWN=600
uint16 TASK_EXECUTOR_FAILED=601
MissedWaypoint[] missed_waypoints
uint16 error_code
string error_msg
---
uint32 current_waypoint
""",
    "action/NavigateToPose.action": """
geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 NONE=0
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
""",
    "action/NavigateThroughPoses.action": """
geometry_msgs/PoseStamped[] poses
string behavior_tree
---
uint16 NONE=0
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
int16 number_of_poses_remaining
""",
    "action/ComputePathToPose.action": """
geometry_msgs/PoseStamped goal
geometry_msgs/PoseStamped start
string planner_id
bool use_start
---
uint16 NONE=0
uint16 UNKNOWN=200
uint16 INVALID_PLANNER=201
uint16 TF_ERROR=202
uint16 START_OUTSIDE_MAP=203
uint16 GOAL_OUTSIDE_MAP=204
uint16 START_OCCUPIED=205
uint16 GOAL_OCCUPIED=206
uint16 TIMEOUT=207
uint16 NO_VALID_PATH=208
nav_msgs/Path path
builtin_interfaces/Duration planning_time
uint16 error_code
string error_msg
---
""",
    "CMakeLists.txt": """
cmake_minimum_required(VERSION 3.20)
project(nav2_msgs)
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(nav_msgs REQUIRED)
rosidl_generate_interfaces(nav2_msgs msg/MissedWaypoint.msg action/FollowWaypoints.action
  action/NavigateThroughPoses.action action/ComputePathToPose.action action/NavigateToPose.action
  DEPENDENCIES builtin_interfaces geometry_msgs nav_msgs)
ament_package()
""",
}


def provide_nav2_msgs(patch: pytest.MonkeyPatch) -> None:
    """Make nav2_msgs importable here and in processes; build it in build/ where ROS has none."""
    digest = hashlib.sha256(repr((FILES, sys.version)).encode()).hexdigest()[:12]
    prefix = ROOT / "build" / "for_tests" / f"nav2_msgs-{digest}"
    found = importlib.util.find_spec("nav2_msgs")  # an earlier test may have imported ours
    if found is not None and not str(found.origin).startswith(str(prefix)):
        return
    if not prefix.is_dir():
        _build(prefix)
    (packages,) = prefix.glob("lib/python3*/site-packages")
    for name, folder in (("LD_LIBRARY_PATH", prefix / "lib"), ("PYTHONPATH", packages)):
        patch.setenv(name, f"{folder}:{os.environ.get(name, '')}")
    patch.setenv("AMENT_PREFIX_PATH", f"{os.environ['AMENT_PREFIX_PATH']}:{prefix}")
    patch.syspath_prepend(str(packages))
    # this process has read LD_LIBRARY_PATH already
    for library in sorted((prefix / "lib").glob("lib*.so")):
        ctypes.CDLL(str(library))


def _build(prefix: Path) -> None:
    work = prefix.with_suffix(f".{os.getpid()}")
    package = (ROOT / "scripts" / "tf2_msgs" / "package.xml").read_text(encoding="utf-8")
    for name, text in {**FILES, "package.xml": package.replace("tf2_msgs", "nav2_msgs")}.items():
        (work / "src" / name).parent.mkdir(parents=True, exist_ok=True)
        (work / "src" / name).write_text(text, encoding="utf-8")
    found = "-DCMAKE_INSTALL_RPATH=$ORIGIN:$ORIGIN/../../.."
    for words in (
        [
            "cmake",
            "-S",
            work / "src",
            "-B",
            work / "build",
            f"-DCMAKE_INSTALL_PREFIX={work / 'made'}",
            found,
        ],
        ["cmake", "--build", work / "build", f"-j{os.cpu_count()}"],
        ["cmake", "--install", work / "build"],
    ):
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=1200)
        assert done.returncode == 0, done.stdout + done.stderr
    (work / "made").rename(prefix)
    shutil.rmtree(work)
