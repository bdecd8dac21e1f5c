"""Domains: found by entry point name and complete, otherwise rejected with one sentence."""

import dataclasses

import pytest
from domain_files import install

from ator_ros.bases.description import ConfigError, load_robot
from ator_ros.domains.domain import DomainError, find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import possible_actions, possible_chain, random_trial
from ator_ros.performance.features import GENERAL


def test_an_unknown_name_is_rejected_with_the_known_names() -> None:
    with pytest.raises(
        DomainError,
        match=r"ator_ros.domains, one of \['building', 'drive', .* 'tour'\], got 'chess'",
    ):
        find_domain("chess")


def test_a_domain_of_another_package_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, "other", "ator_ros.domains.soccer.soccer_domain:SOCCER")
    assert find_domain("other") is SOCCER
    with pytest.raises(DomainError, match="other"):
        find_domain("soccer")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("ator_ros.domains.soccer.tops:TOPS", "expected a Domain, got tuple"),
        ("no_such_package.domain:DOMAIN", "ModuleNotFoundError"),
        ("ator_ros.domains.soccer.soccer_domain:CHESS", "AttributeError"),
    ],
)
def test_an_invalid_domain_is_reported(
    monkeypatch: pytest.MonkeyPatch, value: str, expected: str
) -> None:
    install(monkeypatch, "other", value)
    with pytest.raises(DomainError, match=f"^domain other: .*{expected}"):
        find_domain("other")


def test_a_package_adds_an_action_set_to_an_installed_domain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    value = "ator_ros_examples.bezier:ACTIONS"
    install(monkeypatch, "other", "ator_ros.domains.soccer.soccer_domain:SOCCER")
    assert list(find_domain("other").action_sets) == ["default"]
    install(
        monkeypatch,
        "other",
        "ator_ros.domains.soccer.soccer_domain:SOCCER",
        action_sets={"other.curves": value, "another.curves": "missing:SET"},
    )
    other = find_domain("other")
    assert list(other.action_sets) == ["default", "curves"]
    assert other.actions("default") == SOCCER.actions("default")
    assert set(other.library(load_robot(), "curves")) == set(other.library(load_robot()))


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("curves", "ator_ros.domains.soccer.tops:TOPS", "a tuple of ActionSpec"),
        ("curves", "no_such_package:SET", "ModuleNotFoundError"),
        ("default", "ator_ros_examples.bezier:ACTIONS", "each name once, got default twice"),
    ],
)
def test_an_action_set_that_cannot_be_added_is_reported(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, expected: str
) -> None:
    soccer = "ator_ros.domains.soccer.soccer_domain:SOCCER"
    install(monkeypatch, "other", soccer, action_sets={f"other.{name}": value})
    with pytest.raises(DomainError, match=f"^action set.*{expected}"):
        find_domain("other")


SMALL = dataclasses.replace(
    SOCCER, action_sets={**SOCCER.action_sets, "small": SOCCER.action_sets["default"][:1]}
)
"""A domain with an action set that can only drive."""
LACKS = "dribbleBall needs the action dribbleBall; action set small has none of that name"


def test_an_incomplete_action_set_omits_tops_without_action() -> None:
    robot = load_robot()
    assert SMALL.library(robot).left_out == {}
    assert dict(SMALL.library(robot)) == dict(SOCCER.library(robot))
    library = SMALL.library(robot, "small")
    assert list(library) == ["goToPose", "goToBall"]
    assert library.left_out == {
        "dribbleBall": LACKS,
        "shoot": LACKS.replace("dribbleBall", "shoot"),
    }
    assert "dribbleBall" not in library
    with pytest.raises(ConfigError) as refused:
        library["dribbleBall"]
    assert str(refused.value) == LACKS


def test_a_chain_with_an_omitted_top_is_rejected_and_others_are_drawn() -> None:
    robot = SMALL.robot()
    library = SMALL.library(robot, "small")
    assert len(random_trial(SMALL, "drive", library, seed=1, index=0).chain) == 2
    with pytest.raises(ConfigError, match=f"^chain dribble of soccer: {LACKS}$"):
        random_trial(SMALL, "dribble", library, seed=1, index=0)
    actions, left_out = possible_actions(SMALL, "small", robot)
    assert actions == ["goToPose"]
    assert left_out == {"dribbleBall": LACKS, "shoot": LACKS.replace("dribbleBall", "shoot")}
    assert possible_chain(SMALL, library, "dribble", actions) == "drive"


def test_unknown_features_and_reserved_names_are_rejected() -> None:
    with pytest.raises(
        DomainError, match=r"'default': shoot: features: expected .*got \['hold_dist'"
    ):
        dataclasses.replace(SOCCER, features=())
    with pytest.raises(DomainError, match=r"features: expected each name once; got \['dist'\]"):
        dataclasses.replace(SOCCER, features=(*SOCCER.features, GENERAL["dist"]))
