"""Print the URDF of the robot that a file describes: what the launch file gives robot_state_publisher."""

from __future__ import annotations

import sys

from ator_ros.robot.description import ConfigError, load_robot
from ator_ros.simulation.urdf import robot_urdf


def main() -> None:
    """Run the command line; end with one line where the file describes no robot."""
    if len(sys.argv) != 2:
        sys.exit(f"described: expected the file of a robot, got {sys.argv[1:]}")
    try:
        sys.stdout.write(robot_urdf(load_robot(sys.argv[1])))
    except ConfigError as error:
        sys.exit(f"described: {error}")


if __name__ == "__main__":
    main()
