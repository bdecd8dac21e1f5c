"""The subset of the `ros2` command line in the documentation, for machines without it.

Options and defaults are those of ros2cli 0.32 and launch_ros 0.26 (Jazzy); messages are printed as
YAML, by `examples/call.py`.
"""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from ament_index_python.packages import get_package_prefix, get_package_share_directory

sys.path.insert(0, str(Path(__file__).parents[2]))
from examples.call import main as call


def launch(words: list[str]) -> int:
    """Start the nodes of a launch file: arguments, parameter files, parameters, a namespace."""
    share = get_package_share_directory(words[0])
    root = ET.parse(Path(share, "launch", words[1])).getroot()  # noqa: S314 - our own file
    values = {entry.get("name"): entry.get("default") for entry in root.findall("arg")}
    given = dict(word.split(":=", 1) for word in words[2:])
    if strange := set(given) - set(values):
        sys.exit(f"ros2 launch: no such arguments: {', '.join(sorted(strange))}")
    values |= given

    def put(text: str) -> str:
        text = re.sub(
            r"\$\(find-pkg-share (\w+)\)", lambda m: get_package_share_directory(m[1]), text
        )
        text = re.sub(r"\$\(var (\w+)\)", lambda m: put(str(values[m[1]])), text)
        return re.sub(r"\$\(command '([^']*)'\)", lambda m: printed_by(m[1]), text)

    values |= {entry.get("name"): entry.get("value") for entry in root.findall("let")}
    (group,) = root.findall("group")
    namespace = put(group.find("push_ros_namespace").get("namespace"))  # type: ignore[union-attr, arg-type]
    running = [_node(node, put, namespace) for node in group.findall("node") if _wanted(node, put)]
    signal.signal(
        signal.SIGINT, lambda *_: [process.send_signal(signal.SIGINT) for process in running]
    )
    return max(process.wait() for process in running)


def printed_by(command: str) -> str:
    """Return the output of a command, with this Python for `python3`."""
    words = shlex.split(command)
    words[0] = sys.executable if words[0] == "python3" else words[0]
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def _wanted(node: ET.Element, put: Any) -> bool:
    return put(node.get("if", "true")) == "true"


def _node(node: ET.Element, put: Any, namespace: str) -> subprocess.Popen[bytes]:
    words = put(node.get("args", "")).split() or ["--ros-args"]
    for param in node.findall("param"):
        if param.get("from"):
            words += ["--params-file", put(param.get("from"))]
        else:
            words += [
                "-p",
                f"{param.get('name')}:={typed(put(param.get('value')), param.get('type'))}",
            ]
    words += ["-r", f"__ns:=/{namespace}"] if namespace else []
    return subprocess.Popen([executable(node.get("pkg", ""), node.get("exec", "")), *words])


def typed(value: str, kind: str | None) -> str:
    """Return a parameter's value parsed as YAML, of the type in the launch file, if any."""
    if kind == "float":
        return repr(float(value))
    return f"'{value}'" if kind == "str" or not value else value


def executable(package: str, name: str) -> str:
    return str(Path(get_package_prefix(package), "lib", package, name))


def main(words: list[str]) -> int:
    """Run the command line; return the exit code."""
    match words:
        case ["run", package, name, *rest]:
            os.execv(executable(package, name), [name, *rest])  # noqa: S606 - as `ros2 run` does
        case ["pkg", "prefix", "--share", package]:
            print(get_package_share_directory(package))
            return 0
        case ["launch", *rest]:
            return launch(rest)
        case ["topic", "echo", *rest]:
            topic = next(word for word in rest if word.startswith("/"))
            return call(["echo", topic, *(["--once"] if "--once" in rest else [])])
        case ["service", "call", *rest] | ["action", "send_goal", *rest]:
            return call(rest)
    raise SystemExit(f"ros2: not in the subset: {words}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
