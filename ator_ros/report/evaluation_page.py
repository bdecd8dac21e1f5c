"""The report of an evaluation: one self-contained page, the paper's tables and figures for our models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ator_ros.drawing import svg_text
from ator_ros.evaluation.policies import Toolset
from ator_ros.evaluation.running import has_predictions
from ator_ros.evaluation.situation import ONE_GOAL, Record, Settings
from ator_ros.evaluation.statistics import OURS
from ator_ros.evaluation.toolset import make_library
from ator_ros.evaluation.trials import SEEDS
from ator_ros.evaluation.worst_runs import WorstRun, policy_shown
from ator_ros.files import write_text
from ator_ros.refinement.gate import GATE, Gate, OpenGate, ThresholdGate, load_training
from ator_ros.report import charts
from ator_ros.report.page import code, figure, page, paragraph, section, table
from ator_ros.report.report_tables import headline, policies, table1, verdict

REPORT = "report.html"


def write_report(
    folder: Path,
    result: Mapping[str, Any],
    records: Sequence[Record],
    settings: Settings,
    tools: Toolset,
    worst: Sequence[WorstRun],
) -> Path:
    """Write `report.html` to `folder`.

    Parameters
    ----------
    folder : Path
        Where it goes.
    result : mapping
        As `ator_ros.evaluation.running.describe` gives it.
    records : sequence of dict
        The runs.
    settings : Settings
        What the results depend on.
    tools : Toolset
        The models.
    worst : sequence of WorstRun
        What `worst_runs` has executed: the paths to draw.
    """
    summary = result["summary"]
    shown = tools.domain.presentation
    title = f"Subgoal refinement: {shown.chains.get(settings.chain, settings.chain)}"
    body = [
        f"<h1>{title}</h1>",
        paragraph(verdict(summary, shown.place), "lead"),
        headline(summary),
        table1(summary, shown.table1),
        policies(summary, settings, shown),
        _situations(records, summary, shown.place),
        _models(tools, settings),
        _worst(worst, tools, settings),
        _accuracy(tools, summary),
        _gate(tools.gate, settings),
        _repeat(result),
    ]
    write_text(folder / REPORT, page(title, body))
    return folder / REPORT


def _situations(records: Sequence[Record], summary: Mapping[str, Any], place: str) -> str:
    policies = [name for name in ("gated", "gated_speed", "oracle") if name in summary]
    figures = []
    if policies and len(records[0]["start"]) > ONE_GOAL:
        drawn = charts.gain_against_situation(records, policies, place)
        figures.append(figure(svg_text(drawn), f"Points: {policies[0]}. Lines: means with 95 % intervals."))
    pairs = [("refined", "features"), ("refined_speed", "features_speed")]
    halves = [
        figure(
            svg_text(charts.predicted_against_actual(records, name, key)),
            f"{name}: predicted and actual gain.",
        )
        for name, key in pairs
        if name in summary
    ]
    if "oracle" in summary and not any(None in record["oracle"]["durations"] for record in records):
        drawn = charts.oracle_curve(records, place)
        halves.append(figure(svg_text(drawn), "What each executed heading costs."))
    return section("Where it pays", *figures, f'<div class="row">{"".join(halves)}</div>')


def _models(tools: Toolset, settings: Settings) -> str:
    library = make_library(tools.robot, settings.source)
    shown = tools.domain.presentation
    drawn = shown.figures(tools.robot, tools.models["learned"], library)
    if not drawn:
        return ""
    return section(shown.title, *(figure(svg_text(each), caption) for each, caption in drawn))


def _worst(worst: Sequence[WorstRun], tools: Toolset, settings: Settings) -> str:
    policy, draw = policy_shown(settings), tools.domain.presentation.draw
    if not worst:
        return section("Where it loses", paragraph(f"{policy} was never slower than naive."))
    parts = []
    for run in worst:
        drawn = charts.paths(tools.robot, run.trial.chain, run.trial.world, run.runs, draw)
        parts.append(figure(svg_text(drawn), _why(run.record, policy)))
    return section(
        "Where it loses",
        paragraph(f"The worst runs of {policy}."),
        f'<div class="row">{"".join(parts)}</div>',
    )


def _why(record: Record, policy: str) -> str:
    naive, taken = record["policies"]["naive"], record["policies"][policy]
    loss = taken["duration"] - naive["duration"]
    text = f"Situation {record['index']}: {loss:.2f} s slower ({100 * loss / naive['duration']:.1f} %)."
    if not taken["success"]:
        return f"{text} Failed: {taken['reason']}."
    if "predicted" in taken and record.get("features"):
        text += (
            f" Predicted {taken['predicted']:.2f} s, took {taken['duration']:.2f} s; "
            f"predicted gain {record['features']['gain']:.2f} s."
        )
    return text


def _accuracy(tools: Toolset, summary: Mapping[str, Any]) -> str:
    paper = tools.domain.presentation.published
    rows = []
    for action in tools.models["learned"]:
        measured = getattr(tools.models["learned"][action], "metadata", {}).get("accuracy", {})
        if "mae_s" in measured:
            episodes = str(measured.get("episodes", ""))
            errors = f"{measured['mae_s']:.3f} / {measured['rmse_s']:.3f}"
            rows.append((action, errors, paper.get(action, "-"), episodes))
    parts = [table(("action", "MAE / RMSE s", "paper", "fresh episodes"), rows)] if rows else []
    chains = [
        _prediction_row(name, row["prediction"])
        for name, row in summary.items()
        if has_predictions(row) and name in ("naive", *OURS)
    ]
    return section(
        "How accurate the predictions are",
        *parts,
        paragraph(
            "Durations of the whole chains of this evaluation that succeeded, as chosen; error: predicted "
            "minus actual, with 95 % bootstrap intervals over situations."
        ),
        table(("policy", "chains", "mean error s", "95 %", "MAE s", "RMSE s"), chains),
    )


def _prediction_row(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    low, high = row["mean_error_ci95"]
    errors = (f"{row['mean_error_s']:+.3f}", f"{low:+.3f} to {high:+.3f}")
    return (name, str(row["chains"]), *errors, f"{row['mae_s']:.3f}", f"{row['rmse_s']:.3f}")


def _gate(gate: Gate, settings: Settings) -> str:
    path = settings.source.folder() / GATE
    if not path.exists():
        return section("The gate", paragraph("There is no gate: everything is refined."))
    training = load_training(path)
    names = ("mean_gain_s", "kept_gain_percent", "higher", "equal", "lower", "refined_percent", "utility")
    compared = training.cross_validation
    rows = [(kind, *(str(row.get(name, "?")) for name in names)) for kind, row in compared.items()]
    numbers = asdict(gate) if isinstance(gate, OpenGate | ThresholdGate) else ""
    situations, seed = ("?" if value is None else value for value in (training.situations, training.seed))
    return section(
        "The gate",
        paragraph(
            f"Shipped: {gate.kind} {numbers}. Cross-validated on {situations} situations of seed {seed}, "
            "with and without arrival speed:"
        ),
        table(("gate", *names), rows),
        paragraph(
            f"The decision tree's rules ({compared.get('tree', {}).get('accuracy_percent', '?')} % correct):"
        ),
        code("\n".join(training.tree_rules)),
    )


def _repeat(result: Mapping[str, Any]) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    seeds = table(("seeds", "used for"), list(SEEDS.items()))
    return section(
        "To repeat this",
        code(result["summary"]["command"]),
        paragraph(
            f"Seed {result['summary']['seed']}, {result['executed']} chains executed, digest of robot, "
            f"models and gate {result['digest']}. {versions}, on {result['machine']}. "
            "The result does not depend on the number of workers."
        ),
        seeds,
    )
