"""The ament_python package ator_ros: modules, executables, and the files of the share folder."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "ator_ros"
EXAMPLES = "ator_ros_examples"
DATA_FOLDERS = ("config", "launch", "models", "rviz", "security", "urdf")
EXECUTABLES = {
    "examples": ("drive_to_server", "pursuit_server"),
    "nodes": (
        "simulation",
        "executor",
        "refinement",
        "learning",
        "goal_pose",
        "waypoints",
        "watch",
        "plan_team",
        "team",
    ),
    "tools": (
        "collect",
        "train",
        "evaluate",
        "calibrate",
        "study",
        "demo",
        "view",
        "plan",
    ),
}
DOMAINS = {
    "building": f"{EXAMPLES}.tour:BUILDING",
    "drive": f"{PACKAGE}.domains.drive:DRIVE",
    "patrol": f"{EXAMPLES}.tour:PATROL",
    "pursuit": f"{EXAMPLES}.tour:PURSUIT",
    "soccer": f"{PACKAGE}.domains.soccer.soccer_domain:SOCCER",
    "tour": f"{EXAMPLES}.tour:TOUR",
}
ACTION_SETS = {"soccer.bezier": f"{EXAMPLES}.bezier:ACTIONS"}
STAND_INS = {
    "drive_to": f"{EXAMPLES}.stand_ins:DriveToStandIn",
    "pursue": f"{EXAMPLES}.stand_ins:PursuitStandIn",
    "pursue_through": f"{EXAMPLES}.stand_ins:PursuitThroughStandIn",
}
PLANNERS = {"navfn": f"{EXAMPLES}.stand_ins:navfn"}


def data_files() -> list[tuple[str, list[str]]]:
    """Pair each folder of share/ator_ros with its files.

    Paths are relative, as setuptools wants them.
    """
    pairs = [
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ]
    for top in DATA_FOLDERS:
        for folder in sorted({file.parent for file in Path(top).rglob("*") if file.is_file()}):
            files = sorted(str(file) for file in folder.iterdir() if file.is_file())
            pairs.append((f"share/{PACKAGE}/{folder}", files))
    return pairs


setup(
    name=PACKAGE,
    version="0.2.0",
    description="Refines the subgoals of action chains with performance models learned from "
    "experience",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*", EXAMPLES]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=data_files(),
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            *(
                f"{name} = {PACKAGE}.start:{group}.{name}"
                for group, names in EXECUTABLES.items()
                for name in names
            ),
            f"round = {PACKAGE}.start:tools.round_of_places",  # `learning` has a module round
        ],
        f"{PACKAGE}.domains": [f"{name} = {value}" for name, value in DOMAINS.items()],
        f"{PACKAGE}.action_sets": [f"{name} = {value}" for name, value in ACTION_SETS.items()],
        f"{PACKAGE}.stand_ins": [f"{name} = {value}" for name, value in STAND_INS.items()],
        f"{PACKAGE}.planners": [f"{name} = {value}" for name, value in PLANNERS.items()],
    },
)
