"""A web page of what Meshcat shows: one file without a network, with a legend, switches, the result and a timeline.

It is Drake's static page of Meshcat with a panel beside it.
"""

import dataclasses
import html
import json
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from pydrake.geometry import Meshcat

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.output_files import written_beside
from tactopose_drake.visualization.appearance import AXIS_COLOURS, FALSE_CONTACT, Colour, Look
from tactopose_drake.visualization.page_tables import Instant, PageTable, said_html, table_html
from tactopose_drake.visualization.timeline import Timeline, timeline_html

_HAND = "^(/tactopose/hand|/drake/visualizer)(/|$)"
# Of Drake's page: the text before its commands, and the text with which each is passed to the viewer.
_BEFORE_COMMANDS = "casAssets = {};"
_COMMAND = ".then(buffer => viewer.handle_command_bytearray("
_COUNTER = """
var tactoposeTold = 0;
{
  const tell = viewer.handle_command_bytearray.bind(viewer);
  viewer.handle_command_bytearray = (buffer) => { try { tell(buffer); } finally { tactoposeTold++; } };
}
"""


class Switch(NamedTuple):
    """An entry of the legend, with a checkbox that shows and hides the part.

    Attributes:
        look: appearance of the part.
        hides: pattern of the part's paths in Meshcat.
        detail: explanation in the legend; the look's meaning by default.
        is_on: whether the part is visible at first.
    """

    look: Look
    hides: str
    detail: str = ""
    is_on: bool = True


class Label(NamedTuple):
    """A text that moves with a part of the scene.

    Attributes:
        path: path of the part in Meshcat.
        text: the text.
        colour: colour of the text; replaced by that of a false contact while the part shows one.
        at: position in the part's frame, m.
        free: the row of a free direction, whose name at the time of a recording replaces the text; None for others.
    """

    path: str
    text: str
    colour: Colour
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    free: int | None = None


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Page:
    """The content of the panel beside a scene, of its labels, and of its first view.

    Attributes:
        title: the page's title.
        said: the result and the contacts; of a recording, those at its end.
        tables: further tables, above the legend.
        switches: the legend.
        details: further tables, below the legend.
        labels: texts in the scene.
        direction_W: direction from the scene to the camera in Meshcat's world, shape (3,).
        p_WQ: points that the first view holds, shape (n, 3), m; empty to keep Meshcat's own camera.
        timeline: timeline of a recording that Meshcat has published; None if there is none.
    """

    title: str
    said: Instant
    tables: tuple[PageTable, ...] = ()
    switches: tuple[Switch, ...] = ()
    details: tuple[PageTable, ...] = ()
    labels: tuple[Label, ...] = ()
    direction_W: FloatArray
    p_WQ: FloatArray
    timeline: Timeline | None = None


def save_html(path: Path, meshcat: Meshcat, page: Page | None = None) -> None:
    """Writes what Meshcat shows, with its published recording, as one web page that works without a network.

    Args:
        path: the file.
        meshcat: the display.
        page: the content of the panel; None writes Meshcat's own page.

    Raises:
        InvalidFileError: if the file cannot be written.
    """
    static = meshcat.StaticHtml()
    text = static if page is None else with_panel(static, page)
    with written_beside(path) as beside:
        # A file's name may have bytes that are no UTF-8.
        beside.write_text(text, encoding="utf-8", errors="backslashreplace")


def with_panel(static: str, page: Page) -> str:
    """Adds the panel of a page to Meshcat's static page."""
    assert static.count(_BEFORE_COMMANDS) == 1, "Drake's static page is not as it was"
    assert static.count("<title>Drake MeshCat</title>") == 1, "Drake's static page is not as it was"
    static = static.replace("<title>Drake MeshCat</title>", f"<title>{html.escape(page.title)}</title>")
    static = static.replace(_BEFORE_COMMANDS, _COUNTER + _BEFORE_COMMANDS)
    data = {
        "commands": static.count(_COMMAND),
        "view": {"direction": page.direction_W.tolist(), "points": page.p_WQ.tolist()} if len(page.p_WQ) else None,
        "falseColour": _css(FALSE_CONTACT.colour),
        "labels": [{**label._asdict(), "colour": _css(label.colour)} for label in page.labels],
        "timeline": None if page.timeline is None else page.timeline.data(),
    }
    head, tail = static.rsplit("</body>", 1)
    parts = [
        f"<style>{_asset('page.css')}{'' if page.timeline is None else page.timeline.css()}</style>",
        _side(page),
        "" if page.timeline is None else timeline_html(page.timeline),
        f'<script type="application/json" id="tp-data">{json.dumps(data).replace("</", "<" + chr(92) + "/")}</script>',
        f"<script>{_asset('page.js')}</script>",
    ]
    return head + "\n".join(parts) + "</body>" + tail


