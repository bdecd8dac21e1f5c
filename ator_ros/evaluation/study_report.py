"""The report of `study`: the gain of each open variable, and the page of all results."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from ator_ros.domains.trials import Trial, open_speeds, reopened
from ator_ros.evaluation.report import Part, page, policy_table
from ator_ros.evaluation.toolset import Toolset
from ator_ros.refinement.refiner import Refinement

NO_EFFECT = 0.02
"""Predicted gain in s up to which a variable counts as having no effect.

It is less than half a control period.
"""


def open_variables(tools: Toolset, trials: Iterable[Trial]) -> list[dict[str, Any]]:
    """Refine each open variable alone, with arrival speeds open too, and explain the result.

    Returns
    -------
    list of dict
        For each variable its "step", from 1, and "top", its "name"; "free": share of the situations
        in which it was free; "gain_s": mean predicted gain if only this variable is free;
        "explanation": this gain, or why there is none.
    """
    refiner = tools.refiner(gated=True)
    found: defaultdict[tuple[int, str, str], list[Refinement]] = defaultdict(list)
    for trial in trials:
        plan = open_speeds(trial.chain)
        naive = refiner.naive(trial.world, plan)
        for index, call in enumerate(plan.calls):
            for name in sorted(call.open):
                opened = [frozenset[str]()] * len(plan)
                opened[index] = frozenset({name})
                result = refiner.refine(trial.world, reopened(naive, opened))
                found[index + 1, call.top.name, name].append(result)
    return [_summary(*key, results) for key, results in sorted(found.items())]


def _summary(
    step: int,
    top: str,
    name: str,
    results: list[Refinement],
) -> dict[str, Any]:
    """Return the gain of one variable in all situations, and its explanation."""
    closed = Counter(each.reason for result in results for each in result.not_free)
    refined = [result for result in results if result.free]
    limits: Counter[str] = Counter()
    for result in refined:
        for variable in result.free:
            limits.update(variable.limits)
    accepted = sum(result.refined for result in refined)
    free = len(refined)
    gain = 0.0
    if free:
        gain = sum(max(0.0, each.before.cost - each.after.cost) for each in refined) / free
    if closed.total() > free:
        explanation = closed.most_common(1)[0][0]
    elif gain <= NO_EFFECT:
        explanation = f"no effect: the models predict a gain of {gain:.2f} s on average"
    elif not accepted:
        explanation = (
            f"the gate refuses all gains, of {gain:.2f} s on average: too little, or too uncertain"
        )
    else:
        accepts = f"the gate accepts it in {accepted} of {free} situations"
        explanation = f"predicted to gain {gain:.2f} s on average; {accepts}"
    if closed.total() <= free and limits:
        explanation += f"; searched within limits: {limits.most_common(1)[0][0]}"
    share = free / (closed.total() + free) if results else 0.0
    found = {
        "step": step,
        "top": top,
        "name": name,
        "free": round(share, 3),
        "gain_s": round(gain, 3),
    }
    return {**found, "explanation": explanation}


def study_page(result: Mapping[str, Any]) -> str:
    """Return the HTML page of a study, from the contents of `study.json`."""
    parts: list[Part] = [
        ("p", f"Domain {result['domain']}, action set {result['action_set']}."),
        ("h2", "Actions"),
        pd.DataFrame(
            {
                "action": name,
                "episodes": row["episodes"],
                "success": f"{100 * row['success']:.2f} %",
                "mean duration, s": _seconds(row["mean_duration_s"], 2),
                "model's MAE, s": _seconds(row["accuracy"].get("mae_s")),
                "RMSE, s": _seconds(row["accuracy"].get("rmse_s")),
            }
            for name, row in result["actions"].items()
        ),
    ]
    if result["left_out"]:
        parts += [
            ("h2", "What this robot cannot do"),
            pd.DataFrame(result["left_out"].items(), columns=["action", "why"]),
        ]
    if result["evaluation"] is None:
        parts.append(("p", "No chain of the domain can be executed by this robot."))
    else:
        parts += [
            ("h2", f"Refinement of the chain {result['chain']}"),
            policy_table(result["evaluation"]),
            ("p", "The evaluation in full: evaluation/report.html"),
        ]
    if result["variables"]:
        variables = pd.DataFrame(
            {
                "step": f"{each['step']} ({each['top']})",
                "open variable": each["name"],
                "free in": f"{100 * each['free']:.0f} %",
                "predicted gain alone, s": f"{each['gain_s']:.2f}",
                "explanation": each["explanation"],
            }
            for each in result["variables"]
        )
        parts += [("h2", "Open variables"), variables]
    parts += [("h2", "To repeat this"), ("pre", result["command"])]
    return page(f"{result['robot']}: actions and their refinement", parts)


def _seconds(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
