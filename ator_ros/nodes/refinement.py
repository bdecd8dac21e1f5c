"""The node `refinement`: subgoal refinement as a service (paper, section 4)."""

from __future__ import annotations

import time
from pathlib import Path

from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.catalogue import ACTION_SETS
from ator_ros.nodes import conversions
from ator_ros.nodes.checks import MessageError
from ator_ros.nodes.diagnostics import Diagnostics, Health
from ator_ros.nodes.model_sets import ModelSet, problems_of, read_models, told_of
from ator_ros.nodes.parameters import Parameter, SetupError, declare_parameters, digest_of
from ator_ros.nodes.qos import RESULTS
from ator_ros.nodes.refinement_answers import answer_of, markers_of, refusal_of
from ator_ros.nodes.rehearsal import rehearse_refinement
from ator_ros.nodes.running import run_node
from ator_ros.performance.model_file import model_path
from ator_ros.refinement.answer import Refinement
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.gate_file import load_gate
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot import ConfigError, Robot, load_robot
from ator_ros.tops.library import TopLibrary

PARAMETERS = (
    Parameter("frame", "odom", "frame that situations and goals must be given in"),
    Parameter("models", "", "folder of the performance models and the gate; empty: those that are shipped"),
    Parameter("gate", True, "whether to refine only where the gate expects that it pays"),
)

_WARNING_PERIOD = 2.0


class RefinementNode(Node):
    """Rewrites the free variables of chains of TOPs so that the whole chain performs best.

    Parameters: see `PARAMETERS`; all are read at the start only.

    Services
        refine_subgoal (ator_interfaces/RefineSubgoal): the refined chain, or the chain as it came, with the
        reason. A request that cannot be evaluated is answered with accepted = false.
    Publishes
        refinement_markers (visualization_msgs/MarkerArray): what was searched, when somebody listens.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    """

    def __init__(self) -> None:
        super().__init__("refinement")
        self._settings = declare_parameters(self, PARAMETERS)
        self._refiners: dict[str, Refiner] = {}
        self._libraries: dict[str, TopLibrary] = {}
        self._models: dict[str, ModelSet] = {}
        try:
            robot = load_robot()
        except ConfigError as error:
            raise SetupError(str(error)) from error
        for action_set in ACTION_SETS:
            self._load(robot, action_set)
        self._digests = {"robot digest": robot.digest(), "parameters digest": digest_of(self._settings)}
        self._answered, self._refused = 0, 0
        self._last_refusal, self._last_time = "", 0.0
        self._markers = self.create_publisher(MarkerArray, "refinement_markers", RESULTS)
        self._service = self.create_service(RefineSubgoal, "refine_subgoal", self._serve)
        self._diagnostics = Diagnostics(self, self._health)
        self.get_logger().info(f"refining chains of the action sets {', '.join(self._refiners) or '(none)'}")

    def _load(self, robot: Robot, action_set: str) -> None:
        """Read models and gate of one action set; without models its chains are refused, with the reason."""
        self._libraries[action_set] = TopLibrary(robot, action_set)
        self._models[action_set] = read = read_models(self, robot, action_set, self._settings["models"])
        if read.models:
            gate = self._load_gate(read.folder / model_path("gate", action_set))
            self._refiners[action_set] = Refiner(robot, read.models, gate, calibration=read.calibration)
            rehearse_refinement(self._libraries[action_set], self._refiners[action_set])

    def _load_gate(self, file: Path) -> Gate | None:
        """Read a gate; without one, refinement goes by the predicted gain alone."""
        if not self._settings["gate"]:
            return None
        try:
            return load_gate(file)
        except RefinementError as error:
            self.get_logger().warning(f"no gate, refining whenever a gain is predicted: {error}")
            return None

    def _serve(self, request: RefineSubgoal.Request, _: RefineSubgoal.Response) -> RefineSubgoal.Response:
        began, frame = time.perf_counter(), self._settings["frame"]
        try:
            action_set = conversions.action_set_from(request.chain, allowed=self._libraries)
            refinement = self._refine(request, action_set)
        except (MessageError, RefinementError) as error:
            self._refused, self._last_refusal = self._refused + 1, str(error)
            self.get_logger().warning(f"refused: {error}", throttle_duration_sec=_WARNING_PERIOD)
            response = refusal_of(request, str(error))
        else:
            self._answered += 1
            wanted = request.want_curve
            response = answer_of(refinement, action_set=action_set, frame=frame, want_curve=wanted)
            if self._markers.get_subscription_count():
                self._markers.publish(markers_of(refinement, frame=frame))
        self._last_time = response.computation_time = time.perf_counter() - began
        return response

    def _refine(self, request: RefineSubgoal.Request, action_set: str) -> Refinement:
        if action_set not in self._refiners:
            raise RefinementError(f"action set {action_set}: {self._models[action_set].absent}")
        library, refiner = self._libraries[action_set], self._refiners[action_set]
        return refinement_of(request, refiner, library, frame=self._settings["frame"])

    def _health(self) -> Health:
        problem = problems_of(self._models)
        return Health(
            problem if self._refiners else problem or "no models for any action set",
            error=not self._refiners,
            values={
                **told_of(self._models),
                "requests answered": self._answered,
                "requests refused": self._refused,
                "last error": self._last_refusal,
                **self._digests,
                "last computation (ms)": f"{1000.0 * self._last_time:.2f}",
            },
        )


def refinement_of(
    request: RefineSubgoal.Request, refiner: Refiner, library: TopLibrary, *, frame: str
) -> Refinement:
    """Do what a request asks for.

    Raises
    ------
    MessageError, RefinementError
        It cannot be read, or not be evaluated.
    """
    world = conversions.world_from(request.situation, frame=frame)
    chain = conversions.chain_from(request.chain, library, frame=frame)
    objective = conversions.objective_from(request.objective)
    if any(call.open for call in request.chain.calls):  # else one analysis, that of `refine`, will do
        chain = conversions.opened(chain, request.chain, refiner.analyse(world, chain).free)
    return refiner.refine(world, chain, objective)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(RefinementNode, PARAMETERS, args)
