"""The `tour` domain over ROS: drives on its server take as long as without ROS."""

from pathlib import Path

import pytest
from process import executable, run

from ator_ros.domains.domain import find_domain
from ator_ros.experience.simulated import collect
from ator_ros.experience.table import read_experience
from ator_ros.resources import resource_path
from ator_ros.tools import collect as collect_tool

TOUR = find_domain("tour")
SEED = 7


@pytest.mark.node
@pytest.mark.long
def test_drives_over_ros_take_as_long_as_those_without(tmp_path: Path) -> None:
    file, drives = tmp_path / "drives.parquet", 3
    ended = run(
        *(executable("collect"), "--domain", "tour", "--over-ros", "--episodes", drives),
        *("--seed", SEED, "--out", file),
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert not file.with_suffix(".drives.jsonl").exists()
    table = read_experience(file)
    assert table.metadata["domain"] == "tour"
    assert list(table.frame["reason"]) == ["drive_to succeeded"] * drives
    simulated = collect(
        TOUR.actions().values(), TOUR.tops, TOUR.robot(), objects=(), episodes=drives, seed=SEED
    )
    for (_, driven), frame in zip(table.frame.iterrows(), simulated, strict=True):
        alone = frame.iloc[0]
        assert tuple(driven[["xg", "yg", "yawg"]]) == pytest.approx(
            tuple(alone[["xg", "yg", "yawg"]])
        )
        assert tuple(driven[["x", "y", "yaw"]]) == pytest.approx(
            tuple(alone[["x", "y", "yaw"]]), abs=1e-3
        )
        # or three ticks
        assert driven["duration"] == pytest.approx(alone["duration"], rel=0.03, abs=0.15)


# Finished drives are not repeated


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("action: drive_to\n", "action: drive_too\n", "expected a TOP with the action drive_to"),
        (
            "field: goal",
            "field: gaol",
            "action server drive_to: goal[0].field: expected one of goal",
        ),
    ],
)
def test_a_domain_that_does_not_match_its_server_is_rejected_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], right: str, wrong: str, message: str
) -> None:
    for name in ("tour.yaml", "courier.yaml"):
        text = resource_path("config", "tour", name).read_text()
        (tmp_path / name).write_text(text.replace("name: tour", "name: own").replace(right, wrong))
    words = ["--domain", str(tmp_path / "tour.yaml"), "--over-ros", "--episodes", "2"]
    assert collect_tool.main([*words, "--out", str(tmp_path / "table.parquet")]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "table.parquet").exists()
