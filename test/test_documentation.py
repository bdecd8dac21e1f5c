"""Every command in the documentation is executed by a test, or listed here with a reason."""

import ast
import functools
import json
import os
import re
import shlex
import shutil
import statistics
import subprocess
import time
from pathlib import Path

import pandas as pd
import pytest
from documentation import PAGES, ROOT, TOOLS, Printed, commands

from ator_ros.experience.table import read_experience
from scripts.reproduce import Sizes, steps
from scripts.tables import PAGES as PAGES_WITH_TABLES
from scripts.tables import write_tables

BIN = ROOT / "install" / "lib" / "ator_ros"
SMALL = {
    "collect": "--episodes 50 --jobs 1",
    "evaluate": "--situations 2 --oracle 2 --out results --jobs 1",
    "demo": "--situations 1 --out demo.png",
}
"""Arguments that shorten a tool's run and keep its results in the working folder."""


_VIEW = "nodes/test_view_node.py"
_ROS = "nodes/test_documented_commands.py"
BY_TEST = {
    r"make demo( ARGS='--animation .*')?": "nodes/test_demo_node.py::test_it_prints_the_gain",
    r"make reproduce( ARGS=.*)?": "test_documentation.py::test_all_results_can_be_reproduced",
    r"(ros2 run ator_ros )?calibrate( .*)?": "nodes/test_calibrate_node.py::test_a_description_is_",
    r"(ros2 run ator_ros )?study .*": "tools/test_tools_study.py::test_a_study_reports_actions_and",
    r"make view|(ros2 run ator_ros )?view": f"{_VIEW}::test_the_page_runs_a_race",
    r"(ros2 run ator_ros )?view --watched": "nodes/test_watch_node.py::test_the_page_finds_",
    r"view --attach --robots ann bob": "nodes/test_view_backend.py::test_two_robots_of_one_simulat",
    r"scripts/run python scripts/golden\.py .*": "golden/test_golden.py::test_the_command_writes_a",
    r"make docs": "test_site.py::test_the_site_is_built_without_warnings",
    r"make setup": "test_documentation.py::test_set_up_has_nothing_to_do",
    r"make clean": "test_documentation.py::test_clean_leaves_the_sources",
    r"\. scripts/env\.sh": "test_environment.py::test_a_second_checkout_replaces_the_first",
    r"scripts/run COMMAND …": "test_environment.py::test_a_command_keeps_its_exit_code",
    r"python scripts/figures\.py": "test_programs.py::test_both_figures_are_drawn",
    r"dask .*|.*--cluster .*": "test_documentation.py::test_a_cluster_collects",
    r".*examples/call\.py( /reset .*)?": "nodes/test_call_example.py::test_a_service_is_",
    r"ros2 (service|action) \w+": "nodes/test_call_example.py::test_a_service_is_",
    r"make run EXE=\w+ .*my_config.*": f"{_ROS}::test_a_copy_of_the_configuration_is_used",
    r"make run EXE=(simulation|executor|refinement)( .*factor.*)?": f"{_ROS}::test_nodes_run_witho",
    r"ros2 service call /(refine_subgoal|reset|place_ball) .*": f"{_ROS}::test_the_printed_request",
    r"ros2 service call /plan_chains .*": f"{_ROS}::test_the_printed_requests",
    r"ros2 action send_goal --feedback .*": f"{_ROS}::test_the_printed_requests",
    r"ros2 run ator_ros plan_team": "nodes/test_plan_team_node.py::test_the_printed_round_is_",
    r"ros2 action send_goal -f /plan_team .*": "nodes/test_plan_team_node.py::test_the_printed_rou",
    r"ros2 action send_goal /(ann|bob)/.*": f"{_ROS}::test_two_robots_drive_at_the_same_time",
    r"ros2 run ator_ros simulation .*robots:=.*": f"{_ROS}::test_two_robots_drive_at_the_same_time",
    r"ros2 run ator_ros \w+ .*__ns:=/(ann|bob) .*": f"{_ROS}::test_two_robots_drive_at_the_same_ti",
    r"ros2 topic echo .*/performance/(action|chain) .*": f"{_ROS}::test_the_printed_requests",
    r"ros2 launch ator_ros .*real_time_factor.*": f"{_ROS}::test_the_printed_requests",
    r"ros2 launch ator_ros nav2\.launch\.xml": "test_nav2_launch.py::test_it_starts_our_nodes_in",
    r"ros2 launch ator_ros .*learning:=.*": "test_launch_file.py::test_it_starts_the_nodes_in_one_",
    r"(cp -rL|ros2 launch ator_ros) .*my_config": f"{_ROS}::test_a_copy_of_the_configuration_is_us",
    r"cd ~/ws && git clone .*": f"{_ROS}::test_a_workspace_is_built",
    r"colcon build --base-paths .*": f"{_ROS}::test_a_workspace_is_built",
    r"\. install/setup\.sh && .*": f"{_ROS}::test_a_workspace_is_built",
    r"(scripts/run python -m )?colcon build": f"{_ROS}::test_a_checkout_is_built_by_hand",
    r"export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET": "nodes/test_network.py::test_user_settings_are",
    r"ros2 run ator_ros \w+ .*nav2\.yaml.*": "nodes/test_nav2_files.py::test_nodes_start",
    r"ros2 service call /predict_durations .*": "nodes/test_rounds_page.py::test_a_round_is_",
    r"ros2 run ator_ros \w+ .*domain:=drive.*": "nodes/test_rounds_page.py::test_a_round_is_",
    r"ros2 run ator_ros waypoints .*": "nodes/test_waypoints_node.py::test_waypoints_are_followed_",
    r"(ros2 run ator_ros )?collect .*--attach.*": "nodes/test_attached.py::test_drives_are_kept_on",
    r"ros2 run ator_ros train .*--planner .*": "nodes/test_path_planner.py::test_models_are_learne",
    r"ros2 action send_goal -f /execute_chain .*x: 4.*": "domains/test_remote_documentation.py::te",
    r"ros2 action send_goal -f /execute_chain .*": "nodes/test_own_server.py::test_own_",
    r"ros2 run .* domain:=building": "nodes/test_map_node.py::test_a_tour_of_the_",
    r"ros2 run ator_ros learning": "nodes/test_learning_node.py::test_learning_can_be_frozen",
    r"scripts/run pip install .* \./my_package": "nodes/test_outside_domain.py::test_a_domain_from",
    r"scripts/run python scripts/team_rounds\.py .*": "test_programs.py::test_divisions_of_a_",
    r"scripts/run python scripts/team_roles\.py .*": "test_programs.py::test_choices_of_a_robot_",
    r"make demo ARGS='--team .*'|demo --team": "nodes/test_demo_node.py::test_a_team_plays_",
    r"ros2 launch ator_ros team(mate)?\.launch\.xml.*": "test_team_launch.py::test_nodes_are_inst",
    r".* examples/paper_in_one_file\.py": "test_paper_in_one_file.py::test_it_prints_",
    r".* examples/plan_with_durations\.py": "test_programs.py::test_durations_are_predicted_",
    r"python3 examples/behavior_tree\.py": "nodes/test_behavior_tree.py::test_the_example_drives_",
    r".* examples/plan_and_execute\.py .*": "nodes/test_client_example.py::test_the_exa",
    r".* examples/refine_and_execute\.py": "nodes/test_client_example.py::test_it_drives_the_",
    r"make run EXE=\w+ ARGS='.*/ws/src/shuttle/.*'": "nodes/test_own_server.py::test_own_",
    r"scripts/run python ~/ws/src/shuttle/server\.py": "nodes/test_own_server.py::test_own_",
    r"ros2 run ator_ros train rosbag2_.*": "nodes/test_recording_node.py::test_the_installed_train",
}
"""Commands, as regular expressions, and the test that executes them, perhaps shortened."""

