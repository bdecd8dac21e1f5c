"""Direct variables of the steps of a chain."""

from __future__ import annotations

from refinement_fakes import ROBOT, call, world

from ator_ros.actions.base import Goal
from ator_ros.geometry import Pose
from ator_ros.refinement.chain_prediction import chain_situations
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term


def test_a_pure_turn_leaves_the_position_for_the_next_step() -> None:
    turn = Top("turn", "turn", Condition(), Condition((Term("robot.yaw", "goal.yaw", 0.1),)))
    calls = TopCall(turn, Goal(Pose(0.0, 0.0, 1.5))), call("goToPose", 1.0, 1.0, 0.0)
    table = chain_situations(world(x=-1.0, y=0.5), TopChain(calls), ROBOT)[1]
    assert [float(table[name][0]) for name in ("x", "y", "yaw")] == [-1.0, 0.5, 1.5]
