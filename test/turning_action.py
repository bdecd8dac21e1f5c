"""A simple action for tests: turn to the goal, drive, turn to the goal's heading.

It ignores the ball.
"""

from outside import delivery


class TurnDriveTurn(delivery.TurnDriveTurn):
    name = "goToPose"