NOT_HERE = {
    r"make (test|test-long|lint|format|test-apt-versions)": "runs these tests and checks",
    r"scripts/run python -m colcon test": "runs these tests themselves",
    r"make setup PYTHON=python3\.12": "compiles pybullet, nine minutes, over this very environment",
    r"(sudo )?apt install .*|rosdep install .*|export PIP_BREAK_.*": "changes the system",
    r"python3 -m pip install --user .*|pip install distributed": "changes the user's packages",
    r"python3 scripts/lock\.py": "asks the package registry for every version again",
    r"ros2 run ator_ros NAME ARGS|make run EXE=\w+ ARGS='(ARGS|…)'": "shows the form of others",
    r"mkdir -p ~/ws/src .*|cd ~/ws && ~/ator_ros/.*|\. ~/ws/install/.*": "see test_environment.py",
    r"ros2 action info -t": "ros2cli is not among the wheels",
    r"ros2 bag (record|play)( .*)?": "rosbag2 is not among the wheels; see test_recording_node.py",
    r"(ros2 security .*|ros2 security|keystore=.*|policy=.*|for node in .*|done)": "needs SROS2",
    r"export ROS_SECURITY_.*|ros2 run .* --enclave .*": "needs Fast DDS with the security plugins",
    r"ros2 launch ator_ros ator\.launch\.xml (view|rviz):=true": "see test_launch_file.py",
    r"ros2 (run|launch)( ator_ros …)?|python -m": "a name in a sentence",
}
"""Commands, as regular expressions, that no test executes, and why."""


