"""The timeline of a recording on a page: a strip of its status, and plots on the same time axis."""

import dataclasses
import html
from typing import Any, NamedTuple

import numpy as np

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.visualization.appearance import Look
from tactopose_drake.visualization.page_tables import Instant, said_html, state_name, state_text, table_html

# Colours of statuses by their first word, distinguishable with red-green colour blindness; the names are shown, too.
_STATES = {
    "ok": "#2f8fd0",
    "ambiguous": "#e8b23a",
    "slipping": "#b9589f",
    "lost": "#9b2226",
    "no_solution": "#9b2226",
    "no solution": "#9b2226",
}
_OTHER_STATE = "#9aa3ad"
# The colours of Okabe and Ito, without those that are too light on white.
_LINES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#7a7a7a")
_HEIGHT, _KEY_HEIGHT = 100, 18  # height of the timeline without plots, and of a plot's legend, px
_MOST_TICKS = 8  # on the time axis


class Curve(NamedTuple):
    """A line of a plot.

    Attributes:
        name: its name.
        values: one value for each time of the timeline, shape (n,); NaN for a missing one.
    """

    name: str
    values: FloatArray


class Plot(NamedTuple):
    """Curves over time.

    Attributes:
        title: the plot's title.
        unit: unit of the values.
        curves: the lines.
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]


@dataclasses.dataclass(frozen=True, eq=False)
class Timeline:
    """The status, plots and sentences of a recording over time.

    Attributes:
        times: increasing times, shape (n,), s.
        states: the status at each time; its first word determines the colour.
        plots: plots on the same time axis.
        said: the page's sentences and tables at each time; empty if they do not change.
        looks: what is drawn at any time, for the legend; what is drawn at the end is in it in any case.
    """

    times: FloatArray
    states: tuple[str, ...]
    plots: tuple[Plot, ...] = ()
    said: tuple[Instant, ...] = ()
    looks: frozenset[Look] = frozenset()

    @property
    def end(self) -> float:
        """The last time, s."""
        return float(self.times[-1])

    def pieces(self) -> list[tuple[float, float, str]]:
        """Intervals of constant status: start, end, s, and the status."""
        starts = [0] + [row for row in range(1, len(self.states)) if self.states[row] != self.states[row - 1]]
        ends = [*(float(self.times[row]) for row in starts[1:]), self.end]
        return [(float(self.times[row]), end, self.states[row]) for row, end in zip(starts, ends, strict=True)]

    def data(self) -> dict[str, Any]:
        """The data for the page's script."""
        return {
            "end": self.end,
            "strip": [{"from": start, "text": state_text(text)} for start, _, text in self.pieces()],
            "said": [
                {"from": float(time), **_parts(said, float(time))}
                for time, said in zip(self.times, self.said, strict=False)
            ],
        }

    def css(self) -> str:
        """The style rule with the timeline's height."""
        keys = sum(len(plot.curves) > 1 for plot in self.plots)
        return f":root {{ --foot: calc({_HEIGHT + keys * _KEY_HEIGHT}px + {len(self.plots)} * var(--plot)); }}"


def timeline_html(timeline: Timeline) -> str:
    """The slider, the strip and the plots."""
    end = timeline.end
    strip = "".join(
        f'<i style="left:{100 * start / end:.3f}%;width:{100 * (stop - start) / end:.3f}%;'
        f'background:{state_colour(text)}" title="{html.escape(state_text(text))}"></i>'
        for start, stop, text in timeline.pieces()
    )
    names = dict.fromkeys(_word(text) for _, _, text in timeline.pieces() if text)
    key = " ".join(
        f'<span style="color:{state_colour(name)}">\u25a0</span> {html.escape(state_name(name))}' for name in names
    )
    rows = [
        '<div class="tp-row"><span class="tp-wide"><button id="tp-play">Play</button> <b id="tp-seconds"></b></span>'
        f'<div class="tp-track"><input type="range" id="tp-time" min="0" max="{end:.4f}" step="0.01" '
        f'aria-label="time, s"></div></div>',
        f'<div class="tp-row"><span class="tp-wide">status</span><div class="tp-track"><div class="tp-strip">{strip}'
        '</div><div class="tp-cursor"></div></div></div>',
        f'<div class="tp-row"><span class="tp-wide"></span><div class="tp-key">{key} <i id="tp-now"></i></div></div>',
        *(_plot(plot, timeline.times) for plot in timeline.plots),
        f'<div class="tp-row"><span class="tp-wide">time, s</span><div class="tp-track tp-axis">'
        f"{_time_axis(end)}</div></div>",
    ]
    return '<footer id="tp-foot">' + "".join(rows) + "</footer>"


def _parts(said: Instant, time: float) -> dict[str, Any]:
    """The contents of the page's elements at an instant, by their ids without the prefix, and the arrows' names."""
    return {
        "said": said_html(said, f"At {time:.2f} s"),
        "hypotheses": table_html(said.hypotheses),
        "contacts": table_html(said.contacts),
        "free": said.free,
    }


def _time_axis(end: float) -> str:
    """Ticks at round numbers along the time axis."""
    rough = end / _MOST_TICKS
    decade = 10.0 ** np.floor(np.log10(rough))
    step = next(times * decade for times in (1.0, 2.0, 5.0, 10.0) if times * decade >= rough)
    ticks = step * np.arange(int(end / step + 1e-9) + 1)
    return "".join(f'<i style="left:{100 * tick / end:.3f}%">{tick:.6g}</i>' for tick in ticks)


def state_colour(text: str) -> str:
    """Colour of a status."""
    return _STATES.get(_word(text), _OTHER_STATE)


def _word(text: str) -> str:
    return text.split(":")[0]


def _plot(plot: Plot, times: FloatArray) -> str:
    values = np.concatenate([curve.values for curve in plot.curves]) if plot.curves else np.zeros(1)
    finite = values[np.isfinite(values)]
    most = max(float(finite.max()), 1e-12) if len(finite) else 1.0
    lines, key = [], []
    for index, curve in enumerate(plot.curves):
        colour = _LINES[index % len(_LINES)]
        key.append(f'<span style="color:{colour}">\u2015 {html.escape(curve.name)}</span>')
        for rows in _finite_runs(curve.values):
            points = " ".join(
                f"{1000 * times[row] / times[-1]:.1f},{100 - 96 * curve.values[row] / most:.1f}" for row in rows
            )
            lines.append(f'<polyline points="{points}" stroke="{colour}"/>')
    names = f'<div class="tp-row"><span class="tp-wide"></span><div class="tp-key">{" ".join(key)}</div></div>'
    return (
        (names if len(key) > 1 else "")
        + f'<div class="tp-row tp-plot"><span>{html.escape(plot.title)}, {html.escape(plot.unit)}</span>'
        f'<span class="tp-ticks"><i>{most:.2g}</i><i>0</i></span><div class="tp-track">'
        f'<svg viewBox="0 0 1000 100" preserveAspectRatio="none">{"".join(lines)}</svg>'
        '<div class="tp-cursor"></div></div></div>'
    )


def _finite_runs(values: FloatArray) -> list[list[int]]:
    """Runs of consecutive rows with finite values."""
    runs: list[list[int]] = [[]]
    for row, value in enumerate(values):
        if np.isfinite(value):
            runs[-1].append(row)
        elif runs[-1]:
            runs.append([])
    return [run for run in runs if run]
