"""Make again what ships: models, tables, figures and reports.

    make reproduce                       # everything: about two hours on two idle cores
    make reproduce ARGS='tour bezier'    # some parts, with what they need
    make reproduce ARGS='--small --out build/small'    # a trial that changes nothing that ships

Two steps run at a time, one process each. Their output is in logs/ of the working folder. After an
interruption, or a failure, the same command resumes; a change of the code begins again. What ships
is replaced once all steps are done. Steps have different seeds: no model is measured on the
episodes that it was learned from.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
LANES = 2
"""Steps that run at a time."""
STUDIED = ("test/fifth.yaml", "config/pioneer_lx.yaml", "config/turtlebot4.yaml")
"""Robots of the studies besides the Pioneer."""


@dataclass(frozen=True)
class Sizes:
    """How much is collected and executed; intervals stay within a third of the effects."""

    episodes: int = 1000  # of each action, for the shipped models
    fresh: int = 400  # of each action, for their accuracy
    drives: int = 400  # of the tour's server
    fresh_drives: int = 100
    few: tuple[int, ...] = (50, 200)  # drives or episodes of models from few
    situations: int = 150  # of the dribble, whose gain is smallest
    chains: int = 60  # that are longer, or gain more
    tours: int = 40  # of other robots
    rounds: int = 15  # tours with models from few drives
    orders: int = 200  # rounds of six stations in any order
    patrol_drives: int = 100
    patrol_rounds: int = 200
    on_the_job: int = 100  # chains, while learning
    actions: int = 50
    study_episodes: int = 200
    oracle: int = 24  # headings of one subgoal
    tour_oracle: int = 12  # headings of each of several subgoals


SMALL = Sizes(
    episodes=60,
    fresh=25,
    drives=25,
    fresh_drives=25,
    few=(25, 30),
    situations=2,
    chains=2,
    tours=2,
    rounds=2,
    orders=2,
    patrol_drives=60,
    patrol_rounds=2,
    on_the_job=2,
    actions=2,
    study_episodes=40,
    oracle=2,
    tour_oracle=2,
)


@dataclass(frozen=True)
class Step:
    """A command; it begins once the steps that it `needs` are done.

    `name` is that of its part, and its own.
    """

    name: str
    command: str
    needs: tuple[str, ...] = ()


def steps(sizes: Sizes) -> Iterator[Step]:
    """Yield all steps. Paths are relative to the working folder, which gets models/ and docs/."""
    n = sizes
    scripts = f"python {ROOT}/scripts"
    benchmarks = f"python {ROOT}/benchmarks"

    for part, action_set, seed in (("default", "", 211), ("bezier", "--action-set bezier ", 201)):
        learned = f"collect {action_set}--episodes {n.episodes} --seed 101"
        yield Step(f"{part}:collect", f"{learned} --out {part}.parquet")
        fresh = f"collect {action_set}--episodes {n.fresh} --seed {seed}"
        yield Step(f"{part}:fresh", f"{fresh} --out {part}_fresh.parquet")
        tables = f"{part}.parquet --fresh {part}_fresh.parquet"
        made = (f"{part}:collect", f"{part}:fresh")
        yield Step(f"{part}:train", f"train {tables} --models models", made)
        trained = (f"{part}:train",)
        figures = f"{scripts}/figures.py {action_set}--models models --out docs"
        yield Step(f"{part}:figures", figures, trained)
        actions = f"{benchmarks}/actions.py {action_set}--situations {n.actions}"
        yield Step(f"{part}:actions", f"{actions} --out actions_{part}.md")
    race = "demo --models models --out demo.png --animation docs/race.gif"
    yield Step("default:race", race, ("default:train",))
    both = ("default:train", "bezier:train")
    page = f"{scripts}/accuracy.py --models models --out models/accuracy.md"
    yield Step("accuracy:models", page, both)
    ablation = f"{scripts}/accuracy.py default.parquet default_fresh.parquet --out ablation.md"
    yield Step("accuracy:ablation", ablation, ("default:train",))

    # Soccer: README, docs/results.md, docs/table1.md. The dribble's oracle serves the models from
    # few episodes, too.
    evaluate = "evaluate --models models"
    grid = f"--oracle {n.oracle} --oracle-margin"
    yield Step(
        "default:dribble",
        f"{evaluate} --seed 4131 --situations {n.situations} {grid} 0.3 "
        "--oracle-speeds 0.2 0.4 0.6 0.8 --out docs/evaluation",
        ("default:train",),
    )
    yield Step(
        "default:shoot",
        f"{evaluate} --seed 4142 --situations {n.chains} --chain shoot "
        f"--oracle {n.tour_oracle} --oracle-margin 0.5 --out docs/evaluation_shoot",
        ("default:train",),
    )
    yield Step(
        "default:place",
        f"{evaluate} --seed 4143 --situations {n.chains} --chain shoot "
        "--policies naive refined_speed refined_place --out docs/evaluation_place",
        ("default:train",),
    )
    yield Step(
        "bezier:evaluate",
        f"{evaluate} --action-set bezier --seed 2037 --situations {n.chains} {grid} 2.0 "
        "--policies naive face_goal analytic refined gated gated_speed "
        "--out docs/evaluation_bezier",
        ("bezier:train",),
    )
    for few in n.few:
        name = f"soccer_{few}"
        yield Step(
            f"few:collect_{few}",
            f"collect --actions goToPose dribbleBall --seed {6040 + few} --episodes {few} "
            f"--out {name}.parquet",
        )
        train = f"train {name}.parquet --models models_{name}"
        yield Step(f"few:train_{few}", train, (f"few:collect_{few}",))
        yield Step(
            f"few:evaluate_{few}",
            f"evaluate --seed 4131 --situations {n.situations} --oracle-from docs/evaluation "
            f"--policies naive gated gated_speed --models models_{name} --out few_{name}",
            (f"few:train_{few}", "default:dribble"),
        )

    # Driving without objects: docs/robots.md.
    collect = "collect --domain drive --episodes"
    yield Step("drive:collect", f"{collect} {n.episodes} --seed 141 --out drive.parquet")
    yield Step("drive:fresh", f"{collect} {n.fresh} --seed 241 --out drive_fresh.parquet")
    yield Step(
        "drive:train",
        "train drive.parquet --fresh drive_fresh.parquet --domain drive --models models/drive",
        ("drive:collect", "drive:fresh"),
    )

    # A domain with an action server that is independent of ator_ros, over ROS: docs/tour.md.
    yield Step(
        "tour:collect",
        f"collect --domain tour --over-ros --seed 131 --episodes {n.drives} --out tour.parquet",
    )
    yield Step(
        "tour:fresh",
        f"collect --domain tour --seed 231 --episodes {n.fresh_drives} --out tour_fresh.parquet",
    )
    yield Step(
        "tour:train",
        "train tour.parquet --fresh tour_fresh.parquet --domain tour --models models/tour",
        ("tour:collect", "tour:fresh"),
    )
    yield Step(
        "tour:evaluate",
        f"evaluate --domain tour --seed 2030 --situations {n.chains} --oracle {n.tour_oracle} "
        "--oracle-margin 0.3 --policies naive fixed arrive face_goal analytic refined gated "
        "--models models/tour --out docs/evaluation_tour",
        ("tour:train",),
    )

    # A building with walls: docs/maps.md.
    yield Step(
        "building:collect",
        f"collect --domain building --seed 151 --episodes {n.few[-1]} --out building.parquet",
    )
    yield Step(
        "building:fresh",
        f"collect --domain building --seed 251 --episodes {n.fresh_drives} "
        "--out building_fresh.parquet",
    )
    yield Step(
        "building:train",
        "train building.parquet --fresh building_fresh.parquet --domain building "
        "--models models/building",
        ("building:collect", "building:fresh"),
    )

    # Few drives of other servers, learning on the job, other robots: docs/results_conditions.md.
    drives = " ".join(map(str, n.few))
    servers = (("tour", drives), ("pursuit", drives), ("building", str(n.few[-1])))
    for domain, numbers in servers:
        yield Step(
            f"few_drives:{domain}",
            f"{scripts}/few_drives.py --domains {domain} --drives {numbers} --chains {n.rounds} "
            f"--oracle {n.tour_oracle // 2} --work few_drives --out few_{domain}.md",
        )
    # Six stations in any order, with models from few drives: docs/rounds.md.
    policies = (
        "listed_fixed listed listed_refined nearest_refined straight_refined route_refined refined"
    )
    for domain, *_ in servers:
        models = f"few_drives/{domain}_{n.few[-1]}/models"
        yield Step(
            f"rounds:{domain}",
            f"evaluate --domain {domain} --chain round --seed 2050 --situations {n.orders} "
            f"--policies {policies} --models {models} --out rounds/{domain}",
            (f"few_drives:{domain}",),
        )
    evaluated = [f"rounds:{domain}" for domain, *_ in servers]
    folders = " ".join(name.replace(":", "/") for name in evaluated)
    yield Step("rounds:table", f"{scripts}/rounds.py {folders}", tuple(evaluated))
    # The same with stations that may be passed, by newer goals and through poses.
    for name, domain in (("passing", "patrol"), ("through", f"{ROOT}/config/patrol/through.yaml")):
        patrol = f"--domain {domain} --models models_{name}"
        legs = f"collect --domain {domain} --seed 2070 --episodes {n.patrol_drives}"
        yield Step(f"{name}:collect", f"{legs} --out {name}.parquet")
        yield Step(f"{name}:train", f"train {patrol} {name}.parquet", (f"{name}:collect",))
        yield Step(
            f"{name}:evaluate",
            f"evaluate {patrol} --chain round --seed 2071 --situations {n.patrol_rounds} "
            f"--policies stepwise passing refined --out rounds/{name}",
            (f"{name}:train",),
        )
        yield Step(f"{name}:table", f"{scripts}/rounds.py rounds/{name}", (f"{name}:evaluate",))
    job = f"{benchmarks}/on_the_job.py --domain pursuit --chains {n.on_the_job} --seed 2041"
    yield Step("few_drives:on_the_job", f"{job} --work on_the_job")
    for file in STUDIED:
        robot = Path(file).stem
        yield Step(
            f"studies:{robot}",
            f"study --robot {ROOT}/{file} --episodes {n.study_episodes} "
            f"--situations {max(n.tours, 10)} --seed 71 --out studies/{robot}",
        )


def with_needed(chosen: Sequence[str], every: Sequence[Step]) -> list[Step]:
    """Return the steps of the chosen parts, or all, and those that they need, in order.

    Raises SystemExit for an unknown part.
    """
    parts = dict.fromkeys(step.name.partition(":")[0] for step in every)
    if unknown := set(chosen) - parts.keys():
        raise SystemExit(f"reproduce: expected parts of {', '.join(parts)}, got {unknown}")
    by_name = {step.name: step for step in every}
    waiting = [step for step in every if not chosen or step.name.partition(":")[0] in chosen]
    needed: set[str] = set()
    while waiting:
        step = waiting.pop()
        needed.add(step.name)
        waiting += [by_name[name] for name in step.needs]
    return [step for step in every if step.name in needed]


def digest() -> str:
    """Return a digest of the code and the configuration."""
    sha = hashlib.sha256()
    for folder in ("ator_ros", "ator_ros_examples", "benchmarks", "config", "scripts"):
        for file in sorted((ROOT / folder).rglob("*")):
            if file.suffix in (".py", ".yaml"):
                sha.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return sha.hexdigest()[:12]


def clock(seconds: float) -> str:
    """Return a duration in s as H:MM:SS."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


