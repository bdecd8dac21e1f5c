"""External text in logs, responses and diagnostics."""

from hypothesis import given
from hypothesis import strategies as st

from ator_ros.printable import printable


@given(st.text(alphabet=st.characters(exclude_categories=())))
def test_any_text_can_be_printed_in_one_line(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert len(shown.splitlines()) <= 1
    assert len(shown) <= 90
    shown.encode()  # no unpaired surrogates


def test_terminal_control_characters_are_escaped() -> None:
    assert printable("\x1b[2Jx\ny\u202ez\udc80") == r"\x1b[2Jx\ny\u202ez\udc80"
