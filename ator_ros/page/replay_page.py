"""The page of a recording: its scene at a time that plays, stands or is chosen, and the chain then."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping

import viser

from ator_ros.domains.domain import Domain
from ator_ros.page.drawing import NO_ANGLES, Canvas, RobotModel, rgb, write
from ator_ros.page.history_tab import HistoryTab
from ator_ros.page.replay_controls import ReplayControls
from ator_ros.page.serving import LOOPBACK, served
from ator_ros.robot.description import Robot
from ator_ros.viewing import replay_panel
from ator_ros.viewing.chain_picture import picture_under_way
from ator_ros.viewing.inbox import Inbox
from ator_ros.viewing.player import Player
from ator_ros.viewing.recording import PlayedChain, RecordedRobot
from ator_ros.viewing.shapes import BLUE, GREY, ORANGE, polyline
from ator_ros.world.state import World

_WRITE_PERIOD = 0.2
_TRAIL_WIDTH = 0.025
_MOST_PLACES = 400


class ReplayPage:
    """Serves a page on one port; `update` is called regularly by one thread.

    Parameters
    ----------
    robots : mapping of str to RecordedRobot
        What was recorded, by namespace; one is played, and the others are where they were at its time.
    domain, robot : Domain, Robot
        What is drawn.
    urdf : str
        The robot's description for drawing.
    host, port : str, int
        Where the page is served; by default only this machine can reach it.
    """

    def __init__(
        self,
        robots: Mapping[str, RecordedRobot],
        domain: Domain,
        robot: Robot,
        urdf: str,
        *,
        host: str = LOOPBACK,
        port: int = 8080,
    ) -> None:
        self.inbox = Inbox()
        self.server = server = served(domain, robot, host=host, port=port)
        self._robots, self._name = robots, next(iter(robots))
        self.player = Player(self.recorded.duration)
        self._area = area = robot.scene.area
        self._chain, self._trail = Canvas(server, "/chain", area), Canvas(server, "/trails", area, 0.03)
        self._model = RobotModel(server, "/robot", urdf, area)
        self._others = {
            name: RobotModel(server, f"/robots/{number}", urdf, area) for number, name in enumerate(robots)
        } if len(robots) > 1 else {}  # fmt: skip
        self._objects = {name: _sphere(server, robot, name) for name in robot.scene.objects}
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Replay"):
            self._controls = ReplayControls(server.gui, self, tuple(robots))
        self._history = HistoryTab(server.gui, tabs.add_tab("History"))
        self._written = -math.inf

    @property
    def recorded(self) -> RecordedRobot:
        """The robot that is played."""
        return self._robots[self._name]

    def choose(self, name: str) -> None:
        """Play another robot, from the same stamp on if it was recorded then."""
        former, stamp = self.player, self.recorded.world(self.player.seconds).time
        self.player, self._name = Player(self._robots[name].duration), name
        self.player.speed, self.player.playing = former.speed, former.playing
        self.player.seek(self.recorded.seconds_at(stamp))
        self._controls.restart()

    def update(self, now: float, angles: Mapping[str, float] = NO_ANGLES) -> World:
        """Let time pass and show what is new; return the state that is shown.

        Parameters
        ----------
        now : float
            Time in s of any clock that does not go back.
        angles : mapping
            Of the robot's joints in rad, by name.
        """
        for wish in self.inbox.take():
            with contextlib.suppress(LookupError, TypeError, ValueError):  # a client may send anything
                wish()
        self.player.tick(now)
        world = self.recorded.world(self.player.seconds)
        played = self.recorded.chain(self.player.seconds)
        with self.server.atomic():
            self._show(world, angles)
            self._show_chain(played, world.time)
            if now - self._written >= _WRITE_PERIOD:
                self._written = now
                self._write(played, world.time)
        return world

    def _show(self, world: World, angles: Mapping[str, float]) -> None:
        self._model.show(world.robot.pose, angles)
        for name, model in self._others.items():
            there = None if name == self._name else self._robots[name].world_at_stamp(world.time)
            model.show(None if there is None else there.robot.pose)
        for name, sphere in self._objects.items():
            at = world.objects.get(name)
            if sphere.visible != (at is not None):
                sphere.visible = at is not None
            if at is None:
                continue
            place = (at.x - self._area.x, at.y - self._area.y)
            if tuple(sphere.position[:2]) != place:
                sphere.position = (*place, sphere.position[2])

    def _show_chain(self, played: PlayedChain | None, stamp: float) -> None:
        if played is None or self.player.seconds > played.ended:
            self._chain.draw(())
            return
        chain = played.chain
        step = max((step.number for step in chain.steps if step.began <= stamp), default=0)
        colour = BLUE if chain.driven.refined else GREY
        self._chain.draw(picture_under_way(chain.start, chain.goals, step, colour))

    def _write(self, played: PlayedChain | None, stamp: float) -> None:
        recorded, seconds = self.recorded, self.player.seconds
        number = 0 if played is None else recorded.chains.index(played) + 1
        self._controls.show(self.player)
        write(self._controls.clock, replay_panel.clock(self.player, stamp))
        write(self._controls.chain, replay_panel.chain(played, stamp, number, len(recorded.chains)))
        self._history.show(recorded.history)
        begin, end = (0.0, seconds) if played is None else (played.began, min(seconds, played.ended))
        refined = played is not None and played.chain.driven.refined
        places = recorded.trail(begin, end, _MOST_PLACES)
        self._trail.draw([polyline("driven", places, BLUE if refined else ORANGE, _TRAIL_WIDTH)])

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()


def _sphere(server: viser.ViserServer, robot: Robot, name: str) -> viser.IcosphereHandle:
    radius = robot.scene.radius(name)
    place = (0.0, 0.0, radius)
    return server.scene.add_icosphere(f"/objects/{name}", radius, rgb(ORANGE), position=place, visible=False)
