"""The commands that README.md, CONTRIBUTING.md and docs/ print."""

import re
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
TOOLS = tuple(
    script.name
    for script in entry_points(group="console_scripts")
    if script.value.startswith("ator_ros.start:tools.")  # as setup.py lists them
)
_PROGRAMS = (
    *TOOLS,
    "make",
    "ros2",
    "python",
    "pip",
    "dask",
    "apt",
    "sudo",
    "rosdep",
    "colcon",
    "cd",
    "cp",
)
_WORDS = (*_PROGRAMS, "export", ".", "scripts/run", "for", "done", "python3")
_VARIABLES = r"(?:[A-Z_]+=\S* )+"
_FIRST = re.compile(rf"(?:{_VARIABLES})?(?:{'|'.join(map(re.escape, _WORDS))})(?=\s|$)|\w+=[~$']")
_SPAN = re.compile(r"(?<!`)`([^`]+)`(?!`)")
_FILE = re.compile(r"^```yaml\n.*?^```$", flags=re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"\s+#\s.*$")


@dataclass(frozen=True)
class Printed:
    """A printed command: the page's name and the text, with continued lines joined."""

    page: str
    text: str


def commands() -> list[Printed]:
    """Return the commands in indented blocks and code spans, each once per page."""
    found: dict[Printed, None] = {}
    for page in PAGES:
        text = _FILE.sub("", page.read_text(encoding="utf-8"))
        for block in _blocks(text):
            for line in _logical_lines(block):
                if _FIRST.match(line):
                    found[Printed(page.name, _COMMENT.sub("", line))] = None
        prose = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
        for span in _SPAN.findall(prose):
            words = " ".join(span.split())
            if _is_command(words):
                found[Printed(page.name, words)] = None
    return list(found)


def _is_command(span: str) -> bool:
    """Return whether a code span is a command.

    A single word is one if it names one of our tools.
    """
    if not _FIRST.match(span) or re.match(r"\w+=[~$']", span):
        return False
    return " " in span or span in TOOLS


def _blocks(text: str) -> list[str]:
    blocks: list[list[str]] = []
    before = ""
    for line in text.splitlines():
        if line.startswith("    ") and (not before.strip() or before.startswith("    ")):
            if not before.startswith("    "):
                blocks.append([])
            blocks[-1].append(line[4:])
            before = line
        else:
            before = line
    return ["\n".join(block) for block in blocks]


def _logical_lines(block: str) -> list[str]:
    """Join lines up to a closed quotation mark."""
    lines: list[str] = []
    open_quote = False
    for line in block.splitlines():
        if open_quote:
            lines[-1] += " " + line.strip()
        else:
            lines.append(line.strip())
        open_quote ^= line.count('"') % 2 == 1
    return lines
