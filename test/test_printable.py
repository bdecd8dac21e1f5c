"""External text in logs, responses and diagnostics."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.printable import one_line, printable, quoted


@given(st.text(alphabet=st.characters(exclude_categories=())))
def test_any_text_can_be_printed_in_one_line(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert len(shown.splitlines()) <= 1
    assert len(shown) <= 90
    shown.encode()  # no unpaired surrogates


def test_terminal_control_characters_are_escaped() -> None:
    assert printable("\x1b[2Jx\ny\u202ez\udc80") == r"\x1b[2Jx\ny\u202ez\udc80"


@pytest.mark.parametrize("value", [1 << 20_000, [1 << 20_000]], ids=["int", "list"])
def test_an_integer_of_too_many_digits_is_described(value: object) -> None:
    expected = f"{type(value).__name__} of more than 4300 digits"
    assert printable(value) == quoted(value) == one_line(value) == expected
