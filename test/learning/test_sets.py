"""Sets of models on disk: names, digests, which are kept."""

from pathlib import Path

import pytest

from ator_ros.files import DamagedFileError, FileError
from ator_ros.learning.sets import (
    CURRENT,
    KEPT,
    MANIFEST,
    Manifest,
    current_set,
    digest_of,
    digest_of_start,
    new_set_folder,
    point_to,
    publish,
    read_manifest,
    remove_old,
    repair,
    seal,
    sets_in,
)

TIME = "2026-01-31T12:00:00Z"


def published(folder: Path, content: str) -> Path:
    made = new_set_folder(folder)
    (made / "goToPose.json").write_text(content)
    seal(made, Manifest("", TIME, {"default/goToPose": 5}, {"default/goToPose": 4}, {}))
    return publish(folder, made)


def test_a_published_set_is_in_use(tmp_path: Path) -> None:
    assert current_set(tmp_path) is None
    first = published(tmp_path, "1")
    assert current_set(tmp_path) == first
    second = published(tmp_path, "2")
    assert current_set(tmp_path) == second
    assert sets_in(tmp_path) == [first, second]
    assert [each.name.partition("-")[0] for each in (first, second)] == ["000001", "000002"]
    assert (tmp_path / CURRENT).is_symlink()
    assert not list((tmp_path / "sets").glob(".new-*"))
    manifest = read_manifest(second)
    assert manifest.digest == second.name.partition("-")[2] == digest_of(second)
    assert (manifest.time, manifest.seen) == (TIME, {"default/goToPose": 4})


def test_a_digest_depends_on_names_and_contents(tmp_path: Path) -> None:
    digests = set()
    for name, content in (("a", "1"), ("a", "2"), ("b", "1"), ("sub/a", "1")):
        folder = tmp_path / f"{len(digests)}"
        file = folder / f"{name}.json"
        file.parent.mkdir(parents=True)
        file.write_text(content)
        (folder / "other.txt").write_text(content)
        digests.add(digest_of(folder))
        assert digest_of(folder) == digest_of(folder, [file])
        assert len(digest_of(folder)) == 16
    assert len(digests) == 4


def test_the_digest_of_the_start_is_that_of_the_models_of_all_action_sets(tmp_path: Path) -> None:
    (tmp_path / "bezier").mkdir()
    (tmp_path / "goToPose.json").write_text("1")
    one = digest_of_start(tmp_path, ["default", "bezier"])
    (tmp_path / "bezier" / "goToPose.json").write_text("1")
    both = digest_of_start(tmp_path, ["default", "bezier"])
    assert one == digest_of_start(tmp_path, ["default"])
    assert len({one, both}) == 2
    (tmp_path / "bezier" / "broken.json").symlink_to("nowhere")
    assert digest_of_start(tmp_path, ["default", "bezier"]) == ""


def test_the_newest_sets_and_the_one_in_use_are_kept(tmp_path: Path) -> None:
    sets = [published(tmp_path, str(number)) for number in range(KEPT + 3)]
    point_to(tmp_path, sets[0])
    unfinished = new_set_folder(tmp_path)
    remove_old(tmp_path)
    assert sets_in(tmp_path) == [sets[0], *sets[3:]]
    assert not unfinished.exists()
    assert current_set(tmp_path) == sets[0]


def test_a_changed_set_is_damaged(tmp_path: Path) -> None:
    first = published(tmp_path, "1")
    second = published(tmp_path, "2")
    assert repair(tmp_path) == ""
    (second / "goToPose.json").write_text("3")
    with pytest.raises(DamagedFileError, match="expected files with the digest"):
        read_manifest(second)
    assert repair(tmp_path).endswith(f"renamed to {second.name}.damaged; {first.name} is used")
    assert current_set(tmp_path) == first
    (first / MANIFEST).unlink()
    with pytest.raises(DamagedFileError, match="there is none"):
        read_manifest(first)
    assert repair(tmp_path).endswith("the models of the start are used")
    assert current_set(tmp_path) is None
    assert repair(tmp_path) == ""


def test_a_damaged_set_is_not_published(tmp_path: Path) -> None:
    first = published(tmp_path, "1")
    made = new_set_folder(tmp_path)
    seal(made, Manifest("", TIME, {}, {}, {}))
    (made / "more.json").write_text("1")
    with pytest.raises(FileError):
        publish(tmp_path, made)
    assert current_set(tmp_path) == first


def test_a_new_folder_is_empty(tmp_path: Path) -> None:
    made = new_set_folder(tmp_path)
    (made / "old.json").write_text("1")
    assert list(new_set_folder(tmp_path).iterdir()) == []
