"""Print the URDF of the robot that a file describes: what the launch file gives robot_state_publisher."""

from __future__ import annotations

import sys

from ator_ros.robot.description import load_robot
from ator_ros.simulation.urdf import robot_urdf

if __name__ == "__main__":
    (path,) = sys.argv[1:]
    print(robot_urdf(load_robot(path)))
