"""Goal variables that an action declares, from the specification to experience, model and refinement."""

from __future__ import annotations

import dataclasses
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_types import own_types
from outside.delivery import CRUISE, DELIVERY, PASS, VISIT
from refinement_fakes import FakeModel
from test_recordings import action_performance, write_records

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import GoalVariable, goal_values, with_values
from ator_ros.actions.remote import Filling, RemoteCall
from ator_ros.domains import domain as domains
from ator_ros.domains.domain import Domain, DomainError
from ator_ros.evaluation.trials import EvaluationError, random_trial
from ator_ros.experience.collect import collect
from ator_ros.experience.columns import ExperienceError, columns, goal_variables_of_columns
from ator_ros.experience.sources import read_sources
from ator_ros.experience.table import Experience, join, read_experience, write_experience
from ator_ros.geometry import Pose
from ator_ros.performance.features import Feature, variables
from ator_ros.performance.model_file import load_model
from ator_ros.performance.training import TrainingError, digest, direct_of, train
from ator_ros.refinement.free_variables import allowed_changes
from ator_ros.refinement.refiner import Refiner
from ator_ros.tools import train as train_tool
from ator_ros.tops.chain import EVERYTHING, InvalidChainError, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.world.state import RobotState, World

ROBOT = DELIVERY.robot()
LIBRARY = DELIVERY.library(ROBOT)
(SPEC,) = DELIVERY.action_sets["default"]


def goal(cruise: float, x: float = 1.0) -> Goal:
    return Goal(Pose(x, 0.0, 0.0), values={"cruise": cruise})


def with_spec(spec: Any) -> Domain:
    return dataclasses.replace(DELIVERY, action_sets={"default": (spec,)})


def experience(episodes: int = 30) -> Experience:
    frames = collect([SPEC], DELIVERY.tops, ROBOT, objects=("parcel",), episodes=episodes, seed=4)
    return Experience(join(frames), {"domain": "delivery"})


@pytest.fixture(scope="module")
def collected() -> Experience:
    return experience()


# Declarations


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "speed"}, "name: expected none of x, y, yaw, speed, which every goal has"),
        ({"name": "a b"}, "name: expected a name of letters"),
        ({"low": 1.0}, "cruise: low, high: expected finite numbers, low below high"),
        ({"high": float("inf")}, "cruise: low, high: expected finite numbers"),
        ({"steps": 0}, "cruise: steps: expected a whole number from 1"),
        ({"rest": 2.0}, "cruise: rest: expected a number from 0.2 to 1"),
    ],
)
def test_a_declaration_that_makes_no_sense_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(CRUISE, **changes)


def test_conditions_name_only_what_the_action_declares() -> None:
    high = dataclasses.replace(VISIT, post=Condition((Term("robot.x", "goal.height", 0.1),)))
    with pytest.raises(DomainError, match=r"goal_variables: expected all that .* visit name, \['height'\]"):
        dataclasses.replace(DELIVERY, tops=(high,))
    height = GoalVariable("height", "m", 0.0, 1.0)
    spec = dataclasses.replace(SPEC, goal_variables=(CRUISE, height))
    assert dataclasses.replace(DELIVERY, tops=(high,), action_sets={"default": (spec,)}).ranges["height"]


def test_a_server_is_told_only_what_the_action_declares() -> None:
    call = RemoteCall("drive", "some_msgs/action/Drive", (Filling("speed", source="goal.cruise"),))
    assert with_spec(dataclasses.replace(SPEC, remote=call))
    wrong = dataclasses.replace(call, goal=(Filling("speed", source="goal.hurry"),))
    with pytest.raises(DomainError, match=r"its server's goal is filled from, \['hurry'\] are missing"):
        with_spec(dataclasses.replace(SPEC, remote=wrong))


def test_one_name_means_one_thing_in_a_domain() -> None:
    other = dataclasses.replace(SPEC, goal_variables=(dataclasses.replace(CRUISE, high=0.9),))
    with pytest.raises(DomainError, match=r"action set 'slow': .* expected the same cruise in all actions"):
        dataclasses.replace(DELIVERY, action_sets={"default": (SPEC,), "slow": (other,)})
    with pytest.raises(DomainError, match="expected at most 16, each name once"):
        with_spec(dataclasses.replace(SPEC, goal_variables=(CRUISE, CRUISE)))


