"""Models learned with a map predict drives around walls, and need the map to predict."""

from pathlib import Path

import numpy as np
import pytest
from experience_rows import dead_zone_drives, route_drives
from maps import hall, write_map

from ator_ros.domains.domain import Domain, find_domain
from ator_ros.execution.fence import Fence
from ator_ros.experience.table import Experience, ExperienceError, write_experience
from ator_ros.files import FileError
from ator_ros.geometry import Pose
from ator_ros.nodes.parameters import SetupError, domain_and_robot
from ator_ros.performance.model_file import load_model
from ator_ros.performance.training import direct_of, train
from ator_ros.tools import train as tool
from ator_ros.tops.chain import TopCall, TopChain

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
NOISE = 0.05


@pytest.fixture(scope="module")
def walled(tmp_path_factory: pytest.TempPathFactory) -> Domain:
    return TOUR.on_map(write_map(tmp_path_factory.mktemp("map"), hall()))


def test_drives_around_a_wall_are_predicted_with_the_map_only(walled: Domain) -> None:
    rows, fresh = (route_drives(walled.robot(), n, seed=n, noise=NOISE) for n in (160, 100))
    errors = {}
    for name, domain in (("map", walled), ("none", TOUR)):
        model = train("drive_to", rows, domain.robot(), features=domain.candidates("drive_to"))
        errors[name] = np.abs(model.predict(direct_of(fresh)).duration - fresh["duration"]).mean()
        assert any(each.startswith("route_") for each in model.used_features) == (name == "map")
    assert errors["map"] < 1.5 * NOISE
    assert errors["none"] > 10.0 * NOISE


def test_an_empty_map_changes_no_prediction(tmp_path: Path) -> None:
    empty = TOUR.on_map(write_map(tmp_path, hall(wall=False)))
    rows, fresh = dead_zone_drives(100, seed=1), direct_of(dead_zone_drives(50, seed=2))
    with_map, without = (
        train("drive_to", rows, domain.robot(), features=domain.candidates("drive_to"))
        .predict(fresh)
        .duration
        for domain in (empty, TOUR)
    )
    assert with_map == pytest.approx(without, abs=1e-9)


def test_a_model_learned_with_a_map_needs_one(
    walled: Domain, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table, building = tmp_path / "drives.parquet", write_map(tmp_path, hall())
    blocked = route_drives(walled.robot(), 100, seed=3, noise=NOISE)
    blocked.loc[0, "xg"] = 0.0
    blocked.loc[0, "yg"] = -1.0
    write_experience(
        table,
        Experience(
            blocked, {"domain": "tour", "robot_digest": ROBOT.digest(), "action_set": "default"}
        ),
    )
    words = [
        "--domain",
        "tour",
        str(table),
        "--models",
        str(tmp_path / "models"),
        "--map",
        str(building),
    ]
    assert tool.main(words) == 0
    assert "drive_to: 1 of" in capsys.readouterr().err
    file = tmp_path / "models" / "drive_to.json"
    model = load_model(file, walled.robot(), walled.known_features)
    assert model.metadata["training"]["map"].startswith("hall.yaml (")
    unreachable = {**dict.fromkeys(direct_of(blocked), 0.0), "x": -2.0, "xg": np.array([0.0, -1.0])}
    assert np.isnan(model.predict(unreachable).duration).tolist() == [True, False]
    with pytest.raises(
        FileError, match=r"drive_to\.json: features: expected a map, as this model was learned"
    ):
        load_model(file, ROBOT, TOUR.known_features)


def test_a_map_of_another_place_is_reported(walled: Domain) -> None:
    rows = dead_zone_drives(60, seed=1).assign(x=100.0)
    with pytest.raises(
        ExperienceError, match="60 of 60 episodes have no route on the map and are left out"
    ):
        train("drive_to", rows, walled.robot(), features=walled.candidates("drive_to"))


def test_goals_in_obstacles_and_out_of_reach_are_reported(walled: Domain) -> None:
    fence, robot = Fence(-50.0, -50.0, 50.0, 50.0), walled.robot()
    library = walled.library(robot)
    [top] = library.usable()[:1]

    def fault(x: float, opened: str = "yaw") -> str | None:
        calls = [
            TopCall(top, library.goal(top, Pose(at, 0.0, 0.0)), frozenset({opened}))
            for at in (-2.0, x)
        ]
        return fence.violation(TopChain(tuple(calls)), robot)

    assert fault(2.0) is None
    assert fault(0.0, "x") is None
    assert f"chain.calls[1].goal ({top.name}): expected a place in free space" in (fault(0.0) or "")


def test_the_parameter_map_of_nodes(tmp_path: Path) -> None:
    settings = {"domain": "tour", "robot": "", "map": str(write_map(tmp_path, hall()))}
    assert domain_and_robot(settings)[1].grid is not None
    assert domain_and_robot({**settings, "map": ""})[1].grid is None
    with pytest.raises(
        SetupError, match=r"parameter map: .*none\.yaml: expected a readable YAML file"
    ):
        domain_and_robot({**settings, "map": str(tmp_path / "none.yaml")})
    settings["map"] = str(write_map(tmp_path, hall() & (np.arange(hall().shape[1]) % 4 == 0)))
    with pytest.raises(
        SetupError, match=r"parameter map: .*expected a place .* from obstacles, got none"
    ):
        domain_and_robot(settings)
