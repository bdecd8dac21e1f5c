"""Experience of an action that passes its goals: legs follow each other without a stop."""

import math
from pathlib import Path

import numpy as np
import pytest
from bags import action_performance, own_types
from experience_rows import synthetic_experience

from ator_ros.domains.domain import find_domain
from ator_ros.experience.recordings import read_sources
from ator_ros.experience.records import episode_of
from ator_ros.experience.simulated import collect
from ator_ros.experience.table import Experience, checked_rows, join, write_experience
from ator_ros.geometry import Pose

DOMAIN = find_domain("patrol")
ROBOT = DOMAIN.robot()


def test_collected_legs_continue_where_the_one_before_has_passed_its_goal() -> None:
    spec = DOMAIN.actions()["pursue"]
    frames = list(
        collect([spec], DOMAIN.tops_for(ROBOT), ROBOT, objects=(), episodes=6, seed=3,
                time_limit=60.0, finished={("pursue", 4)})
    )  # fmt: skip
    rows = checked_rows("collected", join(frames), "default")
    starts = rows[rows["t"] == 0.0]
    assert starts["episode"].tolist() == [0, 1, 2, 3, 5]
    assert starts["success"].all()
    passed = (starts["stopg"] == 0.0).to_numpy()[:3]
    moving = (starts["v"] > 0.2).to_numpy()[1:4]
    assert (passed == moving).all()
    assert passed.any()
    assert not passed.all()
    within = np.abs(starts[["xg", "yg"]].to_numpy()[:3] - starts[["x", "y"]].to_numpy()[1:4])
    assert (within <= 0.3).all()
    took_over = np.hypot(*within.T)[passed]
    nearest = starts["position_error"].to_numpy()[:3][passed]
    assert starts["nearer"].to_numpy()[:3][passed] == pytest.approx(took_over - nearest)
    assert (nearest < took_over).all()
    assert starts["nearer"][starts["stopg"] == 1.0].isna().all()
    assert starts["heading_error"].isna().tolist() == (starts["stopg"] == 0.0).tolist()


def test_experience_of_before_an_action_could_pass_has_stopped(tmp_path: Path) -> None:
    rows = synthetic_experience("pursue", episodes=30)
    about = {"robot_digest": ROBOT.digest(), "domain": "patrol"}
    write_experience(tmp_path / "former.parquet", Experience(rows, about))
    read = read_sources([tmp_path / "former.parquet"], ROBOT, DOMAIN).frame
    assert (read["stopg"] == 1.0).all()
    pursuit = find_domain("pursuit")
    write_experience(tmp_path / "pursuit.parquet", Experience(rows, {**about, "domain": "pursuit"}))
    assert "stopg" not in read_sources([tmp_path / "pursuit.parquet"], ROBOT, pursuit).frame


@pytest.mark.parametrize(
    ("passing", "stopped", "stop"), [(True, False, 0.0), (True, True, 1.0), (False, True, 1.0)]
)
def test_records_say_whether_the_robot_stopped(passing: bool, stopped: bool, stop: float) -> None:
    message = action_performance(
        own_types(), goal=Pose(1.5, 0.5, 0.7), speed=0.0, duration=3.0, code=1
    )
    message.action = "pursue"
    message.call.top = "visit"
    message.call.passing = passing
    message.stopped = stopped
    message.end.robot.position.x = 1.0
    message.end.robot.position.y = 0.5
    episode = episode_of(message, DOMAIN, ROBOT)
    assert episode.situation.goal.values == {"stop": stop}
    assert math.isnan(episode.heading_error) is (stop == 0.0)
    nearer = 0.5 - episode.position_error if stop == 0.0 else math.nan
    assert episode.nearer == pytest.approx(nearer, nan_ok=True)