def test_features_derive_from_what_there_is() -> None:
    typo = Feature("typo", "s", variables("x cruseg"), lambda g: g.dist)
    with pytest.raises(DomainError, match=r"expected to derive from direct variables, got \['cruseg'\]"):
        dataclasses.replace(DELIVERY, features=(*DELIVERY.features, typo))


def test_a_goal_variable_is_a_candidate_of_its_action_by_itself() -> None:
    names = [feature.name for feature in DELIVERY.candidates("turnDriveTurn")]
    assert names == ["turned", "cruised", "cruiseg"]
    assert DELIVERY.known_features["cruiseg"].unit == "m/s"


def test_values_are_replaced_beside_those_that_all_goals_have() -> None:
    changed = with_values(goal(0.5), {"cruise": 0.7, "yaw": 1.0, "speed": 0.2})
    assert goal_values(changed) == {"x": 1.0, "y": 0.0, "yaw": 1.0, "speed": 0.2, "cruise": 0.7}
    assert LIBRARY.goal(VISIT, Pose(1.0, 2.0, 3.0)).values == {"cruise": pytest.approx(0.6)}


# Experience


def test_values_are_columns_of_experience(collected: Experience, tmp_path: Path) -> None:
    assert list(collected.frame.columns) == list(columns(("parcel",), ("cruise",)))
    file = tmp_path / "table.parquet"
    write_experience(file, collected)
    read = read_experience(file)
    assert read.metadata["goal_variables"] == ["cruise"]
    assert read.frame["cruiseg"].tolist() == collected.frame["cruiseg"].tolist()
    assert read.frame["cruiseg"].between(CRUISE.low, CRUISE.high).all()
    assert read.frame.groupby("episode")["cruiseg"].nunique().eq(1).all()
    both = read_sources([file, file], ROBOT, DELIVERY)
    assert goal_variables_of_columns(both.frame.columns) == ("cruise",)


@pytest.mark.parametrize("names", ["cruise", ["../x"], ["speed"], [f"v{i}" for i in range(17)]])
def test_tables_with_names_that_are_none_are_refused(
    collected: Experience, tmp_path: Path, names: Any
) -> None:
    file = tmp_path / "table.parquet"
    write_experience(file, Experience(collected.frame, {"goal_variables": names}))
    with pytest.raises(ExperienceError, match=r"metadata\.goal_variables.*: expected"):
        read_experience(file)


def test_an_action_without_the_variable_knows_nothing_of_it(collected: Experience) -> None:
    plain = collected.frame.drop(columns="cruiseg").assign(action="other")
    joined = join([collected.frame, plain])
    rows = joined[joined["action"] == "other"]
    assert rows["cruiseg"].isna().all()
    assert "cruiseg" not in direct_of(rows)
    assert digest(rows) == digest(plain)
    assert digest(joined[joined["action"] != "other"]) == digest(collected.frame) != digest(plain)


def test_a_situation_without_the_value_is_not_simulated() -> None:
    def lacking(robot: Any, rng: np.random.Generator) -> Any:
        return dataclasses.replace(SPEC.sample(robot, rng), goal=Goal(Pose(1.0, 0.0, 0.0)))

    spec = dataclasses.replace(SPEC, sample=lacking)
    with pytest.raises(ExperienceError, match="goal: expected values of cruise, got those of no variable"):
        list(collect([spec], DELIVERY.tops, ROBOT, objects=(), episodes=1, seed=1))


def test_a_chain_with_a_value_out_of_range_is_not_evaluated() -> None:
    def fast(robot: Any, library: Any, rng: np.random.Generator) -> Any:
        return World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), TopChain((TopCall(VISIT, goal(3.0)),))

    domain = dataclasses.replace(DELIVERY, chains={"fast": fast})
    with pytest.raises(EvaluationError, match=r"step 1 \(visit\): cruise: expected a number from 0.2"):
        random_trial(domain, "fast", LIBRARY, seed=1, index=0)


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
        given = [store.types["ator_interfaces/msg/GoalValue"](name, value) for name, value in values.items()]
        return dataclasses.replace(message, call=dataclasses.replace(message.call, values=given))

    write_records(tmp_path / "run", store, [record(cruise=0.4), record(cruise=0.8, of_another_domain=1.0)])
    rows = read_sources([tmp_path / "run"], ROBOT, DELIVERY).frame
    assert rows["cruiseg"].tolist() == [0.4, 0.8]
    assert "of_another_domaing" not in rows
    write_records(tmp_path / "nan", store, [record(cruise=float("nan")), record(cruise=0.8)])
    assert read_sources([tmp_path / "nan"], ROBOT, DELIVERY).metadata["records_left_out"] == 1