def _side(page: Page) -> str:
    """The panel beside the scene."""
    when = "" if page.timeline is None else f"At {page.timeline.end:.2f} s"
    lines = ['<aside id="tp-side">', f"<h1>{html.escape(page.title)}</h1>"]
    lines.append(f'<div id="tp-said">{said_html(page.said, when)}</div>')
    lines += [table_html(table) for table in page.tables]
    lines.append(f'<div id="tp-hypotheses">{table_html(page.said.hypotheses)}</div>')
    lines.append('<h2>What is shown</h2><ul class="tp-legend">')
    lines += [_switch(switch) for switch in page.switches]
    if any(switch.hides == _HAND for switch in page.switches):
        box = f'<input type="checkbox" id="tp-see-through" data-thins="{html.escape(_HAND)}" checked>'
        lines.append(f"<li><label>{box}<span></span><span>see through the hand</span></label></li>")
    lines.append("</ul>")
    lines.append(f'<div id="tp-contacts">{table_html(page.said.contacts)}</div>')
    lines += [table_html(table) for table in page.details]
    lines.append(
        '<div class="tp-buttons"><button id="tp-frame">First view</button><button id="tp-theme">Light / dark</button>'
        '<button id="tp-expert">More controls</button></div>'
        '<p class="tp-more">Drag to turn, scroll to zoom, drag with the right button to move.</p></aside>'
    )
    return "\n".join(lines)


def hand_switch(look: Look) -> Switch:
    """The switch of the hand, whether drawn or simulated."""
    return Switch(look, _HAND)


def _switch(switch: Switch) -> str:
    look, on = switch.look, " checked" if switch.is_on else ""
    return (
        f'<li><label><input type="checkbox" data-hides="{html.escape(switch.hides)}"{on}>{_swatch(look)}'
        f"<span>{html.escape(look.name)}<small>{html.escape(switch.detail or look.meaning)}</small></span></label></li>"
    )


def _swatch(look: Look) -> str:
    """The symbol of a part in the legend."""
    colour = _css(look.colour)
    drawings = {
        "solid": f'<rect x="3" y="2" width="18" height="12" rx="2" fill="{colour}"/>',
        "ghost": f'<rect x="3" y="2" width="18" height="12" rx="2" fill="{colour}" opacity="0.4"/>',
        "line": f'<rect x="4" y="3" width="16" height="10" rx="2" fill="none" stroke="{colour}" stroke-width="2"/>'
        f'<path d="M4 8H20M12 3V13" stroke="{colour}"/>',
        "ball": f'<circle cx="12" cy="8" r="4.5" fill="{colour}"/>',
        "cross": f'<path d="M7 3L17 13M17 3L7 13" stroke="{colour}" stroke-width="2.5"/>',
        "pin": f'<path d="M4 8H20" stroke="{colour}" stroke-width="1.5"/>',
        "arrow": f'<path d="M2 8H15" stroke="{colour}" stroke-width="2.5"/>'
        f'<path d="M14 3L22 8L14 13Z" fill="{colour}"/>',
        "turn": f'<path d="M17 11A6 5 0 1 1 17 5" fill="none" stroke="{colour}" stroke-width="2"/>'
        f'<path d="M14 10L20 9L18 15Z" fill="{colour}"/>',
        "ellipsoid": '<ellipse class="tp-region" cx="12" cy="8" rx="7" ry="4.5" stroke="#8fa3c8" stroke-width="0.8"/>',
        "frame": "".join(
            f'<path d="M9 10{to}" stroke="{_css(axis)}" stroke-width="2"/>'
            for to, axis in zip(("H20", "L3 15", "V1"), AXIS_COLOURS, strict=True)
        ),
        "cone": f'<path d="M3 8L20 2V14Z" fill="{colour}" opacity="0.45"/>',
        "cell": f'<path d="M5 2h6v5h-6zM13 2h6v5h-6zM5 9h6v5h-6z" fill="{colour}"/>',
    }
    return f'<svg viewBox="0 0 24 16" aria-hidden="true">{drawings[look.mark]}</svg>'


def _css(colour: Colour) -> str:
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in colour)


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
