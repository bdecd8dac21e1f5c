"""The client of execute_chain with a mock executor: each chain that is sent has one result."""

from collections.abc import Iterator
from typing import Any

import pytest
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from ros_client import Client

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome
from ator_ros.nodes.chain_client import NO_EXECUTOR, ChainClient, SentChain

CLIENT = {"silent": True}


class Executor:
    """An action server whose goals end when they are canceled, or when `finish` is called."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self.accepts = True
        self.executes = True
        self.goals: list[Any] = []
        self._ended: dict[bytes, Future] = {}
        self.server = client.within(self._serve)

    def _serve(self) -> ActionServer:
        return ActionServer(
            self._client.node,
            ExecuteChain,
            "execute_chain",
            self._execute,
            goal_callback=lambda _: (GoalResponse.REJECT, GoalResponse.ACCEPT)[self.accepts],
            handle_accepted_callback=self._take,
            cancel_callback=self._cancel,
        )

    def _take(self, handle: Any) -> None:
        self.goals.append(handle)
        if self.executes:
            handle.execute()

    async def _execute(self, handle: Any) -> ExecuteChain.Result:
        self._ended[bytes(handle.goal_id.uuid)] = ended = Future()
        handle.publish_feedback(ExecuteChain.Feedback(step=3))
        code = await ended
        handle.succeed() if code == Outcome.SUCCEEDED else handle.abort()
        return ExecuteChain.Result(outcome=Outcome(code=code, reason="over"))

    def _cancel(self, handle: Any) -> CancelResponse:
        self._ended[bytes(handle.goal_id.uuid)].set_result(Outcome.CANCELED)
        return CancelResponse.ACCEPT

    def finish(self) -> None:
        """Let the last goal succeed."""
        ended = self._ended[bytes(self.goals[-1].goal_id.uuid)]
        self._client.within(lambda: ended.set_result(Outcome.SUCCEEDED))

    def destroy(self) -> None:
        """End the server; its goals must not be executed."""
        self.goals.clear()
        self._client.within(self.server.destroy)


class Sender:
    """A client of chains in the thread of its node."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self.lost: list[str] = []
        self.feedback: list[int] = []
        self.chains = client.within(lambda: ChainClient(client.node, self.lost.append))

    def send(self, *, cancel: bool = False) -> SentChain:
        """Send a chain; with `cancel` it is canceled before the executor can have accepted it."""

        def send() -> SentChain:
            sent = self.chains.send(
                ExecuteChain.Goal(), lambda feedback: self.feedback.append(feedback.step)
            )
            if cancel:
                sent.cancel()
            return sent

        return self._client.within(send)

    def outcome(self, sent: SentChain) -> Outcome:
        """Wait for the result of a chain."""
        return self._client.eventually(
            lambda: sent.result.done() and sent.result.result(), "it"
        ).outcome

    def wait_for_executor(self) -> None:
        """Wait until both have discovered each other."""
        self._client.eventually(self.chains.is_ready, "the executor")
        self._client.wait_for_discovery_by("execute_chain")


@pytest.fixture
def other(domain: int) -> Iterator[Client]:
    made = Client(domain, name="mock_executor", silent=True)
    yield made
    made.close()


@pytest.fixture
def executor(other: Client) -> Executor:
    return Executor(other)


@pytest.fixture
def sender(client: Client, executor: Executor) -> Sender:
    made = Sender(client)
    made.wait_for_executor()
    return made


def test_a_chain_has_feedback_a_result_the_id_of_its_goal_and_a_lease(
    client: Client, sender: Sender, executor: Executor
) -> None:
    sent = sender.send()
    client.eventually(lambda: sender.feedback, "feedback")
    (goal,) = executor.goals
    assert bytes(goal.goal_id.uuid).hex() == sent.chain_id
    assert client.node.count_publishers(goal.request.lease) == 1
    executor.finish()
    assert sender.outcome(sent).code == Outcome.SUCCEEDED
    assert (sender.feedback, sender.lost) == ([3], [])
    sent.abandon(Outcome.SHUTDOWN, "too late")
    assert sender.outcome(sent).code == Outcome.SUCCEEDED


def test_a_rejected_chain_is_refused(sender: Sender, executor: Executor) -> None:
    executor.accepts = False
    outcome = sender.outcome(sender.send())
    assert outcome.code == Outcome.REFUSED
    assert "the executor rejected the goal" in outcome.reason


def test_a_chain_is_canceled_also_before_it_is_accepted_and_by_its_id(
    client: Client, sender: Sender, executor: Executor
) -> None:
    assert sender.outcome(sender.send(cancel=True)).code == Outcome.CANCELED
    sent = sender.send()
    client.eventually(lambda: len(executor.goals) == 2, "the second goal")
    client.within(lambda: sender.chains.cancel(sent.chain_id))
    assert sender.outcome(sent).code == Outcome.CANCELED


def test_an_abandoned_chain_has_the_given_outcome_and_is_canceled(
    client: Client, sender: Sender, executor: Executor
) -> None:
    sent = sender.send()
    client.eventually(lambda: executor.goals, "the goal")
    client.within(lambda: sent.abandon(Outcome.SHUTDOWN, "the client ends"))
    outcome = sender.outcome(sent)
    assert (outcome.code, outcome.reason) == (Outcome.SHUTDOWN, "the client ends")
    client.eventually(lambda: not executor.goals[0].is_active, "the end of the goal")


def test_without_an_executor_a_chain_ends_at_once(client: Client) -> None:
    sender = Sender(client)
    outcome = sender.outcome(sender.send())
    assert (outcome.code, outcome.reason) == (Outcome.INPUT_LOST, NO_EXECUTOR)
    assert sender.lost == []


def test_chains_are_lost_with_their_executor(
    client: Client, sender: Sender, executor: Executor
) -> None:
    executor.executes = False
    sent = sender.send()
    client.eventually(lambda: executor.goals, "the goal")
    executor.destroy()
    outcome = sender.outcome(sent)
    assert (outcome.code, outcome.reason) == (Outcome.INPUT_LOST, NO_EXECUTOR)
    assert sender.lost == [NO_EXECUTOR]


def test_chains_are_lost_where_a_second_executor_comes(
    client: Client, sender: Sender, executor: Executor, other: Client
) -> None:
    """DDS still lists the first one for some time after it was killed."""
    sent = sender.send()
    client.eventually(lambda: executor.goals, "the goal")
    Executor(other)
    outcome = sender.outcome(sent)
    assert outcome.code == Outcome.INPUT_LOST
    assert "the executor was restarted" in outcome.reason
    assert sender.lost == [outcome.reason]