class Run:
    """Executes steps in a working folder, where finished steps are recorded.

    Parameters
    ----------
    planned : sequence of Step
        The steps; a step comes after those that it needs.
    work : Path
        The folder.
    """

    def __init__(self, planned: Sequence[Step], work: Path) -> None:
        self.planned = planned
        self.work = work
        for name in ("logs", "done", "models", "docs"):
            (work / name).mkdir(parents=True, exist_ok=True)
        self._running: dict[int, tuple[Step, subprocess.Popen[bytes], float]] = {}
        self._begin = time.monotonic()

    def _record(self, step: Step) -> Path:
        return self.work / "done" / f"{step.name.replace(':', '_')}.json"

    def _log(self, step: Step) -> Path:
        return self.work / "logs" / f"{step.name.replace(':', '_')}.txt"

    def _is_done(self, step: Step) -> bool:
        record = self._record(step)
        return record.exists() and json.loads(record.read_text())["command"] == step.command

    def _say(self, text: str) -> None:
        done = sum(map(self._is_done, self.planned))
        elapsed = clock(time.monotonic() - self._begin)
        print(f"{elapsed} [{done} of {len(self.planned)}] {text}", flush=True)

    def execute(self) -> bool:
        """Execute the steps that are not done, and return whether all are done now."""
        waiting = [step for step in self.planned if not self._is_done(step)]
        failed: set[str] = set()
        while waiting or self._running:
            done = {step.name for step in self.planned if self._is_done(step)}
            ready = [step for step in waiting if done.issuperset(step.needs)]
            for step in ready[: LANES - len(self._running)]:
                waiting.remove(step)
                self._start(step)
            if not self._running:
                break
            failed |= self._wait()
        return not waiting and not failed

    def _start(self, step: Step) -> None:
        self._say(f"{step.name}: {step.command}")
        if step.name == "few_drives:on_the_job":
            shutil.rmtree(self.work / "on_the_job", ignore_errors=True)
        words = shlex.split(step.command)
        if words[0] != "python":
            words[0] = str(ROOT / "install" / "lib" / "ator_ros" / words[0])
        # Two steps share two cores.
        threads = ("LOKY_MAX_CPU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
        environment = os.environ | dict.fromkeys(threads, "1")
        with self._log(step).open("wb") as log:
            process = subprocess.Popen(
                words, cwd=self.work, env=environment, stdout=log, stderr=log
            )
        self._running[process.pid] = (step, process, time.monotonic())

    def _wait(self) -> set[str]:
        """Wait for a step to end; return its name if it failed."""
        pid, status, usage = os.wait3(0)
        step, process, begin = self._running.pop(pid)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            log = self._log(step)
            end = "\n".join(log.read_text(errors="replace").splitlines()[-5:])
            self._say(f"{step.name} FAILED with {process.returncode}, see {log}:\n{end}")
            return {step.name}
        wall = round(time.monotonic() - begin, 1)
        cpu = round(usage.ru_utime + usage.ru_stime, 1)
        record = {"command": step.command, "wall_s": wall, "cpu_s": cpu}
        self._record(step).write_text(json.dumps(record))
        self._say(f"{step.name} done in {clock(wall)}, {clock(cpu)} of a core")
        return set()

    def stop(self) -> None:
        """End the running steps."""
        for _, process, _ in self._running.values():
            process.terminate()
        for _, process, _ in self._running.values():
            process.wait()

    def times(self) -> str:
        """Return a table of the times of all finished steps, also those of interrupted runs."""
        lines = []
        wall = cpu = 0.0
        for step in filter(self._is_done, self.planned):
            record = json.loads(self._record(step).read_text())
            lines.append(f"{step.name:26} {clock(record['wall_s']):>9} {clock(record['cpu_s']):>9}")
            wall += record["wall_s"]
            cpu += record["cpu_s"]
        lines.append(f"{'sum':26} {clock(wall):>9} {clock(cpu):>9}")
        return "\n".join([f"{'step':26} {'time':>9} {'of a core':>9}", *lines])


def publish(work: Path, out: Path) -> None:
    """Copy models, reports and figures to `out`; write the pages' tables if they ship there."""
    for folder in ("models", "docs"):
        shutil.copytree(work / folder, out / folder, dirs_exist_ok=True)
    for study in work.glob("studies/*/study.json"):
        place = out / "docs" / "studies" / f"{study.parent.name}.json"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(study, place)
    if out == ROOT:
        subprocess.run([sys.executable, ROOT / "scripts" / "tables.py", work], check=True)


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog="reproduce", description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help="default: all")
    parser.add_argument("--small", action="store_true", help="everything at a very small size")
    parser.add_argument(
        "--out", type=Path, default=ROOT, help="default: where models/ and docs/ ship"
    )
    parser.add_argument("--list", action="store_true", help="print the steps, execute none")
    options = parser.parse_args(argv)
    if options.small and not options.list and options.out.resolve() == ROOT:
        parser.error("--small: expected --out, too: a trial replaces nothing that ships")
    sizes = SMALL if options.small else Sizes()
    planned = with_needed(options.parts, list(steps(sizes)))
    if options.list:
        for step in planned:
            print(f"{step.name}: {step.command}")
        return 0
    name = f"{digest()}_small" if options.small else digest()
    run = Run(planned, ROOT / "out" / "reproduce" / name)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        complete = run.execute()
    except KeyboardInterrupt:
        run.stop()
        print("interrupted; the same command resumes", file=sys.stderr)
        return 130
    print(run.times())
    if not complete:
        print("not complete; the same command tries again", file=sys.stderr)
        return 1
    publish(run.work, options.out.resolve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
