"""The report of an evaluation: one self-contained page with Table 1, all policies, and charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

from ator_ros.domains import DEFAULT
from ator_ros.domains.domain import find_domain
from ator_ros.evaluation import charts
from ator_ros.evaluation.running import has_predictions
from ator_ros.evaluation.situation import ONE_GOAL, Record, Settings
from ator_ros.evaluation.statistics import EQUAL, OURS
from ator_ros.evaluation.toolset import Toolset
from ator_ros.files import write_text
from ator_ros.refinement.gate import GATE, Gate, OpenGate, ThresholdGate, load_training

REPORT = "report.html"
PAPER_ERRORS: Mapping[str, str] = {"goToPose": "0.31 / 0.75", "dribbleBall": "0.29 / 0.73"}
"""Mean absolute and root-mean-square error in s that the paper reports, by action."""
PAPER_TABLE_1 = (
    ("Before filtering, paper: runs", "1000", "533", "369", "98"),
    ("Before filtering, paper: improvement", "10%", "21%", "0%", "-10%"),
    ("After filtering, paper: runs", "1000", "505", "485", "10"),
    ("After filtering, paper: improvement", "12%", "23%", "0%", "-6%"),
)
"""Rows of the paper's Table 1: what it is of, then Total, Higher, Equal and Lower."""
MEANING: Mapping[str, str] = {
    "naive": "heading at which the first action alone is fastest (the paper's unrefined choice)",
    "face_goal": "bearing of the next goal, from each subgoal",
    "analytic": "search of headings with path times, nothing learned",
    "analytic_speed": "the same for headings and arrival speeds",
    "refined": "subgoal refinement, headings only",
    "gated": "the same, where the gate expects it to pay",
    "refined_speed": "refinement of headings and arrival speeds",
    "gated_speed": "the same, behind the gate",
    "oracle": "the best of the executed headings",
    "oracle_speed": "the best of the executed headings and arrival speeds",
}
"""What each policy chooses."""
COUNTS = ("higher", "equal", "lower")
_POLICY_HEAD = (
    *("policy", "mean s", "of sums %", "95 %", "mean of ratios %", "95 %", *COUNTS, "worst loss %", "failed"),
    *("of oracle %", "95 %", "behind refined s, 95 %", "behind gated s, 95 %"),
)
STYLE = """
:root{color-scheme:light}
body{font:15px/1.55 system-ui,"Segoe UI","DejaVu Sans",sans-serif;color:#20242b;background:#f5f6f8;margin:0}
main{max-width:1260px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:26px;margin:0 0 4px}
h2{font-size:18px;margin:34px 0 8px}
section{background:#fff;border:1px solid #e3e5e8;border-radius:8px;padding:14px 20px 18px;margin:14px 0}
p{max-width:78ch;margin:8px 0}
.lead{font-size:16px}
.note{color:#5b616b;font-size:13px}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:13.5px;margin:8px 0;font-variant-numeric:tabular-nums}
th,td{padding:4px 8px;text-align:right;border-bottom:1px solid #eceef1;white-space:nowrap}
th:first-child,td:first-child{text-align:left}
th{font-weight:600;color:#434954;border-bottom:1px solid #b9bec6;white-space:normal;vertical-align:bottom}
table.text td{text-align:left}
table.text th{text-align:left}
tr.ours td{background:#eef4fb}
tr.group td{font-weight:600;color:#434954;padding-top:12px}
.row{display:flex;flex-wrap:wrap;gap:14px}
.row figure{flex:1 1 380px}
figure{margin:8px 0}
figure svg{max-width:100%;height:auto}
figcaption{color:#5b616b;font-size:13px}
pre{background:#f2f3f5;border-radius:6px;padding:10px 12px;overflow-x:auto;font-size:12.5px}
.cards{display:flex;flex-wrap:wrap;gap:12px;margin:14px 0}
.card{background:#fff;border:1px solid #e3e5e8;border-radius:8px;padding:10px 16px;flex:1 1 150px}
.card b{display:block;font-size:22px}
.card span{color:#5b616b;font-size:13px}
"""


