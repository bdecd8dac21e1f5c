"""The scenes of `demo --team`."""

import itertools
from pathlib import Path

import pytest
from PIL import Image

from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.tools.team_demo import Scene, random_deliveries, save_scenes

ROBOT = load_robot()


@pytest.mark.parametrize("seed", range(5))
def test_deliveries_are_inside_of_the_area_and_apart(seed: int) -> None:
    places = random_deliveries(ROBOT, seed)
    assert len(places) % 2 == 0
    assert places == random_deliveries(ROBOT, seed)
    area = ROBOT.scene.area
    assert all(abs(pose.x) < area.length / 2 and abs(pose.y) < area.width / 2 for pose in places)
    assert all(one.distance(other) > 0.5 for one, other in itertools.combinations(places, 2))


def test_scenes_are_drawn_side_by_side(tmp_path: Path) -> None:
    paths = {"ann": [(0.0, 0.0), (1.0, 0.0)], "bob": [(0.0, 1.0), (1.0, 1.0)]}
    texts = {"ann": "ann: ball"}
    scene = Scene(SOCCER, ROBOT, "soccer", paths, texts, [(0.0, 0.5)], [Pose(1.0, 1.0, 0.0)])
    save_scenes(tmp_path / "one.png", [scene])
    save_scenes(tmp_path / "two.png", [scene, scene])
    with Image.open(tmp_path / "one.png") as one, Image.open(tmp_path / "two.png") as two:
        assert two.width == 2 * one.width
