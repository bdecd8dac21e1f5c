"""The history of the view: executed chains, the models' error, and the gain of refinement."""

import math

from view.in_process import record_of

from ator_interfaces.msg import ChainPerformance, Outcome, TopCall
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.view.runs import History


def executed(actual: float, *, refined: bool, x: float = 0.0, yaw: float = 0.0) -> ChainPerformance:
    code = Outcome.SUCCEEDED if math.isfinite(actual) else Outcome.FAILED
    record = record_of(code=code, duration=actual, refined=refined)
    record.start.robot = pose_of(Pose(x, 0.0, yaw))
    record.predicted.duration = 8.0
    record.chain.calls = [TopCall(top=name) for name in ("goToBall", "dribbleBall")]
    return record


def history_of(*chains: ChainPerformance) -> History:
    history = History()
    for chain in chains:
        history.add(chain)
    return history


def test_chains_are_compared_in_the_order_as_sent() -> None:
    naive, refined = (executed(duration, refined=duration < 9.0) for duration in (9.0, 7.5))
    for record in (naive, refined):
        for call, x in zip(record.chain.calls, (1.0, 2.0), strict=True):
            call.goal.pose = pose_of(Pose(x, 0.0, 0.0))
    refined.chain.calls = list(refined.chain.calls[::-1])
    refined.order = [1, 0]
    report = history_of(naive, refined).report()
    assert "Gain over the naive chain from the same start: +1.50 s, mean of 1." in report


def test_the_gain_is_over_the_last_unrefined_chain_from_the_same_start() -> None:
    history = history_of(
        executed(9.0, refined=False),
        executed(7.0, refined=True, x=0.5),
        executed(10.0, refined=False),
        *(executed(7.0, refined=False, x=1.0 + 0.1 * number) for number in range(200)),
        executed(8.5, refined=True),
        executed(8.0, refined=True, x=-0.02, yaw=0.01),
    )
    assert "same start: +1.75 s, mean of 2" in history.report()


def test_it_reports_error_gain_and_the_newest_chains_first() -> None:
    assert History().report() == "no chain was executed yet"
    chains = (
        executed(9.0, refined=False),
        executed(8.5, refined=True),
        executed(math.nan, refined=True),
    )
    text = history_of(*chains).report()
    assert "3 chains, 2 of them refined." in text
    assert "Model error, last 2: 0.75 s, mean -0.75 s" in text
    assert "same start: +0.50 s, mean of 1" in text
    assert text.splitlines()[-3:] == [
        "| 3 | goToBall, dribbleBall (refined) | 8.00 | failed | - |",
        "| 2 | goToBall, dribbleBall (refined) | 8.00 | 8.50 | 0.50 |",
        "| 1 | goToBall, dribbleBall (as sent) | 8.00 | 9.00 | - |",
    ]