def write_report(
    folder: Path,
    result: Mapping[str, Any],
    records: Sequence[Record],
    settings: Settings,
    tools: Toolset,
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
    """
    summary = result["summary"]
    title = f"Subgoal refinement: chain {settings.chain} of {tools.domain.name}"
    body = [
        f"<h1>{escape(title)}</h1>",
        paragraph(verdict(summary), "lead"),
        headline(summary),
        table1(summary, PAPER_TABLE_1 if tools.domain.name == DEFAULT else ()),
        policies(summary, settings),
        _situations(records, summary),
        _accuracy(tools, summary),
        _gate(tools.gate, settings),
        _repeat(result),
    ]
    write_text(folder / REPORT, page(title, body))
    return folder / REPORT


def verdict(summary: Mapping[str, Any]) -> str:
    """Return in words what came out."""
    best = summary.get("gated", summary.get("refined", summary["naive"]))
    low, high = best["improvement_ci95"]
    text = (
        f"Over {summary['situations']} random situations, each chain executed in the simulator, "
        f"refining headings saves {best['improvement_percent']:.1f} % of the time "
        f"({low:.1f} to {high:.1f} %) "
        f"and makes {best['lower']} runs slower by more than {100 * EQUAL:.0f} %."
    )
    if best["oracle_captured_percent"] is not None:
        text += (
            f" That is {best['oracle_captured_percent']:.0f} % of what the best executed heading could save."
        )
    if "gated_speed" in summary:
        speed = summary["gated_speed"]["improvement_percent"]
        text += f" With the arrival speed free too it saves {speed:.1f} %."
    return text


def headline(summary: Mapping[str, Any]) -> str:
    """Return the most important numbers, big."""
    items = [(f"{summary['naive']['mean_duration_s']:.2f} s", "mean duration, naive")]
    for name in ("gated", "gated_speed", "oracle", "oracle_speed"):
        if name in summary:
            row = summary[name]
            items.append(
                (f"{row['mean_duration_s']:.2f} s", f"{name}: {row['improvement_percent']:.1f} % less")
            )
    return cards(items)


def table1(summary: Mapping[str, Any], published: Sequence[tuple[str, ...]]) -> str:
    """Return Table 1, the published rows and ours."""
    rows: list[tuple[str, ...]] = []
    ours = []
    for name, title in (("refined", "Before filtering"), ("gated", "After filtering")):
        rows += [row for row in published if row[0].startswith(title)]
        for policy in (name, f"{name}_speed"):
            if policy not in summary:
                continue
            row = summary[policy]
            ours += [len(rows), len(rows) + 1]
            rows.append(
                (f"{title}, {policy}: runs", str(summary["situations"]), *(str(row[k]) for k in COUNTS))
            )
            rows.append(
                (
                    f"{title}, {policy}: improvement",
                    f"{row['improvement_percent']:.1f}%",
                    f"{row['mean_gain_higher_percent']:.1f}%",
                    "0%",
                    f"-{row['mean_loss_lower_percent']:.1f}%",
                )
            )
    return section(
        "Table 1 of the paper",
        table(("", "Total", "Higher", "Equal", "Lower"), rows, ours=ours),
        paragraph(
            f"Higher and Lower: shorter or longer than naive by more than {100 * EQUAL:.0f} %. Total is of "
            "the summed durations, Higher and Lower are means of the runs' own percentages.",
            "note",
        ),
    )


def policies(summary: Mapping[str, Any], settings: Settings) -> str:
    """Return all policies, as bars and as a table."""
    found = {name: row for name, row in summary.items() if isinstance(row, Mapping)}
    ours = [index for index, name in enumerate(found) if name.startswith(("gated", "refined"))]
    meanings = [(name, MEANING[name]) for name in found]
    limit, oracle = find_domain(settings.source.domain).time_limit, _oracle_note(settings)
    return section(
        "All policies on the same starts",
        figure(
            charts.svg_text(charts.gain_bars(summary)),
            "Time saved against naive, of the sums, with 95 % intervals.",
        ),
        table(_POLICY_HEAD, [_policy_row(name, row) for name, row in found.items()], ours=ours),
        paragraph(
            f"Intervals: bootstrap over situations. A failed chain counts {limit:g} s.{oracle} "
            "Of oracle: share of the time that the oracle saves against naive.",
            "note",
        ),
        table(("policy", "what it chooses"), meanings),
    )


def _behind(name: str, row: Mapping[str, Any], ours: str) -> str:
    """Return the interval behind one of our policies: that with the same free variables."""
    key = f"behind_{ours}{'_speed' * name.endswith('_speed')}_ci95"
    return _interval(row[key]) if key in row else "-"


def _policy_row(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    share = row["oracle_captured_percent"]
    return (
        name,
        f"{row['mean_duration_s']:.2f}",
        f"{row['improvement_percent']:.2f}",
        _interval(row["improvement_ci95"]),
        f"{row['mean_ratio_improvement_percent']:.2f}",
        _interval(row["mean_ratio_improvement_ci95"]),
        *(str(row[k]) for k in COUNTS),
        f"{row['worst_loss_percent']:.0f}",
        str(row["failures"]),
        "-" if share is None else f"{share:.1f}",
        "-" if share is None else _interval(row["oracle_captured_ci95"]),
        _behind(name, row, "refined"),
        _behind(name, row, "gated"),
    )


def _oracle_note(settings: Settings) -> str:
    """Return what the oracle executed, in sentences that each begin with a space."""
    note = f" The oracle executed {settings.oracle} headings." if settings.oracle else ""
    if settings.oracle and settings.joint_oracle:
        note = (
            f" The oracle executed the legs between {settings.oracle} headings, and those that the policies "
            "chose, at every open step, and then the chain that takes least by them."
        )
    if settings.oracle_margin is not None:
        note += f" It left out headings predicted {settings.oracle_margin:g} s behind its best."
    if settings.oracle_speeds:
        speeds = ", ".join(f"{v:g}" for v in (0.0, *settings.oracle_speeds))
        note += f" Its speeds at each heading: {speeds} m/s."
    return note


def _interval(bounds: Sequence[float]) -> str:
    return f"{bounds[0]:.2f} to {bounds[1]:.2f}"


def _situations(records: Sequence[Record], summary: Mapping[str, Any]) -> str:
    policies = [name for name in ("gated", "gated_speed", "oracle") if name in summary]
    figures = []
    if policies and len(records[0]["start"]) > ONE_GOAL:
        drawn = charts.gain_against_situation(records, policies)
        figures.append(
            figure(charts.svg_text(drawn), f"Points: {policies[0]}. Lines: means with 95 % intervals.")
        )
    pairs = [("refined", "features"), ("refined_speed", "features_speed")]
    halves = [
        figure(
            charts.svg_text(charts.predicted_against_actual(records, name, key)),
            f"{name}: predicted and actual gain.",
        )
        for name, key in pairs
        if name in summary
    ]
    if "oracle" in summary and not any(None in record["oracle"]["durations"] for record in records):
        drawn = charts.oracle_curve(records)
        halves.append(figure(charts.svg_text(drawn), "What each executed heading costs."))
    return section("Where it pays", *figures, f'<div class="row">{"".join(halves)}</div>')


def _accuracy(tools: Toolset, summary: Mapping[str, Any]) -> str:
    rows = []
    for action, model in tools.models.items():
        measured = getattr(model, "metadata", {}).get("accuracy", {})
        if "mae_s" in measured:
            episodes = str(measured.get("episodes", ""))
            errors = f"{measured['mae_s']:.3f} / {measured['rmse_s']:.3f}"
            rows.append((action, errors, PAPER_ERRORS.get(action, "-"), episodes))
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
    return section(
        "To repeat this",
        code(result["summary"]["command"]),
        paragraph(
            f"Seed {result['summary']['seed']}, {result['executed']} chains executed, digest of robot, "
            f"models and gate {result['digest']}. {versions}, on {result['machine']}. "
            "The result does not depend on the number of workers."
        ),
    )


_BEYOND = (
    "* more than 100 %: the oracle executes headings of one subgoal at given speeds; the policy also chooses "
    "arrival speeds or other subgoals"
)


def evaluation_table(summary: Mapping[str, Any]) -> str:
    """Return the summary of an evaluation as a table for a terminal."""
    head = f"{'policy':24}{'mean s':>9}{'gain %':>8}{'95 %':>20}{'higher':>8}{'equal':>7}{'lower':>7}"
    lines = [head + f"{'oracle %':>10}{'failed':>8}"]
    beyond = False
    for name, row in summary.items():
        if isinstance(row, Mapping):
            low, high = row["improvement_ci95"]
            share = row["oracle_captured_percent"]
            captured = "-" if share is None else f"{share:.1f}{'*' * (share > 100.0)}"
            beyond |= captured.endswith("*")
            lines.append(
                f"{name:24}{row['mean_duration_s']:9.2f}{row['improvement_percent']:8.2f}"
                f"{f'{low:.2f} to {high:.2f}':>20}{row['higher']:8}{row['equal']:7}{row['lower']:7}"
                f"{captured:>10}{row['failures']:8}"
            )
    return "\n".join([*lines, *([_BEYOND] if beyond else [])])


def prediction_table(summary: Mapping[str, Any]) -> str:
    """Return the errors of predictions as a table for a terminal; empty without predictions."""
    rows = [(name, row["prediction"]) for name, row in summary.items() if has_predictions(row)]
    if not rows:
        return ""
    lines = [f"{'predicted - actual':24}{'mean s':>9}{'95 %':>18}{'MAE s':>8}{'chains':>8}"]
    for name, row in rows:
        low, high = row["mean_error_ci95"]
        lines.append(
            f"{name:24}{row['mean_error_s']:+9.3f}{f'{low:+.3f} to {high:+.3f}':>18}"
            f"{row['mae_s']:8.3f}{row['chains']:8}"
        )
    return "\n".join(lines)


def page(title: str, body: Sequence[str]) -> str:
    """Return the page; `body` is HTML."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(body)
        + "\n</main></body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """Return a section with a heading; `parts` are HTML."""
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(parts) + "\n</section>"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of plain text."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, ours: Sequence[int] = ()) -> str:
    """Return a table of plain texts.

    A row of one text is a group's heading; `ours` are rows to stand out. Numbers stand to the right, but a
    table of two columns explains words.
    """
    lines = ["<tr>" + "".join(f"<th>{escape(text)}</th>" for text in head) + "</tr>"]
    for index, row in enumerate(rows):
        if len(row) == 1:
            lines.append(f'<tr class="group"><td colspan="{len(head)}">{escape(row[0])}</td></tr>')
            continue
        cells = "".join(f"<td>{escape(text)}</td>" for text in row)
        lines.append(f'<tr class="ours">{cells}</tr>' if index in ours else f"<tr>{cells}</tr>")
    kind = ' class="text"' if len(head) == 2 else ""
    return f'<div class="scroll"><table{kind}>' + "\n".join(lines) + "</table></div>"


def figure(svg: str, caption: str) -> str:
    """Return a figure with a caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def cards(items: Sequence[tuple[str, str]]) -> str:
    """Return big numbers, each with what it says."""
    parts = "".join(f'<div class="card"><b>{escape(n)}</b><span>{escape(w)}</span></div>' for n, w in items)
    return f'<div class="cards">{parts}</div>'


def code(text: str) -> str:
    """Return preformatted text."""
    return f"<pre>{escape(text)}</pre>"
