"""Paths of drives as routes: kept in a file, also if a process is killed while it writes."""

from pathlib import Path

import numpy as np
import pytest

from ator_ros.experience.watched_paths import PATHS, WatchedPaths
from ator_ros.files import DamagedFileError

BEND = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0)])
ENDS = (0.0, 0.0), (3.0, 2.0)


def test_a_path_is_kept_with_its_ends_and_its_length(tmp_path: Path) -> None:
    WatchedPaths(tmp_path / PATHS).save(*ENDS, BEND)
    found = WatchedPaths(tmp_path / PATHS)(*ENDS)
    assert found is not None
    assert found[[0, -1]] == pytest.approx(BEND[[0, -1]])
    assert np.hypot(*np.diff(found, axis=0).T).sum() == pytest.approx(5.0, abs=0.01)


def test_other_places_have_no_path() -> None:
    paths = WatchedPaths()
    paths.add(*ENDS, BEND)
    assert paths((0.0, 0.0), (3.0, 2.6)) is None
    assert paths(*reversed(ENDS)) is None


def test_near_places_have_the_newest_path_between_them() -> None:
    paths = WatchedPaths()
    paths.add(*ENDS, BEND)
    paths.add((0.1, 0.0), (3.0, 2.0), BEND[[0, 2]])
    for start, length in (((0.0, 0.0), 5.0), ((0.05, 0.0), np.hypot(3.0, 2.0))):
        found = paths(start, (3.0, 2.0))
        assert found is not None
        assert np.hypot(*np.diff(found, axis=0).T).sum() == pytest.approx(length, abs=0.01)


def test_the_newest_path_counts(tmp_path: Path) -> None:
    paths = WatchedPaths(tmp_path / PATHS)
    for path in (BEND, BEND[[0, 2]]):
        paths.save(*ENDS, path)
    found = WatchedPaths(tmp_path / PATHS)(*ENDS)
    assert found is not None
    assert np.hypot(*np.diff(found, axis=0).T).sum() == pytest.approx(np.hypot(3.0, 2.0), abs=0.01)


def test_a_line_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / PATHS
    for goal in ((1.0, 0.0), (2.0, 0.0)):
        WatchedPaths(file).save((0.0, 0.0), goal, np.array([(0.0, 0.0), goal]))
    file.write_bytes(file.read_bytes()[:-20])
    assert len(WatchedPaths(file)) == 1


@pytest.mark.parametrize("line", ["{}", "no json", '{"ends":[0,0,1],"path":[[0,0],[1,0]]}',
                                  '{"ends":[0,0,1,0],"path":[[0,0]]}'])  # fmt: skip
def test_a_damaged_file_is_refused(tmp_path: Path, line: str) -> None:
    (tmp_path / PATHS).write_text(f"{line}\n", encoding="utf-8")
    with pytest.raises(DamagedFileError, match="line 1: expected a path"):
        WatchedPaths(tmp_path / PATHS)
