"""Peers that don't run in our environment: Weka, and the packages that need an old scikit-learn."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.schema import SchemaError, structured
from ator_ros.tools.benchmarks import peer_program
from ator_ros.tools.benchmarks.rows import MeasuredLearner

PACKAGES = (
    "linear-tree==0.3.5",
    "m5py==0.3.3",
    "numpy==1.26.4",
    "packaging==26.3",
    "scikit-learn==1.3.2",
    "scipy==1.11.4",
)
"""They fail with today's scikit-learn."""
WEKA_JAR = Path("/usr/share/java/weka.jar")
TIMEOUT = 900.0
"""s that a peer may take."""


class NotRunError(RuntimeError):
    """A peer could not run; the message says why in one line, for the table."""


def python_of(folder: Path) -> Path:
    """Return the Python of the peers' own environment in `folder`, made if need be.

    Raises
    ------
    NotRunError
        It can't be made.
    """
    python, stamp = folder / "bin" / "python", folder / "stamp"
    wanted = "\n".join((*PACKAGES, sys.version))
    if not stamp.is_file() or stamp.read_text(encoding="utf-8") != wanted:
        # Not of a virtual environment itself: a copy of one would be found to be broken.
        base = getattr(sys, "_base_executable", sys.executable)
        _run([base, "-m", "venv", "--clear", str(folder)], "making the peers' environment")
        pip = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--retries", "1"]
        _run([*pip, *PACKAGES], "installing the peers' packages")
        stamp.write_text(wanted, encoding="utf-8")
    return python


def run_package(name: str, python: Path, table: Path, work: Path) -> MeasuredLearner:
    """Measure a learner of `peer_program` in its own environment; `table` is the npz file of the rows.

    Raises
    ------
    NotRunError
        It fails, or what it measures is no number.
    """
    result = work / f"{name}.json"
    _run([str(python), str(Path(peer_program.__file__)), name, str(table), str(result)], name)
    try:
        return structured(json.loads(result.read_text(encoding="utf-8")), MeasuredLearner)
    except SchemaError as error:
        raise NotRunError(f"{name}: {error}") from error


def run_weka(data: Mapping[str, FloatArray], names: Sequence[str], work: Path) -> MeasuredLearner:
    """Measure Weka's M5P with its defaults, from the command line.

    It tells the time to build the model by itself, so that starting Java and reading files doesn't count; its
    errors have four digits. The time of 360 predictions can't be had from outside.

    Raises
    ------
    NotRunError
        Java or Weka isn't installed, or it fails.
    """
    if shutil.which("java") is None or not WEKA_JAR.is_file():
        raise NotRunError(f"expected java and {WEKA_JAR}: install Debian's package weka")
    files = {"-t": ("X", "y"), "-T": ("test_X", "test_y")}
    words = ["java", "-Xmx2g", "-cp", str(WEKA_JAR), "weka.classifiers.trees.M5P", "-no-cv"]
    for option, (features, target) in files.items():
        path = work / f"weka{option}.arff"
        _write_arff(path, np.column_stack([data[features], data[target]]), names)
        words += [option, str(path)]
    text = _run(words, "Weka")
    on_test = text[text.find("=== Error on test data") :]
    return MeasuredLearner(
        fit_s=_number(text, r"Time taken to build model: *([\d.]+) seconds"),
        rmse_s=_number(on_test, r"Root mean squared error *([\d.]+)"),
        mae_s=_number(on_test, r"Mean absolute error *([\d.]+)"),
        leaves=int(_number(text, r"Number of Rules *: *(\d+)")),
        version=_weka_version(),
    )


def _weka_version() -> str:
    match = re.search(r"weka-([\d.]+)\.jar", WEKA_JAR.resolve().name)
    return match.group(1) if match else "unknown"


def _write_arff(path: Path, table: FloatArray, names: Sequence[str]) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.write("@relation rows\n")
        file.writelines(f"@attribute {name} numeric\n" for name in (*names, "time_to_go"))
        file.write("@data\n")
        np.savetxt(file, table, delimiter=",", fmt="%.9g")


def _number(text: str, pattern: str) -> float:
    match = re.search(pattern, text)
    if match is None:
        raise NotRunError(f"expected {pattern!r} in what Weka printed, got: {text[-300:]!r}")
    return float(match.group(1))


def _run(words: Sequence[str], what: str) -> str:
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    except subprocess.TimeoutExpired as error:
        raise NotRunError(f"{what} took more than {TIMEOUT:g} s") from error
    except OSError as error:
        raise NotRunError(f"{what}: {error}") from error
    if done.returncode:
        lines = (done.stderr or done.stdout).strip().splitlines()
        said = lines[-1] if lines else "no message"
        raise NotRunError(f"{what} failed with code {done.returncode}: {said}")
    return done.stdout
