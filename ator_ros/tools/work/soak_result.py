"""What `soak` reports."""

from __future__ import annotations

from dataclasses import dataclass

from ator_ros.formats import Format

FORMAT = Format("ator_ros soak", 1, "report of a soak")


@dataclass(frozen=True)
class NodeGrowth:
    """Medians of the first fifth of a node's samples and of the last one.

    Attributes
    ----------
    memory, threads, files : tuple of float
        Resident memory in MiB, number of threads, number of open files.
    """

    memory: tuple[float, ...]
    threads: tuple[float, ...]
    files: tuple[float, ...]


@dataclass(frozen=True)
class Milliseconds:
    """Median, 99th percentile and maximum of times in ms; None of fewer than two times."""

    median: float | None = None
    p99: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class TickLateness:
    """How late ticks were: their number, the share within 5 ms, and the times as in `Milliseconds`."""

    ticks: int
    share_within_5_ms: float
    median: float | None = None
    p99: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class CpuShares:
    """Shares of one core by node: without a goal, and while chains run."""

    idle: dict[str, float]
    chains: dict[str, float]


@dataclass(frozen=True)
class SoakReport:
    """The content of the file that `soak` writes.

    Attributes
    ----------
    command : str
        The command that wrote it.
    machine : str
        Cores, processor, system.
    versions : mapping of str to str
        Of Python and libraries.
    meaning : mapping of str to str
        What the entries below mean, for who reads the file alone.
    chains, failed : int
        Number of chains, and of those that failed.
    failures : mapping of str to int
        Why they failed and how often.
    hiccups : tuple of str
        Errors of ROS after which the soak went on.
    nodes : mapping of str to NodeGrowth
        By name of the node.
    odom_to_command_ms : tuple of Milliseconds
        From odometry to the next command, in the first fifth of the chains and in the last one.
    cpu : CpuShares
        What the nodes use.
    worse : tuple of str
        Limits that were exceeded.
    tick_lateness_ms : TickLateness or None
        None unless the soak ran at real time.
    """

    command: str
    machine: str
    versions: dict[str, str]
    meaning: dict[str, str]
    chains: int
    failed: int
    failures: dict[str, int]
    hiccups: tuple[str, ...]
    nodes: dict[str, NodeGrowth]
    odom_to_command_ms: tuple[Milliseconds, ...]
    cpu: CpuShares
    worse: tuple[str, ...]
    tick_lateness_ms: TickLateness | None = None
