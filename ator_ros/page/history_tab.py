"""The tab of a page that shows the chains that were executed."""

from __future__ import annotations

import viser
from viser import uplot

from ator_ros.geometry import FloatArray
from ator_ros.viewing import history

_HEIGHT = 220


class HistoryTab:
    """A table of executed chains and a chart of their predicted and actual times; see `history.told`.

    Parameters
    ----------
    gui : GuiApi
        Of the page's server.
    tab : GuiTabHandle
        Where to show them.
    """

    def __init__(self, gui: viser.GuiApi, tab: viser.GuiTabHandle) -> None:
        self._gui, self._tab = gui, tab
        with tab:
            self._text = gui.add_markdown(history.told(()))
        self._chart: viser.GuiUplotHandle | None = None
        self._shown: tuple[history.History | None, int, str] = (None, 0, "")

    def show(self, driven: history.History, learned: str = "") -> None:
        """Show what is new of the chains, and of the learned set of models in use."""
        if (driven, driven.edition, learned) == self._shown:
            return
        self._shown = driven, driven.edition, learned
        self._text.content = history.told(driven.chains, learned)
        curves = driven.curves()
        if self._chart is not None:
            self._chart.data = curves
        elif len(curves[0]) > 1:  # a single chain makes no curve
            with self._tab:
                self._chart = self._added(curves)

    def _added(self, curves: tuple[FloatArray, ...]) -> viser.GuiUplotHandle:
        return self._gui.add_uplot(
            curves,
            (
                uplot.Series(label="chain"),
                uplot.Series(label="predicted (s)", stroke="#888888", width=2),
                uplot.Series(label="actual (s)", stroke="#2273e6", width=2),
            ),
            height=_HEIGHT,
            scales={"x": uplot.Scale(time=False)},
        )