# Model


def test_a_model_predicts_from_the_value(
    collected: Experience, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = EntryPoint("delivery", "outside.delivery:DELIVERY", domains.GROUP)
    monkeypatch.setattr(domains, "entry_points", lambda **_: [entry])
    file = tmp_path / "table.parquet"
    write_experience(file, collected)
    words = ["--domain", "delivery", "--models", str(tmp_path)]
    assert train_tool.main([*words, str(file)]) == 0
    model = load_model(tmp_path / "turnDriveTurn.json", ROBOT, DELIVERY.known_features)
    assert "cruiseg" in model.used_variables
    ahead = {**dict.fromkeys(direct_of(collected.frame), 0.0), "xg": 2.0}
    times = model.predict({**ahead, "cruiseg": np.array([0.3, 0.9])}).duration
    assert times is not None
    assert times[0] > times[1] + 1.0
    with pytest.raises(ValueError, match="missing: cruiseg"):
        model.predict({name: 0.0 for name in direct_of(collected.frame) if name != "cruiseg"})
    capsys.readouterr()
    assert train_tool.main([*words, "--rules", "turnDriveTurn", "--situation", "xg=2", "cruiseg=0.5"]) == 0
    assert "cruised" in capsys.readouterr().out


def test_rows_without_a_value_are_not_learned_from(collected: Experience) -> None:
    features = DELIVERY.candidates("turnDriveTurn")
    lacking = collected.frame.assign(cruiseg=collected.frame["cruiseg"].where(collected.frame["episode"] > 0))
    with pytest.raises(TrainingError, match="turnDriveTurn: cruiseg: expected a value in each row"):
        train("turnDriveTurn", lacking, ROBOT, features=features)
    with pytest.raises(TrainingError, match="turnDriveTurn: cruiseg: expected a value in each row"):
        train("turnDriveTurn", collected.frame.drop(columns="cruiseg"), ROBOT, features=features)


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


def test_a_commitment_and_a_bound_value_stay() -> None:
    assert not refined(plan(frozenset())).free
    answer = refined(plan(frozenset({"cruise"}), PASS))
    assert not answer.free
    assert answer.not_free[0].reason == (
        "bound by the pre-condition of step 1 (pass): robot.v near goal.cruise"
    )


def test_the_next_action_needs_no_model_for_a_value_that_does_not_concern_it() -> None:
    other = dataclasses.replace(PASS, action="unknown")
    chain = TopChain((plan(frozenset({"cruise"})).calls[0], TopCall(other, goal(0.5, 2.0))))
    assert [variable.name for variable in refined(chain).free] == ["cruise"]


@pytest.mark.parametrize(
    ("opened", "values", "message"),
    [
        ({"cruise"}, {"cruise": 1.2}, "expected a number from 0.2 to 1, got 1.2"),
        ({"cruise"}, {"cruise": float("nan")}, "expected a number from 0.2 to 1, got nan"),
        ({"yaw"}, {"cruise": 0.7}, "expected 0.5 as planned, got 0.7"),
        ({"cruise"}, {"cruise": 0.7, "hurry": 1.0}, "expected the goal variables"),
    ],
)
def test_an_answer_changes_only_what_it_may(opened: set[str], values: dict[str, float], message: str) -> None:
    asked = plan(frozenset(opened))
    answer = asked.with_goal(0, with_values(asked.calls[0].goal, values))
    with pytest.raises(InvalidChainError, match=rf"step 1 \(visit\): {message}"):
        allowed_changes(asked, answer, ROBOT, LIBRARY.ranges)


def test_an_answer_brings_its_value() -> None:
    asked = plan(frozenset({"cruise"}))
    answer = asked.with_goal(0, goal(0.7))
    assert allowed_changes(asked, answer, ROBOT, LIBRARY.ranges) == [{"cruise": 0.7}, {}]
