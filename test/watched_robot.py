"""A robot that an action server drives, as its topics show it to a watch."""

from types import SimpleNamespace as Message

import numpy as np
from bags import Messages, Tick

from ator_ros.experience.server_drives import Watch
from ator_ros.experience.server_goals import ServerGoal
from ator_ros.geometry import Pose

SERVER = "navigate_to_pose"
STATUS, FEEDBACK = f"{SERVER}/_action/status", f"{SERVER}/_action/feedback"
EXECUTING, SUCCEEDED, CANCELED, ABORTED = 2, 4, 5, 6
TICK, SPEED = 0.05, 0.5


class Robot:
    """Drives along x at 0.5 m/s for each goal; each drive is 1 m and takes 2 s."""

    def __init__(self, watch: Watch) -> None:
        self.watch, self.make = watch, Messages()
        self.time = self.x = 0.0
        self.states: dict[int, tuple[int, float]] = {}
        self.odometry(0.0)

    def odometry(self, speed: float) -> None:
        self.time += TICK
        self.x += TICK * speed
        tick = Tick(self.time, Pose(self.x, 0.0, 0.0), speed, 0.0)
        self.watch.add("odom", self.make.odometry(tick))

    def set_state(self, goal: int, code: int) -> None:
        self.states[goal] = code, self.states.get(goal, (0, self.time))[1]
        items = []
        for number, (status, accepted) in self.states.items():
            stamp = self.make.header(accepted, "").stamp
            info = Message(goal_id=Message(uuid=np.full(16, number, np.uint8)), stamp=stamp)
            items.append(Message(goal_info=info, status=status))
        self.watch.add(STATUS, Message(status_list=items))

    def plan(self, *places: tuple[float, float]) -> None:
        poses = [self.make.stamped(self.time, *place) for place in places]
        header = self.make.header(self.time, "odom")
        self.watch.add("plan", Message(header=header, poses=poses))

    def feedback(self, goal: int, recoveries: int, remaining: float) -> None:
        seconds = self.make.header(remaining, "").stamp
        values = Message(number_of_recoveries=recoveries, estimated_time_remaining=seconds)
        goal_id = Message(uuid=np.full(16, goal, np.uint8))
        self.watch.add(FEEDBACK, Message(goal_id=goal_id, feedback=values))

    def start(self, goal: int) -> None:
        self.set_state(goal, EXECUTING)
        self.plan((self.x, 0.0), (self.x + 1.0, 0.0))

    def finish(self, goal: int, code: int = SUCCEEDED, waits: float = 0.0) -> None:
        """Drive to the goal, after a wait in s."""
        for speed, duration in ((0.0, waits), (SPEED, 1.0 / SPEED)):
            for _ in range(round(duration / TICK)):
                self.odometry(speed)
        self.set_state(goal, code)

    def drive(self, goal: int, code: int = SUCCEEDED, recoveries: int = 0) -> ServerGoal:
        self.start(goal)
        self.feedback(goal, recoveries, 5.0)
        self.finish(goal, code)
        (ended,) = self.watch.take_ended()
        return ended
