"""Goal variables of an action, from specification to experience, model and refinement."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import action_performance, own_types, write_records
from domain_files import install
from outside.delivery import CRUISE, DELIVERY, PASS, VISIT
from refinement_fakes import FakeModel

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.domains.domain import DomainError
from ator_ros.experience.recordings import read_sources
from ator_ros.experience.simulated import collect
from ator_ros.experience.table import (
    Experience,
    columns,
    goal_variables_of_columns,
    join,
    read_experience,
    write_experience,
)
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_model
from ator_ros.performance.training import direct_of
from ator_ros.refinement.refiner import Refiner
from ator_ros.tools import train as train_tool
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.world.state import RobotState, World

ROBOT = DELIVERY.robot()
LIBRARY = DELIVERY.library(ROBOT)
(SPEC,) = DELIVERY.action_sets["default"]


def goal(cruise: float, x: float = 1.0) -> Goal:
    return Goal(Pose(x, 0.0, 0.0), values={"cruise": cruise})


@pytest.fixture(scope="module")
def collected() -> Experience:
    frames = collect([SPEC], DELIVERY.tops, ROBOT, objects=("parcel",), episodes=30, seed=4)
    return Experience(join(frames), {"domain": "delivery"})


# Declarations


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "speed"}, "name: expected none of x, y, yaw, speed, order, which have a meaning"),
        ({"low": 1.0}, "cruise: low, high: expected finite numbers, low below high"),
        ({"rest": 2.0}, "cruise: rest: expected a number from 0.2 to 1"),
    ],
)
def test_an_invalid_declaration_is_rejected(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(CRUISE, **changes)


def test_conditions_use_only_declared_variables() -> None:
    high = dataclasses.replace(VISIT, post=Condition((Term("robot.x", "goal.height", 0.1),)))
    with pytest.raises(
        DomainError, match=r"visit.post\[0\].target: expected one of .* got 'goal.height'"
    ):
        dataclasses.replace(DELIVERY, tops=(high,))
    height = GoalVariable("height", "m", 0.0, 1.0)
    spec = dataclasses.replace(SPEC, goal_variables=(CRUISE, height))
    assert dataclasses.replace(DELIVERY, tops=(high,), action_sets={"default": (spec,)}).ranges[
        "height"
    ]


# Experience


def test_values_are_experience_columns(collected: Experience, tmp_path: Path) -> None:
    assert list(collected.frame.columns) == list(columns(("parcel",), ("cruise",)))
    file = tmp_path / "table.parquet"
    write_experience(file, collected)
    read = read_experience(file)
    assert goal_variables_of_columns(read.frame) == ("cruise",)
    assert read.frame["cruiseg"].tolist() == collected.frame["cruiseg"].tolist()
    assert read.frame["cruiseg"].between(CRUISE.low, CRUISE.high).all()
    assert read.frame.groupby("episode")["cruiseg"].nunique().eq(1).all()
    both = read_sources([file, file], ROBOT, DELIVERY)
    assert goal_variables_of_columns(both.frame.columns) == ("cruise",)


def test_records_of_the_executor_hold_the_values(tmp_path: Path) -> None:
    store = own_types()

    def record(**values: float) -> Any:
        message = action_performance(
            store,
            goal=Pose(1.0, 0.0, 0.0),
            speed=0.0,
            duration=4.0,
            code=1,
            action="turnDriveTurn",
            top="visit",
        )
        given = [
            store.types["ator_interfaces/msg/GoalValue"](name, value)
            for name, value in values.items()
        ]
        return dataclasses.replace(message, call=dataclasses.replace(message.call, values=given))

    write_records(
        tmp_path / "run", store, [record(cruise=0.4), record(cruise=0.8, of_another_domain=1.0)]
    )
    rows = read_sources([tmp_path / "run"], ROBOT, DELIVERY).frame
    assert rows["cruiseg"].tolist() == [0.4, 0.8]
    assert "of_another_domaing" not in rows
    write_records(tmp_path / "nan", store, [record(cruise=float("nan")), record(cruise=0.8)])
    (remark,) = read_sources([tmp_path / "nan"], ROBOT, DELIVERY).remarks
    assert remark.startswith("nan: left out 1 of 2 records: ")


# Model


def test_a_model_uses_the_value(
    collected: Experience, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, "delivery", "outside.delivery:DELIVERY")
    file = tmp_path / "table.parquet"
    write_experience(file, collected)
    words = ["--domain", "delivery", "--models", str(tmp_path)]
    assert train_tool.main([*words, str(file)]) == 0
    model = load_model(tmp_path / "turnDriveTurn.json", ROBOT, DELIVERY.known_features)
    assert "cruiseg" in model.used_variables
    ahead = {**dict.fromkeys(direct_of(collected.frame), 0.0), "xg": 2.0}
    times = model.predict({**ahead, "cruiseg": np.array([0.3, 0.9])}).duration
    assert times[0] > times[1] + 1.0
    with pytest.raises(ValueError, match="missing: cruiseg"):
        model.predict({name: 0.0 for name in direct_of(collected.frame) if name != "cruiseg"})


# Refinement


def plan(opened: frozenset[str], top: Any = VISIT) -> TopChain:
    return TopChain((TopCall(top, goal(0.5), opened), TopCall(PASS, goal(0.5, 2.0))))


def refined(chain: TopChain) -> Any:
    model = FakeModel(lambda d: 1.0 + np.square(d["cruiseg"] - 0.8), frozenset({"cruiseg"}))
    return Refiner(ROBOT, {"turnDriveTurn": model}, ranges=LIBRARY.ranges).refine(
        World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), chain
    )


def test_an_open_value_is_refined() -> None:
    for opened in (frozenset({"cruise"}), frozenset({EVERYTHING})):
        answer = refined(plan(opened))
        assert [variable.name for variable in answer.free] == ["cruise"]
        assert answer.chain.calls[0].goal.values["cruise"] == pytest.approx(0.8, abs=0.01)
        assert answer.chain.calls[1].goal.values == {"cruise": 0.5}


def test_committed_and_bound_values_are_kept() -> None:
    assert not refined(plan(frozenset())).free
    answer = refined(plan(frozenset({"cruise"}), PASS))
    assert not answer.free
    assert answer.not_free[0].reason == (
        "bound by the pre-condition of step 1 (pass): robot.vx near goal.cruise"
    )
