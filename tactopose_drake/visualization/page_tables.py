"""The sentences and tables of a page."""

import html
from typing import NamedTuple

_STATE_NAMES = {"held": "no new estimate"}  # statuses whose word would be misleading on a page


class Row(NamedTuple):
    """A row of a page's table.

    Attributes:
        cells: its texts.
        hides: pattern of the paths in Meshcat that a checkbox in the row shows and hides; empty for no checkbox.
        is_on: whether they are visible at first.
    """

    cells: tuple[str, ...]
    hides: str = ""
    is_on: bool = True


class PageTable(NamedTuple):
    """A table of a page.

    Attributes:
        title: its title.
        headings: the headings of its columns.
        rows: its rows.
        more: a remark below it.
        of_words: whether its cells are sentences rather than numbers.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[Row, ...]
    more: str = ""
    of_words: bool = False


class Instant(NamedTuple):
    """The sentences and tables of a page for one instant.

    Attributes:
        status: the status in one word, such as "ok"; empty for none.
        sentences: the belief, its uncertainty, and what is not determined.
        hypotheses: the poses; without rows if there is no estimate.
        contacts: the contacts.
        free: names of the free directions that are drawn.
    """

    status: str
    sentences: tuple[str, ...]
    hypotheses: PageTable
    contacts: PageTable
    free: tuple[str, ...] = ()


def state_name(word: str) -> str:
    """The name on a page of a status, given by its first word."""
    return _STATE_NAMES.get(word, word.replace("_", " "))


def state_text(text: str) -> str:
    """The text on a page of a status, a word that may be followed by ": " and the reason."""
    word, colon, why = text.partition(": ")
    return f"{state_name(word)}{colon}{why}"


def said_html(said: Instant, when: str = "") -> str:
    """The status, with the text of its time if given, and the sentences."""
    lines = []
    if said.status:
        time = f"{html.escape(when)}: " if when else ""
        name = html.escape(state_name(said.status))
        lines.append(f'<p>{time}<span class="tp-status tp-{html.escape(said.status)}">{name}</span></p>')
    lines += [f"<p>{html.escape(sentence)}</p>" for sentence in said.sentences]
    return "".join(lines).replace("\u00b1 ", "\u00b1\u00a0")  # no line break between the sign and its number


def table_html(table: PageTable) -> str:
    """A table under its title, if it has one; empty if the table has no rows."""
    if not table.rows:
        return ""
    has_switches = any(row.hides for row in table.rows)
    headings = ([""] if has_switches else []) + [html.escape(heading) for heading in table.headings]
    kind = ' class="tp-words"' if table.of_words else ""
    lines = [
        f"<h2>{html.escape(table.title)}</h2>" if table.title else "",
        f"<table{kind}><tr>",
        *(f"<th>{text}</th>" for text in headings),
        "</tr>",
    ]
    for row in table.rows:
        cells = [html.escape(cell) for cell in row.cells]
        if has_switches:
            on = " checked" if row.is_on else ""
            box = f'<input type="checkbox" data-hides="{html.escape(row.hides)}"{on}>' if row.hides else ""
            cells.insert(0, box)
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    lines.append("</table>")
    if table.more:
        lines.append(f'<div class="tp-more">{html.escape(table.more)}</div>')
    return "".join(lines)
