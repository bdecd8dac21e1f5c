"""Tables of an evaluation, from summaries with known numbers."""

from typing import Any

import pandas as pd

from ator_ros.evaluation.policies import POLICIES, USUAL
from ator_ros.evaluation.report import (
    MEANING,
    PAPER_TABLE_1,
    page,
    policy_table,
    prediction_table,
    table_1,
)


def row(**changes: Any) -> dict[str, Any]:
    return {
        "mean_duration_s": 10.127,
        "improvement_percent": 4.256,
        "improvement_ci95": [3.211, 5.388],
        "higher": 12,
        "equal": 7,
        "lower": 3,
        "mean_gain_higher_percent": 6.54,
        "mean_loss_lower_percent": 2.36,
        "worst_loss_percent": 3.6,
        "failures": 2,
        "oracle_captured_percent": 87.65,
        **changes,
    }


SUMMARY = {
    "situations": 22,
    "seed": 5,
    "naive": row(oracle_captured_percent=None),
    "refined": row(),
}


def test_a_row_of_the_policies_shows_rounded_numbers() -> None:
    table = policy_table(SUMMARY)
    assert list(table["policy"]) == ["naive", "refined"]
    shown = dict(table.iloc[1])
    assert shown == {
        "policy": "refined",
        "mean s": "10.13",
        "gain %": "4.26",
        "95 %": "3.21 to 5.39",
        "higher": 12,
        "equal": 7,
        "lower": 3,
        "worst loss %": "4",
        "failed": 2,
        "of oracle %": "87.7",
    }
    assert table.iloc[0]["of oracle %"] == "-"


def test_table_1_has_two_rows_for_each_policy_below_those_of_the_paper() -> None:
    table = table_1({**SUMMARY, "gated_speed": row(higher=1)}, PAPER_TABLE_1)
    titles = list(table[""])
    assert titles == [
        "Before filtering, paper: runs",
        "Before filtering, paper: improvement",
        "Before filtering, refined: runs",
        "Before filtering, refined: improvement",
        "After filtering, paper: runs",
        "After filtering, paper: improvement",
        "After filtering, gated_speed: runs",
        "After filtering, gated_speed: improvement",
    ]
    assert list(table.iloc[2])[1:] == ["22", "12", "7", "3"]
    assert list(table.iloc[3])[1:] == ["4.3%", "6.5%", "0%", "-2.4%"]
    assert list(table.iloc[6])[1:] == ["22", "1", "7", "3"]
    assert len(table_1(SUMMARY, ())) == 2


def test_only_policies_with_predicted_chains_are_in_the_table_of_predictions() -> None:
    errors = {
        "chains": 20,
        "mean_error_s": 0.0126,
        "mean_error_ci95": [-0.0104, 0.0356],
        "mae_s": 0.0618,
        "rmse_s": 0.0907,
        "within_90_percent": 85.0,
        "gain_predicted_s": 0.714,
    }
    table = prediction_table(
        {**SUMMARY, "gated": row(prediction=errors), "fixed": row(prediction={"chains": 0})}
    )
    assert len(table) == 1
    numbers = ["+0.013", "-0.010 to 0.036", "0.062", "0.091", "85 %", "0.71", "-"]
    assert list(table.iloc[0]) == ["gated", 20, *numbers]


def test_a_page_escapes_its_texts() -> None:
    text = page("a < b", [("p", "1 & 2"), pd.DataFrame({"x": ["<i>"]})])
    assert "<title>a &lt; b</title>" in text
    assert "<h1>a &lt; b</h1>" in text
    assert "<p>1 &amp; 2</p>" in text
    assert "<i>" not in text
    assert text.index("<h1>") < text.index("<p>") < text.index("<table")
    assert text.count("<table") == text.count("</table>") == 1


def test_every_policy_has_a_meaning_and_the_usual_ones_are_some_of_them() -> None:
    assert set(MEANING) == {*POLICIES, "oracle", "oracle_speed"}
    assert set(USUAL) < set(POLICIES)
    assert "naive" in USUAL
    assert not {"fixed", "arrive", "refined_place"} & set(USUAL)
