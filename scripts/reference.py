"""Pages of the reference, made of the code: nodes, interfaces, command lines, Python."""

from __future__ import annotations

import importlib
import inspect
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from rclpy.node import Node
from rosidl_adapter.parser import parse_action_file, parse_message_file, parse_service_file

from ator_ros.nodes.parameters import OBJECT, Parameter

ROOT = Path(__file__).resolve().parents[1]
INTERFACES = ROOT / "ator_interfaces"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [
        head,
        ["---"] * len(head),
        *([cell.replace("|", "\\|") for cell in row] for row in rows),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def text_of(lines: Iterable[str]) -> str:
    """Return a comment as Markdown; names between ` keep their characters."""
    parts = re.split(r"(`[^`]*`)", " ".join(lines))
    return "".join(part if part.startswith("`") else _escaped(part) for part in parts)


def _escaped(text: str) -> str:
    return re.sub(r"([*<\[_])", r"\\\1", text)


def programs(folder: str) -> dict[str, ModuleType]:
    """Return the modules of the executables of a folder of the package, in the order of names."""
    modules = {}
    for script in sorted(entry_points(group="console_scripts"), key=lambda script: script.name):
        if script.value.startswith(f"ator_ros.start:{folder}."):
            modules[script.name] = importlib.import_module(f"ator_ros.{script.attr}")
    return modules


# ---- nodes ---------------------------------------------------------------------------------------


def declared(module: Any) -> Sequence[Parameter]:
    """Return the parameters that the module of a node declares.

    Those of an object are called OBJECT_….
    """
    found: Sequence[Parameter]
    if hasattr(module, "parameters_for"):
        found = module.parameters_for([OBJECT])
    else:
        found = module.PARAMETERS
    return found


def type_of(default: Any) -> str:
    """Return the type of a parameter as ROS names it."""
    names = {bool: "bool", int: "integer", float: "double", str: "string"}
    if isinstance(default, list):
        return f"{names[type(default[0])]} array"
    return names[type(default)]


def allowed(parameter: Parameter) -> str:
    """Return the values that a parameter may have."""
    if parameter.choices:
        return ", ".join(parameter.choices)
    bounds = parameter.low, parameter.high
    return "" if bounds == (-float("inf"), float("inf")) else f"{bounds[0]:g} to {bounds[1]:g}"


def topics(module: Any) -> str:
    """Return what the docstring of a node says about its topics, services and actions."""
    classes = (
        item for item in vars(module).values() if inspect.isclass(item) and issubclass(item, Node)
    )
    node = next(item for item in classes if item.__module__ == module.__name__)
    return inspect.getdoc(node) or ""


def parameter_row(parameter: Parameter) -> tuple[str, ...]:
    """Return the cells of a parameter in the table of its node."""
    return (
        f"`{parameter.name}`",
        type_of(parameter.default),
        f"`{json.dumps(parameter.default)}`",
        allowed(parameter),
        "live" if parameter.live else "read-only",
        text_of([parameter.description]),
    )


def nodes_page() -> str:
    """Return the page of the nodes and their parameters."""
    text = (
        "# Nodes\n\nA *live* parameter can be set while the node runs, the others are read-only.\n"
        "`real s` are seconds of the machine, `s` those of the stamps.\n"
        f"{OBJECT} is the name of an object of the domain, such as `ball`.\n"
    )
    for name, module in programs("nodes").items():
        rows = [parameter_row(item) for item in declared(module)]
        about = re.sub(
            r"^The node `\w+`: ",
            "",
            (module.__doc__ or "").strip().split("\n\n")[0],
        )
        text += f"\n## {name}\n\n{about[:1].upper()}{about[1:]}\n\n"
        text += f"```{{eval-rst}}\n{topics(module)}\n```\n\n"
        text += table(("parameter", "type", "default", "values", "changes", "meaning"), rows)
    return text


# ---- interfaces ----------------------------------------------------------------------------------


def parts_of(file: Path) -> Iterator[tuple[str, Any]]:
    """Yield the parts of an interface with their titles, as rosidl's parser reads them."""
    if file.suffix == ".msg":
        yield "", parse_message_file(INTERFACES.name, str(file))
    elif file.suffix == ".srv":
        service = parse_service_file(INTERFACES.name, str(file))
        yield from (("Request", service.request), ("Response", service.response))
    else:
        action = parse_action_file(INTERFACES.name, str(file))
        yield from (("Goal", action.goal), ("Result", action.result), ("Feedback", action.feedback))


def field_row(field: Any) -> tuple[str, str]:
    """Return the cells of a field or constant in the table of its interface."""
    name = f"`{field}`".replace(f"{INTERFACES.name}/", "")
    return name, text_of(field.annotations["comment"])


def interfaces_page() -> str:
    """Return the page of messages, services and actions, with the comments in their files."""
    text = "# Interfaces\n\nMessages, services and actions of the package `ator_interfaces`.\n"
    for folder, title in (("msg", "Messages"), ("srv", "Services"), ("action", "Actions")):
        text += f"\n## {title}\n"
        for file in sorted((INTERFACES / folder).iterdir()):
            text += f"\n### {file.stem}\n"
            for name, part in parts_of(file):
                text += f"\n{text_of(part.annotations['comment'])}\n"
                rows = [field_row(item) for item in (*part.constants, *part.fields)]
                text += f"\n{table((name or 'Field', 'Meaning'), rows)}"
    return text


# ---- command lines and Python --------------------------------------------------------------------


def tools_page() -> str:
    """Return the page of the command lines, with the help of their parsers."""
    text = (
        "# Command lines\n\n"
        "Run them with `ros2 run ator_ros NAME`, or `make run EXE=NAME ARGS='…'`.\n"
    )
    for name, module in programs("tools").items():
        text += f"\n## {name}\n\n```text\n{module.arguments().format_help()}```\n"
    return text


def imported_names() -> dict[str, set[str]]:
    """Return the names that examples and pages import from ator_ros, by module."""
    files = [*ROOT.glob("examples/*.py"), *ROOT.glob("docs/*.md"), *ROOT.glob("test/outside/*.py")]
    found: dict[str, set[str]] = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        for module, names in re.findall(r"from (ator_ros\.[\w.]+) import (\([^)]*\)|.*)", text):
            listed = re.sub(r"#.*| as \w+", "", names)
            found.setdefault(module, set()).update(re.findall(r"\w+", listed))
    return found


def python_page() -> str:
    """Return the page of the Python names that users import."""
    text = "# Python\n\nWhat the examples and the pages import, by module.\n"
    for module, names in sorted(imported_names().items()):
        listed = ", ".join(sorted(names))
        directive = f".. automodule:: {module}\n   :members: {listed}"
        text += f"\n## {module}\n\n```{{eval-rst}}\n{directive}\n```\n"
    return text


PAGES = {
    "nodes": nodes_page,
    "interfaces": interfaces_page,
    "tools": tools_page,
    "python": python_page,
}


def write_pages(folder: Path) -> None:
    """Write the pages."""
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        (folder / f"{name}.md").write_text(page(), encoding="utf-8")
