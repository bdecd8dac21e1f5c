"""The `tour` domain over ROS: drives on its server take as long as without ROS."""

from pathlib import Path

import pandas as pd
import pytest
from process import executable, run

from ator_ros.domains.domain import find_domain
from ator_ros.experience.collect import collect
from ator_ros.experience.json_lines import PartialResults
from ator_ros.experience.table import join, library_versions, read_experience
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
        assert tuple(driven[["xg", "yg", "yawg"]]) == pytest.approx(tuple(alone[["xg", "yg", "yawg"]]))
        assert tuple(driven[["x", "y", "yaw"]]) == pytest.approx(tuple(alone[["x", "y", "yaw"]]), abs=1e-3)
        assert driven["duration"] == pytest.approx(alone["duration"], rel=0.03, abs=0.15)  # or three ticks


@pytest.mark.node
@pytest.mark.long
def test_the_demo_executes_a_tour(tmp_path: Path) -> None:
    ended = run(executable("demo"), "--domain", "tour", "--situations", 1, "--out", tmp_path / "tour.png")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "three nodes and drive_to_server start on ROS domain" in ended.stdout
    assert "1 of 1 situations succeeded both ways; refinement saved" in ended.stdout


# Finished drives are not repeated


def test_drives_are_kept_until_the_table_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = tmp_path / "drives.parquet"
    words = ["--domain", "tour", "--actions", "drive_to", "--over-ros", "--episodes", "2"]
    words += ["--seed", str(SEED), "--out", str(table)]
    drives = collect(TOUR.actions().values(), TOUR.tops, TOUR.robot(), objects=(), episodes=2, seed=SEED)
    frames = [frame.head(1) for frame in drives]
    options = collect_tool.arguments().parse_args(words)
    identity = {
        "seed": options.seed,
        "robot": TOUR.robot().sections(),
        "domain": "tour",
        "action_set": options.action_set,
        "over_ros": True,
        "versions": library_versions(),
    }
    with PartialResults(table.with_suffix(".episodes.jsonl"), identity, "episodes") as kept:
        for frame in frames:
            kept.append(frame.to_dict("list"))

    def fail(*_: object) -> None:
        raise OSError("no space left")

    with monkeypatch.context() as patched:
        patched.setattr(collect_tool, "write_experience", fail)
        assert collect_tool.main(words) == 1
    assert kept.path.exists()
    assert collect_tool.main(words) == 0  # starts no node
    assert list(tmp_path.iterdir()) == [table]
    frame = read_experience(table).frame
    pd.testing.assert_frame_equal(frame, join(frames), check_exact=True, check_dtype=False)


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("action: drive_to\n", "action: drive_too\n", "expected a TOP with the action drive_to"),
        ("field: goal", "field: gaol", "action server drive_to: goal[0].field: expected one of goal"),
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
