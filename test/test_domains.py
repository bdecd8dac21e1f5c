"""Domains: found by the names of their entry points, complete, or refused in one sentence."""

from __future__ import annotations

import dataclasses
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from ator_ros.domains import domain as domains
from ator_ros.domains.domain import DomainError, find_domain
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.performance.features import CANDIDATES, GENERAL, names_of
from ator_ros.robot.description import load_robot


def install(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    """Let `value` be the entry point of the one domain that is installed."""
    entry = EntryPoint("other", value, domains.GROUP)
    monkeypatch.setattr(domains, "entry_points", lambda *, group: [entry] if group == domains.GROUP else [])


def test_soccer_is_the_default() -> None:
    assert find_domain() is find_domain("soccer") is SOCCER


def test_an_unknown_name_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(DomainError, match=r"ator_ros.domains, one of \['soccer', 'tour'\], got 'chess'"):
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


def test_an_incomplete_action_set_is_refused() -> None:
    some = {**SOCCER.action_sets, "small": SOCCER.action_sets["default"][:1]}
    with pytest.raises(DomainError, match=r"'small': expected the actions \['dribbleBall', 'shoot'\]"):
        dataclasses.replace(SOCCER, action_sets=some)
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
        assert ideal == {"goToPose": ["drive_time"], "dribbleBall": ["dribble_time"], "shoot": ["shot_time"]}
