"""The domain files that docs/ refers to are valid; the one for Nav2 matches its types."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from documentation import ROOT

from ator_interfaces.action import ExecuteChain
from ator_ros.actions.base import Goal
from ator_ros.actions.remote import failure_in
from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import chain_from
from ator_ros.nodes.remote_messages import RemoteInterface
from examples.call import filled

NAV2 = ROOT / "config" / "nav2" / "stations.yaml"
ERRANDS = ROOT / "docs" / "errands.yaml"
SUCCEEDED = 4


def page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def message(**types: str) -> type:
    """Return a message class with fields of these types, as in nav2_msgs."""

    class Message(SimpleNamespace):
        @classmethod
        def get_fields_and_field_types(cls) -> dict[str, str]:
            return types

    return Message


GOAL = message(pose="geometry_msgs/PoseStamped", behavior_tree="string")
RESULT = message(error_code="uint16")


def test_the_example_is_declared_as_printed() -> None:
    (excerpt,) = re.findall(
        r"^```yaml\n(actions:.*?)^```$", page("own_server"), re.MULTILINE | re.DOTALL
    )
    assert excerpt in (ROOT / "docs" / "shuttle" / "my_domain.yaml").read_text(encoding="utf-8")
    assert (
        find_domain(str(ROOT / "docs" / "shuttle" / "my_domain.yaml")).robot(None).name
        == "my_robot"
    )


@pytest.mark.parametrize("file", [NAV2, ERRANDS], ids=lambda file: file.stem)
def test_each_file_is_a_domain(file: Path) -> None:
    domain = find_domain(str(file))
    assert {top.action for top in domain.tops} <= set(domain.actions())


def test_the_tour_for_nav2_is_a_chain_of_its_domain() -> None:
    domain = find_domain(str(NAV2))
    (text,) = re.findall(
        r"ros2 action send_goal -f .*ExecuteChain \"(.*?)\"", page("nav2"), flags=re.DOTALL
    )
    goal = filled(ExecuteChain.Goal, yaml.safe_load(text))
    calls = chain_from(goal.chain, domain.library(domain.robot()), frame="map").calls
    assert [sorted(call.open) for call in calls] == [["yaw"], ["yaw"], []]


def test_the_file_for_nav2_matches_its_types(monkeypatch: pytest.MonkeyPatch) -> None:
    remote = find_domain(str(NAV2)).actions()["navigate_to_pose"].remote
    types = SimpleNamespace(NavigateToPose=SimpleNamespace(Goal=GOAL, Result=RESULT))
    monkeypatch.setitem(sys.modules, "nav2_msgs.action", types)
    sent = RemoteInterface(remote, "map").written((Goal(Pose(1.0, 2.0, 0.0)),))
    assert (sent.pose.header.frame_id, sent.pose.pose.position.y, sent.behavior_tree) == (
        "map",
        2.0,
        "",
    )
    assert failure_in(remote, SUCCEEDED, RESULT(error_code=0)) is None
    assert (
        failure_in(remote, SUCCEEDED, RESULT(error_code=9003)) == "error_code: expected 0, got 9003"
    )
