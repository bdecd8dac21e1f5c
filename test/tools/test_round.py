"""The tool `round`: order, headings and predicted times of a list of places."""

import math
from pathlib import Path

import pytest
from maps import hall_map

from ator_ros.tools.round_of_places import main
from ator_ros.world.grid_map import save_map

IN_LINE = ("--place", "2", "0", "--place", "3", "0", "1.57", "--domain", "drive")


def test_places_in_a_line_are_visited_along_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = tmp_path / "places.yaml"
    places.write_text("- [1.0, 0.0]\n")
    picture = tmp_path / "round.png"
    words = (*IN_LINE, "--places", str(places), "--picture", str(picture))
    assert main(words) == 0
    _, *lines, whole, _ = capsys.readouterr().out.splitlines()
    rows = [line.split() for line in lines]
    assert [row[0] for row in rows] == ["3", "1", "2"]
    assert [row[3] for row in rows][-1] == "90°"
    total = sum(float(row[4]) for row in rows)
    assert float(whole.split()[0]) == pytest.approx(total, abs=0.2)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_ends_of_a_round_can_be_fixed(capsys: pytest.CaptureFixture[str]) -> None:
    def order(*words: str) -> list[str]:
        assert main((*IN_LINE, "--place", "1", "0", *words)) == 0
        return [line.split()[0] for line in capsys.readouterr().out.splitlines()[1:-1]]

    assert order("--as-listed") == ["1", "2", "3"]
    assert order("--keep-last")[-1] == "3"
    assert order("--return-home")[-1] == "home"


def test_places_may_be_passed_and_headings_limited(capsys: pytest.CaptureFixture[str]) -> None:
    assert main((*IN_LINE, "--place", "1", "0", "--headings", "1.0", "1.2")) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:-1]]
    limits = [math.degrees(1.0) - 0.5, math.degrees(1.2) + 0.5]
    assert all(limits[0] <= float(row[3].strip("°")) <= limits[1] for row in rows[:-1])
    words = ("--domain", "patrol", "--passing", "--as-listed")
    assert main((*words, "--place", "1", "0", "--place", "2", "0")) == 0
    headings = [line.split()[3] for line in capsys.readouterr().out.splitlines()[1:3]]
    assert headings[0] == "passed"
    assert headings[1] != "passed"


def test_a_domain_without_drives_has_a_round_by_path_times(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = [word for x in (3.0, -3.0, 2.0) for word in ("--place", str(x), "1")]
    assert main(("--domain", "pursuit", *words)) == 0
    printed = capsys.readouterr()
    assert printed.err == "path times of pursue, as no drives are known yet\n"
    assert "s as listed, naive headings" in printed.out


def test_unusable_places_are_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for words, reason in (
        ((), "expected 1 to 99 places, got 0"),
        (("--place", "1"), "place 1: expected X Y or X Y YAW, got 1 values"),
        (("--place", "1", "x"), "place 1: "),
    ):
        assert main((*words, "--domain", "drive")) == 1
        refused = capsys.readouterr().err
        assert reason in refused


def test_a_place_in_a_wall_of_the_map_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_map(hall_map(), tmp_path)
    words = ("--domain", "drive", "--map", str(tmp_path / "map.yaml"), "--at", "-3", "0", "0")
    assert main((*words, "--place", "3", "0", "--place", "0", "0")) == 1
    assert "round.calls[1].goal (goToPose): expected a place in" in capsys.readouterr().err
