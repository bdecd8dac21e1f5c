"""The subset of the `ros2` command line in the documentation, for machines without it.

Options and defaults are those of ros2cli 0.32 and launch_ros 0.26 (Jazzy); the output format differs.
"""

from __future__ import annotations

import importlib
import os
import re
import shlex
import signal
import subprocess
import sys
from argparse import ArgumentParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import rclpy
import yaml
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

from ator_ros.examples.call import filled


def kind_of(name: str) -> Any:
    """Return the type named package/srv/Name."""
    package, folder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), kind)


def echo_options() -> ArgumentParser:
    """Return the options of `ros2 topic echo`."""
    parser = ArgumentParser("ros2 topic echo")
    parser.add_argument("topic")
    parser.add_argument("type")
    parser.add_argument("--once", action="store_true")
    parser.add_argument("--qos-reliability", choices=("reliable", "best_effort"))
    parser.add_argument("--qos-durability", choices=("transient_local", "volatile"))
    return parser


def echo_profile(reliability: str | None, durability: str | None) -> QoSProfile:
    """Return the QoS of `ros2 topic echo`: sensor data, changed by the options."""
    profile = QoSProfile(
        depth=qos_profile_sensor_data.depth,
        reliability=qos_profile_sensor_data.reliability,
        durability=qos_profile_sensor_data.durability,
    )
    if reliability:
        profile.reliability = ReliabilityPolicy.get_from_short_key(reliability)
    if durability:
        profile.durability = DurabilityPolicy.get_from_short_key(durability)
    return profile


def echo(node: Node, words: list[str]) -> None:
    """Print the messages of a topic."""
    options = echo_options().parse_args(words)
    received: list[Any] = []
    profile = echo_profile(options.qos_reliability, options.qos_durability)
    node.create_subscription(kind_of(options.type), options.topic, received.append, profile)
    while True:
        rclpy.spin_once(node)
        for message in received:
            print(message, "---", sep="\n", flush=True)
        if received and options.once:
            return
        received.clear()


def call(node: Node, words: list[str]) -> None:
    """Call a service and print its answer."""
    name, kind = words[0], kind_of(words[1])
    client = node.create_client(kind, name)
    client.wait_for_service()
    request = filled(kind.Request, yaml.safe_load(words[2]) if words[2:] else {})
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    print(f"response:\n{future.result()!r}")


def send_goal(node: Node, words: list[str]) -> None:
    """Send a goal; print feedback and result, or that it was rejected."""
    (name, type_name, values) = (word for word in words if word != "--feedback")
    kind = kind_of(type_name)
    client = ActionClient(node, kind, name)
    client.wait_for_server()
    goal = filled(kind.Goal, yaml.safe_load(values))
    show = (lambda message: print(f"Feedback: {message.feedback}")) if "--feedback" in words else None
    sent = client.send_goal_async(goal, feedback_callback=show)
    rclpy.spin_until_future_complete(node, sent)
    if not sent.result().accepted:
        print("Goal was rejected.")
        return
    ended = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, ended)
    print(f"Result: {ended.result().result}")


def launch(words: list[str]) -> int:
    """Start the nodes of a launch file: its arguments, parameter files, single parameters, one namespace."""
    share = get_package_share_directory(words[0])
    root = ET.parse(Path(share, "launch", words[1])).getroot()  # noqa: S314 - our own file
    values = {entry.get("name"): entry.get("default") for entry in root.findall("arg")}
    given = dict(word.split(":=", 1) for word in words[2:])
    if strange := set(given) - set(values):
        sys.exit(f"ros2 launch: no such arguments: {', '.join(sorted(strange))}")
    values |= given

    def put(text: str) -> str:
        text = re.sub(r"\$\(find-pkg-share (\w+)\)", lambda m: get_package_share_directory(m[1]), text)
        text = re.sub(r"\$\(var (\w+)\)", lambda m: put(str(values[m[1]])), text)
        return re.sub(r"\$\(command '([^']*)'\)", lambda m: printed_by(m[1]), text)

    values |= {entry.get("name"): entry.get("value") for entry in root.findall("let")}
    (group,) = root.findall("group")
    namespace = put(group.find("push_ros_namespace").get("namespace"))  # type: ignore[union-attr, arg-type]
    running = [_node(node, put, namespace) for node in group.findall("node") if _wanted(node, put)]
    signal.signal(signal.SIGINT, lambda *_: [process.send_signal(signal.SIGINT) for process in running])
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
            words += ["-p", f"{param.get('name')}:={typed(put(param.get('value')), param.get('type'))}"]
    words += ["-r", f"__ns:=/{namespace}"] if namespace else []
    return subprocess.Popen([executable(node.get("pkg", ""), node.get("exec", "")), *words])


def typed(value: str, kind: str | None) -> str:
    """Return a parameter's value parsed as YAML, of the type in the launch file, if any."""
    if kind == "float":
        return repr(float(value))
    return f"'{value}'" if kind == "str" or not value else value


def executable(package: str, name: str) -> str:
    """Return the path of an executable."""
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
    verbs = {("service", "call"): call, ("action", "send_goal"): send_goal, ("topic", "echo"): echo}
    verb = verbs[words[0], words[1]]
    rclpy.init()
    node = Node(f"_ros2cli_{os.getpid()}")
    verb(node, words[2:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
