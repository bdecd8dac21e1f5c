"""Domains: found by the names of their entry points, complete, or refused in one sentence."""

from __future__ import annotations

import dataclasses
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from view.in_process import InProcessBackend

from ator_ros.domains import domain as domains
from ator_ros.domains.domain import DomainError, find_domain
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.evaluation.trials import possible_actions, possible_chain, random_trial
from ator_ros.experience.table import read_experience
from ator_ros.geometry import Pose
from ator_ros.performance.features import CANDIDATES, GENERAL, names_of
from ator_ros.planning.goals import PlanningError
from ator_ros.planning.planner import chains_for
from ator_ros.robot.description import ConfigError, load_robot
from ator_ros.tools import collect
from ator_ros.view.editor import Editor
from ator_ros.world.state import ObjectState, RobotState, World


def install(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    """Let `value` be the entry point of the one domain that is installed."""
    entry = EntryPoint("other", value, domains.GROUP)
    monkeypatch.setattr(domains, "entry_points", lambda *, group: [entry] if group == domains.GROUP else [])


def test_soccer_is_the_default() -> None:
    assert find_domain() is find_domain("soccer") is SOCCER


def test_an_unknown_name_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(
        DomainError, match=r"ator_ros.domains, one of \['drive', 'soccer', 'tour'\], got 'chess'"
    ):
        find_domain("chess")


def test_a_domain_of_another_package_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, "ator_ros.domains.soccer.domain:SOCCER")
    assert find_domain("other") is SOCCER
    with pytest.raises(DomainError, match="other"):
        find_domain("soccer")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("ator_ros.domains.soccer.tops:TOPS", "to be a Domain, got tuple"),
        ("no_such_package.domain:DOMAIN", "ModuleNotFoundError"),
        ("ator_ros.domains.soccer.domain:CHESS", "AttributeError"),
    ],
)
def test_what_is_no_domain_is_named(monkeypatch: pytest.MonkeyPatch, value: str, expected: str) -> None:
    install(monkeypatch, value)
    with pytest.raises(DomainError, match=f"^domain other: .*{expected}"):
        find_domain("other")


def test_a_module_that_raises_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "damaged_domain.py").write_text("1 / 0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    install(monkeypatch, "damaged_domain:DOMAIN")
    with pytest.raises(DomainError, match=r"^domain other: .*ZeroDivisionError"):
        find_domain("other")


def test_every_action_set_executes_every_top() -> None:
    for name in SOCCER.action_sets:
        library = SOCCER.library(load_robot(), name)
        assert all(library.action(top).name == top.action for top in library.values())


SMALL = dataclasses.replace(
    SOCCER, action_sets={**SOCCER.action_sets, "small": SOCCER.action_sets["default"][:1]}
)
"""With a set of actions that can drive, and nothing else."""
LACKS = "dribbleBall needs the action dribbleBall; action set small has none of that name"


def test_an_incomplete_action_set_leaves_out_what_needs_the_others() -> None:
    robot = load_robot()
    assert SMALL.library(robot).incomplete == ""
    assert dict(SMALL.library(robot)) == dict(SOCCER.library(robot))
    library = SMALL.library(robot, "small")
    assert list(library) == ["goToPose", "goToBall"]
    assert library.incomplete == (
        "action set small: without dribbleBall, shoot: "
        "expected also the actions dribbleBall, shoot, it has goToPose"
    )
    assert "dribbleBall" not in library
    with pytest.raises(ConfigError) as refused:
        library["dribbleBall"]
    assert str(refused.value) == LACKS


def test_a_chain_that_needs_what_is_left_out_is_refused_by_name_and_others_are_drawn() -> None:
    robot = SMALL.robot()
    library = SMALL.library(robot, "small")
    assert len(random_trial(SMALL, "drive", library, seed=1, index=0).chain) == 2
    with pytest.raises(ConfigError, match=f"^chain dribble of soccer: {LACKS}$"):
        random_trial(SMALL, "dribble", library, seed=1, index=0)
    actions, left_out = possible_actions(SMALL, "small", robot)
    assert actions == ["goToPose"]
    assert left_out == {"dribbleBall": LACKS, "shoot": LACKS.replace("dribbleBall", "shoot")}
    assert possible_chain(SMALL, library, "dribble", actions) == "drive"
    editor = Editor(InProcessBackend(SMALL, robot), SMALL, {"small": library})
    assert editor.chain_name == "drive"


def test_a_plan_says_which_tops_are_left_out() -> None:
    library = SMALL.library(SMALL.robot(), "small")
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(1.0, 0.0)})
    goal = SMALL.goals(library.robot)["ball_in_goal"].terms
    with pytest.raises(PlanningError, match=LACKS):
        chains_for(goal, world, library, SMALL.objects)


def test_collect_takes_the_actions_that_the_set_has(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(monkeypatch, f"{__name__}:SMALL")
    table = tmp_path / "table.parquet"
    words = ["--domain", "other", "--action-set", "small", "--episodes", "1", "--jobs", "1"]
    assert collect.main([*words, "--out", str(table)]) == 0
    assert set(read_experience(table).frame["action"]) == {"goToPose"}


def test_a_domain_needs_a_default_set() -> None:
    with pytest.raises(DomainError, match=r"expected an action set 'default', got \['bezier'\]"):
        dataclasses.replace(SOCCER, action_sets={"bezier": SOCCER.action_sets["bezier"]})


def test_an_object_of_a_condition_must_be_one_of_the_domain() -> None:
    with pytest.raises(DomainError, match=r"objects: expected all that conditions name, \['ball'\]"):
        dataclasses.replace(SOCCER, objects=("cup",))


def test_an_action_without_features_of_its_own_has_all_general_ones() -> None:
    assert SOCCER.candidates("fly") == CANDIDATES
    assert names_of(SOCCER.candidates("shoot")) == SOCCER.actions()["shoot"].features


def test_features_that_there_are_not_and_names_that_are_taken_are_refused() -> None:
    with pytest.raises(DomainError, match=r"'default': goToPose: features: expected .*got \['drive_time'"):
        dataclasses.replace(SOCCER, features=())
    with pytest.raises(DomainError, match=r"features: expected each name once, \['dist'\] are repeated"):
        dataclasses.replace(SOCCER, features=(*SOCCER.features, GENERAL["dist"]))


def test_each_action_of_soccer_has_one_ideal_time() -> None:
    for action_set in SOCCER.action_sets:
        ideal = {
            action: [feature.name for feature in SOCCER.candidates(action, action_set) if feature.ideal]
            for action in SOCCER.actions(action_set)
        }
        shot = "shot_time" if action_set == "bezier" else "run_up_time"
        assert ideal == {"goToPose": ["drive_time"], "dribbleBall": ["dribble_time"], "shoot": [shot]}
