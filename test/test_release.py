"""The files of a release agree: versions, changelogs, dependencies."""

import re
from importlib.metadata import version
from pathlib import Path

import yaml
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package

import ator_ros

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (ROOT, ROOT / "ator_interfaces")
KEYS = {"pillow": "pil", "pyyaml": "yaml", "scikit-learn": "sklearn"}


def test_all_files_have_the_same_version() -> None:
    found = {f"package {folder.name}": parse_package(str(folder)).version for folder in FOLDERS}
    for folder in FOLDERS:
        changelog = get_changelog_from_path(str(folder / "CHANGELOG.rst"))
        newest, date, _ = next(iter(changelog.foreach_version()))
        assert date is not None
        found[f"changelog of {folder.name}"] = newest
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    found |= {"citation": citation["version"], "installed": version("ator_ros")}
    assert set(found.values()) == {ator_ros.__version__}, found


def test_packages_have_what_bloom_asks_for() -> None:
    for folder in FOLDERS:
        package = parse_package(str(folder))
        assert [(folder / item.file).is_file() for item in package.licenses] == [True]
        assert package.maintainers
        assert package.urls
        depends = (*package.build_depends, *package.exec_depends, *package.test_depends)
        assert [item.name for item in depends if item.name.endswith("-pip")] == []


def test_what_is_imported_comes_from_rosdep_or_the_printed_pip_line() -> None:
    keys = {item.name for item in parse_package(str(ROOT)).exec_depends}
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    by_pip = " ".join(
        re.findall(r"^    python3 -m pip install --user (.*)$", page, re.MULTILINE)
    ).split()
    pins = (ROOT / "requirements" / "runtime.txt").read_text(encoding="utf-8")
    names = [name.lower() for name in re.findall(r"^([\w-]+)==", pins, re.MULTILINE)]
    assert [name for name in names if f"python3-{KEYS.get(name, name)}" not in keys] == [
        "numba",
        "pybullet",
    ]
    assert {"numba", "pybullet"} <= set(by_pip)
