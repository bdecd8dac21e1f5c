"""The launch files of a team start installed executables, with existing parameters."""

from importlib.metadata import entry_points
from xml.etree import ElementTree as ET

import pytest

from ator_ros.domains.soccer.field import BALL
from ator_ros.nodes.executor import parameters_for as of_executor
from ator_ros.nodes.parameters import Parameter
from ator_ros.nodes.plan_team import PARAMETERS as PLAN_TEAM
from ator_ros.nodes.refinement import PARAMETERS as REFINEMENT
from ator_ros.nodes.simulation import parameters_for as of_simulation
from ator_ros.nodes.team import PARAMETERS as TEAM
from ator_ros.resources import share_folder

FOLDER = share_folder() / "launch"
FILES = {
    name: ET.parse(FOLDER / f"{name}.launch.xml").getroot()  # noqa: S314 - our own files
    for name in ("team", "teammate")
}
PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    "executor": of_executor([BALL]),
    "plan_team": PLAN_TEAM,
    "refinement": REFINEMENT,
    "simulation": of_simulation([BALL]),
    "team": TEAM,
}


@pytest.mark.parametrize("file", FILES)
def test_nodes_are_installed_and_have_these_parameters(file: str) -> None:
    installed = {script.name for script in entry_points(group="console_scripts")}
    for node in FILES[file].iter("node"):
        name = node.get("exec", "")
        assert name in installed
        named = {param.get("name") for param in node.iter("param") if param.get("name")}
        assert named <= {parameter.name for parameter in PARAMETERS[name]}
        for param in node.iter("param"):
            if given := param.get("from"):
                assert given == f"$(var config)/{name}.yaml"


def test_each_simulated_robot_has_its_nodes() -> None:
    (robots,) = [
        param.get("value", "")
        for param in FILES["team"].iter("param")
        if param.get("name") == "robots"
    ]
    included = FILES["team"].findall("include")
    assert all(each.get("file", "").endswith("/teammate.launch.xml") for each in included)
    names = [
        arg.get("value")
        for each in included
        for arg in each.iter("arg")
        if arg.get("name") == "name"
    ]
    assert names == robots.split(",")


def test_included_files_get_arguments_that_they_have() -> None:
    declared = {arg.get("name") for arg in FILES["teammate"].findall("arg")}
    for each in FILES["team"].findall("include"):
        assert {arg.get("name") for arg in each.findall("arg")} <= declared


def test_the_node_team_is_started_only_with_roles() -> None:
    (team,) = [node for node in FILES["teammate"].iter("node") if node.get("exec") == "team"]
    assert team.get("if") == r"$(eval '\'$(var roles)\' != \'\'')"
    (roles,) = [arg for arg in FILES["team"].findall("arg") if arg.get("name") == "roles"]
    file = roles.get("default", "").replace("$(var config)", str(share_folder() / "config"))
    assert share_folder().joinpath(file).exists()
