"""Time a learner and measure its errors; needs numpy alone, so that it runs in any environment.

As a program, ``python peer_program.py LEARNER TABLE.npz RESULT.json`` measures a peer in its own environment.
"""

import argparse
import importlib
import importlib.metadata
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

CANDIDATES = 360
"""How many candidates a refinement predicts at once: one for each degree of the approach."""
_QUICK = 3.0
_REPEATS = 5


def measure(learner: Any, data: Mapping[str, Any], **fit_options: Any) -> dict[str, Any]:
    """Fit a learner and predict the rows that were held out.

    Parameters
    ----------
    learner : object
        With ``fit(X, y)`` and ``predict(X)``.
    data : mapping
        Arrays ``X``, ``y``, ``test_X``, ``test_y``, of shapes (n, k), (n,), (m, k) and (m,).
    **fit_options
        For ``fit``.

    Returns
    -------
    dict
        ``fit_s`` (median of several if it is quick), ``predict_ms`` (of 360 rows, median), ``rmse_s`` and
        ``mae_s``.
    """
    times: list[float] = []
    while not times or (times[-1] < _QUICK and len(times) < _REPEATS):
        start = time.perf_counter()
        learner.fit(data["X"], data["y"], **fit_options)
        times.append(time.perf_counter() - start)
    error = np.asarray(learner.predict(data["test_X"])).ravel() - data["test_y"]
    return {
        "fit_s": float(np.median(times)),
        "predict_ms": predict_ms(learner.predict, data),
        "rmse_s": float(np.sqrt(np.mean(error**2))),
        "mae_s": float(np.mean(np.abs(error))),
    }


def predict_ms(function: Any, data: Mapping[str, Any], repeats: int = 21) -> float:
    """Return the median time in ms of predicting 360 rows, after a call that doesn't count."""
    candidates = np.ascontiguousarray(data["test_X"][:CANDIDATES])
    function(candidates)
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function(candidates)
        times.append(time.perf_counter() - start)
    return 1000.0 * float(np.median(times))


def peer(name: str) -> tuple[Any, str]:
    """Return a peer that is installed here and its version."""
    # Imported by name: they are absent from the environment that is checked and tested.
    if name == "m5py":
        return importlib.import_module("m5py").M5Prime(), importlib.metadata.version("m5py")
    line = importlib.import_module("sklearn.linear_model").LinearRegression()
    # Its default depth of 5 leaves 32 leaves at most; this gives it as many as the others have.
    tree = importlib.import_module("lineartree").LinearTreeRegressor(line, max_depth=8)
    return tree, importlib.metadata.version("linear-tree")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("learner", choices=["m5py", "linear-tree"])
    parser.add_argument("table", type=Path)
    parser.add_argument("result", type=Path)
    options = parser.parse_args()
    with np.load(options.table, allow_pickle=False) as table:
        data = {name: table[name] for name in table.files}
    learner, version = peer(options.learner)
    result = {**measure(learner, data), "version": version}
    options.result.write_text(json.dumps(result), encoding="utf-8")


if __name__ == "__main__":
    main()
