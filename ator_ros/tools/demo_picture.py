"""The demo's picture: naive and refined paths on the field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ator_ros.files import replaced
from ator_ros.geometry import Pose
from ator_ros.world import Field

Path2D = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Panel:
    """One situation: start, naive and refined path of the robot, refined path of the ball, times in s."""

    start: Pose
    ball: tuple[float, float]
    naive: Path2D
    refined: Path2D
    rolled: Path2D
    times: tuple[float, float]


def draw(path: Path, field: Field, panels: Sequence[Panel]) -> None:
    """Draw all situations side by side to the PNG file `path`."""
    from matplotlib.figure import Figure

    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(4.4 * columns, 3.0 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for number, (area, panel) in enumerate(zip(axes, panels, strict=False), start=1):
        _draw_field(area, field)
        naive, refined = panel.times
        area.plot(
            *zip(*panel.naive, strict=True), color="tab:gray", lw=1.5, ls="--", label=f"naive {naive:.1f} s"
        )
        area.plot(*zip(*panel.refined, strict=True), color="tab:red", lw=2, label=f"refined {refined:.1f} s")
        area.plot(*zip(*panel.rolled, strict=True), color="tab:orange", lw=1, label="ball, refined")
        area.plot(*panel.ball, "o", color="tab:orange")
        heading = panel.start.ahead(0.35)
        area.plot([panel.start.x, heading.x], [panel.start.y, heading.y], color="black")
        area.plot(panel.start.x, panel.start.y, "ks", markersize=5)
        area.set_title(f"situation {number}", fontsize="medium")
        area.legend(fontsize="x-small", loc="upper left")
    for area in axes[len(panels) :]:
        area.set_axis_off()
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _draw_field(area: object, field: Field) -> None:
    x, y, half = field.length / 2, field.width / 2, field.goal_width / 2
    draw_line = area.plot  # type: ignore[attr-defined]
    draw_line([-x, x, x, -x, -x], [-y, -y, y, y, -y], color="tab:green", lw=1)
    for sign in (-1, 1):
        back = sign * (x + field.goal_depth)
        draw_line([sign * x, back, back, sign * x], [half, half, -half, -half], color="tab:blue", lw=1.5)
    area.set_aspect("equal")  # type: ignore[attr-defined]
    area.set_xticks([])  # type: ignore[attr-defined]
    area.set_yticks([])  # type: ignore[attr-defined]