@functools.cache
def reproduced() -> list[set[str]]:
    """Return the words of each command of scripts/reproduce.py, with paths reduced to names."""
    return [{Path(word).name for word in step.command.split()} for step in steps(Sizes())]


def is_reproduced(text: str) -> bool:
    """Return whether a command, possibly abbreviated with `…`, is in scripts/reproduce.py."""
    text = text.removeprefix("scripts/run ")
    words = {Path(word).name for word in text.split() if word != "…" and not word.isupper()}
    return len(words) > 1 and any(words <= line for line in reproduced())


def tool_words(text: str) -> list[str] | None:
    """Return the words of a command of a tool, the tool first; None for other commands."""
    text = text.removeprefix("ros2 run ator_ros ")
    if found := re.fullmatch(r"make run EXE=(\w+)(?: ARGS='(.*)')?", text):
        text = " ".join(word for word in found.groups() if word)
    words = shlex.split(text)
    return words if words[0] in TOOLS else None


@functools.cache
def runnable() -> list[str]:
    """Return the tool commands to execute as printed, with `SMALL` words."""
    found = set()
    for printed in commands():
        named = " " not in printed.text  # a tool's name in a sentence
        named |= re.fullmatch(r"\w+( --[\w-]+)+", printed.text) is not None
        other = any(re.fullmatch(key, printed.text) for key in BY_TEST)
        if tool_words(printed.text) and not (named or other or "…" in printed.text):
            found.add(printed.text)
    return sorted(found)


def coverage_of(printed: Printed) -> list[str]:
    """Return how a command is executed, or why not; empty if it is not covered."""
    found = [how for key, how in (BY_TEST | NOT_HERE).items() if re.fullmatch(key, printed.text)]
    found += ["scripts/reproduce.py"] * is_reproduced(printed.text)
    found += ["test_a_printed_tool_runs"] * (printed.text in runnable())
    found += ["a name in a sentence"] * (printed.text in TOOLS)
    return found


@pytest.mark.parametrize(
    "printed", commands(), ids=lambda printed: f"{printed.page}: {printed.text[:60]}"
)
def test_a_printed_command_is_covered(printed: Printed) -> None:
    assert coverage_of(printed), f"{printed.page}: no test executes {printed.text!r}"


