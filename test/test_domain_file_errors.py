"""Domains as YAML files: what is wrong is told in one sentence, with its place."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import pytest
from domain_files import CHAIN, PLACE, TOUR, changed, file_of

from ator_ros.domains.domain import DomainError, find_domain


@pytest.mark.parametrize(
    ("action", "variable", "expected"),
    [
        (0, {"name": "yaw"}, r"actions\[0\].goal_variables\[0\]: name: expected none of x, y, yaw, speed"),
        (0, {"high": -1.0}, r"goal_variables\[0\]: height: low, high: expected finite numbers"),
        (1, {}, r"actions\[1\]: goal_variables: expected none without `remote`"),
    ],
)
def test_goal_variables_that_cannot_be_are_refused(
    tmp_path: Path, action: int, variable: dict[str, Any], expected: str
) -> None:
    data = copy.deepcopy(TOUR)
    usual = {"name": "height", "unit": "m", "low": 0.0, "high": 1.5}
    data["actions"][action]["goal_variables"] = [usual | variable]
    with pytest.raises(DomainError, match=expected):
        find_domain(str(file_of(tmp_path, data)))


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("name", "my tour", "name: expected a name of letters, digits and _; got 'my tour'"),
        ("name", "soccer", "name: expected none of the installed domains, .*'soccer'"),
        ("colour", 1, r"expected the fields actions, .*variables\]; unknown colour"),
        ("format", "ator_ros robot", "format: expected 'ator_ros domain', got 'ator_ros robot'"),
        ("schema_version", 1, "format: expected 'ator_ros domain'"),
        ("objects.0.type", "Pose", r"objects\[0\].type: expected one of Odometry, PoseStamped.*got 'Pose'"),
        ("objects.0.name", "robot", r"objects\[0\]: name: expected a name .*none of robot.*got 'robot'"),
        ("objects.0.topic", "a b", r"objects\[0\]: topic: expected the name of a topic; got 'a b'"),
        ("tops.1.name", "visit", "tops: expected each name once; got 'visit'"),
        ("tops", [], r"tops: expected at least one; got \[\]"),
        ("tops.0.post", [], r"tops\[0\]: post: expected at least one term"),
        (
            "tops.0.post.1.variable",
            "dog.x",
            r"tops\[0\].post\[1\].variable: expected one of robot.x, .*dog.x",
        ),
        ("tops.0.post.1.target", "goal.z", r"tops\[0\].post\[1\].target: expected one of .*got 'goal.z'"),
        ("tops.0.post.1.tolerance", -1, r"tops\[0\].post\[1\].tolerance: expected a number that is not neg"),
        ("tops.0.post.1.tolerance", math.nan, r"post\[1\].tolerance: expected a finite number; got nan"),
        ("tops.0.post.1.tolerance", True, r"post\[1\].tolerance: expected a finite number; got True"),
        ("tops.0.pre.1.high", 0.1, r"tops\[0\].pre\[1\]: range of robot.x: expected low <= high"),
        ("tops.0.pre.1.tolerance", 1, r"tops\[0\].pre\[1\]: expected the fields .*; unknown low"),
        ("tops.0.settles", -1, r"tops\[0\]: settles: expected a time in s from 0 to 60; got -1"),
        ("tops.0.post.1", 5, r"tops\[0\].post\[1\]: expected a table with .*; got 5"),
        ("tops.0.point", "tail", r"tops\[0\].point: expected one of axle, hold; got 'tail'"),
        ("actions.1.local.domain", "chess", r"actions\[1\].local: domain: expected an entry point .*'chess'"),
        ("actions.1.local.action_set", "fast", r"actions\[1\].local: action set of soccer: expected one of"),
        ("actions.0.local", {"domain": "soccer"}, r"actions\[0\]: local, remote: expected one of the two"),
        (
            "actions.0.remote.server",
            "",
            r"actions\[0\].remote: server: expected the name of an action server",
        ),
        ("actions.0.remote.type", "Pose", r"actions\[0\].remote: type: expected a type as in .*; got 'Pose'"),
        ("actions.0.remote.goal", [], r"actions\[0\].remote: goal: expected at least one field"),
        (
            "actions.0.remote.goal.0.source",
            "ball",
            r"goal\[0\]: source: expected one of goal, goal.x, .*'ball'",
        ),
        ("actions.0.remote.goal.0.constant", 0, r"goal\[0\]: source, constant: expected one of the two"),
        ("actions.0.remote.goal.0.field", "a..b", r"goal\[0\]: field: expected names joined by dots"),
        ("actions.0.remote.timeouts", {"result": 0}, r"timeouts: result: expected a time in s above 0"),
        ("actions.0.remote.success.status", [], r"success: status: expected at least one state"),
        (
            "actions.0.stand_in",
            "walk",
            r"actions\[0\].stand_in: expected an entry point of ator_ros.stand_ins, one of .*'walk'",
        ),
        ("actions.1.stand_in", "drive_to", r"actions\[1\]: stand_in: expected none without `remote`"),
        ("actions.0.drives", {"start": [], "goal": []}, r"actions\[0\].drives: start: expected at least one"),
        ("actions.0.drives", {"start": [{"x": [0]}]}, r"drives.start\[0\]: expected the fields .*missing y"),
        ("chains", [{"name": "a"}], r"chains\[0\]: expected the fields .*; missing start, steps"),
        ("chains", [CHAIN | {"name": "a b"}], r"chains\[0\]: name: expected a name"),
        ("chains", [CHAIN, CHAIN], "chains: expected each name once; got 'walk'"),
        (
            "chains",
            [CHAIN | {"steps": [{"top": "fly", "goal": [PLACE]}]}],
            r"chains\[0\].steps\[0\].top: expected one of visit, fetch; got 'fly'",
        ),
        ("servers", [{"package": "a b", "executable": "c"}], r"servers\[0\]: package: expected a name"),
        ("time_limit", 0, "time_limit: expected a time in s above 0, at most 86400"),
        ("variables.0.name", "z", r"variables\[0\].name: expected one of x, y, yaw, speed; got 'z'"),
        ("variables.1.high", 0.1, r"variables\[1\]: high: expected a number above low, 0.1; got 0.1"),
        ("variables.1.low", None, r"variables\[1\]: low, high: expected both or neither"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(
    tmp_path: Path, path: str, value: object, expected: str
) -> None:
    file = file_of(tmp_path, changed(path, value))
    with pytest.raises(DomainError, match=f"^{file}: .*{expected}"):
        find_domain(str(file))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1, 2]", "expected a table with actions"),
        ("name: errands", "; missing actions, tops"),
        ("a: &a [1]\nb: *a\n", "expected no alias, got *a"),
        ("name: [", "expected a readable YAML file"),
        ("#" * 200_001, "expected at most 0.2 MB, got more"),
        ("name: !!python/object:os.system x", "expected a readable YAML file"),
    ],
)
def test_what_is_no_domain_at_all_is_told_too(tmp_path: Path, text: str, expected: str) -> None:
    file = file_of(tmp_path, text)
    with pytest.raises(DomainError) as caught:
        find_domain(str(file))
    assert expected in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match=r"none.yaml: expected a readable YAML file: .*No such file"):
        find_domain(str(tmp_path / "none.yaml"))