def test_the_lists_of_commands_are_valid() -> None:
    texts = [printed.text for printed in commands()]
    unused = [
        key for key in BY_TEST | NOT_HERE if not any(re.fullmatch(key, text) for text in texts)
    ]
    assert not unused
    for test in BY_TEST.values():
        file, _, name = test.partition("::")
        assert f"def {name}" in (ROOT / "test" / file).read_text(encoding="utf-8"), test


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files of the printed commands."""
    folder = tmp_path_factory.mktemp("workshop")
    (folder / "EMPTY").mkdir()
    shutil.copytree(ROOT / "models", folder / "models")
    for name in ("config", "my_config"):
        shutil.copytree(ROOT / "config", folder / name)
    for seed, name in (("101", "experience"), ("211", "fresh")):
        run(["collect", "--seed", seed, "--episodes", "50", "--out", f"{name}.parquet"], folder)
    run(["train", "experience.parquet", "--models", "my_models"], folder)
    policies = ["--policies", "naive", "refined", "refined_speed"]
    run(["evaluate", "--situations", "24", *policies, "--out", "results", "--jobs", "1"], folder)
    return folder


def run(words: list[str], cwd: Path) -> None:
    done = subprocess.run(
        [str(BIN / words[0]), *words[1:]],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
    assert done.returncode == 0, f"{shlex.join(words)}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
    assert "Traceback" not in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("text", runnable())
def test_a_printed_tool_runs(text: str, workshop: Path) -> None:
    words = tool_words(text)
    tool, *others = words
    small = SMALL.get(tool, "").split()
    run([tool, *others, *small], workshop)


def make(*words: str, cwd: Path = ROOT, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["make", "--no-print-directory", *words],
        cwd=cwd,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.long
def test_all_results_can_be_reproduced(tmp_path: Path) -> None:
    """Run scripts/reproduce.py at a small size; it writes what ships, and resumes."""
    words = f"ARGS=--small --out {tmp_path}"
    done = make("reproduce", words)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    made = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()}
    folders = [ROOT / "models", *(ROOT / "docs").glob("evaluation*"), ROOT / "docs" / "studies"]
    shipped = {
        file.relative_to(ROOT).as_posix() for folder in folders for file in folder.rglob("*.*")
    }
    assert shipped | {"docs/figure6.svg", "docs/figure6_bezier.svg"} <= made
    again = make("reproduce", words)
    assert again.returncode == 0
    assert " done in " not in again.stdout


@pytest.mark.long
def test_a_cluster_collects(tmp_path: Path) -> None:
    """Run the printed commands of a scheduler, a worker and `collect` on this machine."""
    texts = [printed.text for printed in commands()]
    (scheduler,) = [text for text in texts if text.startswith("dask scheduler")]
    (worker,) = [text for text in texts if text.startswith("dask worker")]
    (collect,) = [text for text in texts if "--cluster tcp:" in text]
    here = "--host 127.0.0.1 --no-dashboard"
    started = [
        subprocess.Popen(
            f"{scheduler} {here} --port 0 --scheduler-file s.json".split(), cwd=tmp_path
        )
    ]
    try:
        while not (file := tmp_path / "s.json").is_file() or not file.read_text(encoding="utf-8"):
            assert started[0].poll() is None
            time.sleep(0.1)
        address = json.loads(file.read_text(encoding="utf-8"))["address"]
        words = f"{worker} {here}".replace("tcp://host:8786", address).replace("auto", "1").split()
        started.append(subprocess.Popen(words, cwd=tmp_path))
        words = tool_words(collect.replace("tcp://host:8786", address)) or []
        run([*words, "--episodes", "1"], tmp_path)
        run([words[0], "--jobs", "1", "--episodes", "1", "--out", "alone.parquet"], tmp_path)
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()
    tables = (
        read_experience(tmp_path / f"{name}.parquet").frame for name in ("experience", "alone")
    )
    pd.testing.assert_frame_equal(*tables, check_exact=True)


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_on_a_page_lead_to_files_and_headings(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" not in link:
            name, _, anchor = link.partition("#")
            target = (page.parent / name).resolve() if name else page
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_is_short_and_in_the_index(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("<!--")]
    assert len(lines) <= 150
    not_prose = ("    ", "   |", "|", "![")
    assert [line for line in lines if len(line) > 100 and not line.startswith(not_prose)] == []
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    assert page.parent != ROOT / "docs" or page.name == "README.md" or f"({page.name})" in index


def test_tables_are_those_of_the_reports(tmp_path: Path) -> None:
    for page in PAGES_WITH_TABLES:
        (tmp_path / page).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / page, tmp_path / page)
    write_tables(tmp_path, ROOT / "docs")
    for page in PAGES_WITH_TABLES:
        written = (tmp_path / page).read_text(encoding="utf-8")
        assert written == (ROOT / page).read_text(encoding="utf-8"), "run scripts/tables.py"
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert set(re.findall(r"begin (evaluation\w*)", results)) == {
        folder.name for folder in (ROOT / "docs").glob("evaluation*")
    }


def test_the_predicted_times_of_the_readme_agree_with_the_report() -> None:
    file = ROOT / "docs" / "evaluation_tour" / "evaluation.json"
    policies = json.loads(file.read_text(encoding="utf-8"))["runs"]["policies"]

    def means(policy: str) -> list[float]:
        return [statistics.fmean(policies[policy][name]) for name in ("predicted", "duration")]

    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    predicted, driven = re.findall(r"take (\S+) s and took (\S+) s, on average of", readme)[0]
    assert [float(predicted), float(driven)] == pytest.approx(means("refined"), abs=0.006)
    formulas = re.findall(r"formulas predict (\S+) s for its (\S+) s", readme)[0]
    assert list(map(float, formulas)) == pytest.approx(means("analytic"), abs=0.06)


def test_the_layout_names_every_folder_and_its_files() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## The layout")[2]
    package = ROOT / "ator_ros"
    folders = {folder.name for folder in package.iterdir() if any(folder.glob("*.py"))}
    rows = re.findall(r"^\| (.*?) \| (.*) \|$", text, flags=re.MULTILINE)
    assert folders == {name for row in rows for name in re.findall(r"`(\w+)/`", row[0])}
    files = {name for row in rows for name in re.findall(r"`(\w+/[\w/]+\.py)`", row[1])}
    assert len(files) >= 10
    assert [name for name in files if not (package / name).is_file()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_source_files_named_on_a_page_exist(page: Path) -> None:
    names = ("ator_ros", "ator_ros_examples", "test", "benchmarks", "scripts")
    folders = (ROOT / name for name in names)
    paths = [f"/{file.relative_to(ROOT)}" for folder in folders for file in folder.rglob("*.py")]
    named = re.findall(r"`((?:[\w.]+/)*\w+\.py)", page.read_text(encoding="utf-8"))
    assert [name for name in named if not any(path.endswith(f"/{name}") for path in paths)] == []


EXAMPLES = (
    *("odom", "tf", "base_link", "cmd_vel", "map", "/map", "view", "messages", "round.json"),
    *("twist.linear", "latency", "speed", "limits.v", "v", "m", "time", "calibrate", "my_robot"),
    *("the ball", "ball", "the base", "moves", "move", "drives", "dribbleBall", "visit", "reach"),
    *("NO_VALID_PATH", "ComputePathToPose", "error_code", "aborted", "kept naive", "follow_path"),
)
"""Values in the messages of docs/errors.md; so are numbers, quoted names, and what `…` omits."""


def texts_of(file: Path) -> list[str]:
    """Return the texts in a source file, of messages with values the parts between the values."""
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    constants = (node for node in nodes if isinstance(node, ast.Constant))
    values = (node.value for node in constants if id(node) not in docstrings)
    return [value for value in values if isinstance(value, str)]


def test_the_listed_messages_are_in_the_sources() -> None:
    names = "|".join(rf"(?<!\w){re.escape(name)}(?!\w)" for name in EXAMPLES)
    value = re.compile(rf"…|'\w+'|\S*\d\S*|{names}")
    texts = "\n".join(text for file in (ROOT / "ator_ros").rglob("*.py") for text in texts_of(file))
    page = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (.*?) \|", page, flags=re.MULTILINE)
    messages = [
        message
        for cell in cells
        if "(of ROS" not in cell
        for message in re.findall(r"`([^`]+)`", cell)
    ]
    assert len(messages) > 50
    parts = [
        (part.strip(" :;,()"), message) for message in messages for part in value.split(message)
    ]
    assert [message for part, message in parts if len(part) > 2 and part not in texts] == []


@pytest.mark.long
def test_set_up_has_nothing_to_do() -> None:
    done = make("setup")
    assert (done.returncode, done.stdout) == (0, ""), done.stderr


@pytest.mark.long
def test_clean_leaves_the_sources(tmp_path: Path) -> None:
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in (".venv/lib", "build", "install", "log", "ator_ros/__pycache__"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "ator_ros" / "world.py").touch()
    assert make("clean", cwd=tmp_path).returncode == 0
    assert {path.name for path in tmp_path.rglob("*")} == {"Makefile", "ator_ros", "world.py"}
