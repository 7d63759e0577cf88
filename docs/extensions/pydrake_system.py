"""The directive `pydrake_system` of Drake's docstrings: the ports of a system, as a table."""

from typing import Any

import yaml
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class PydrakeSystem(SphinxDirective):
    """A row of input ports, the system's name, and output ports."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """The table's nodes."""
        system = yaml.safe_load("\n".join(self.content))
        columns = [system.get("input_ports", []), [system["name"]], system.get("output_ports", [])]
        table, group = nodes.table(classes=["pydrake-system"]), nodes.tgroup(cols=3)
        group += [nodes.colspec(colwidth=1) for _ in columns]
        head, body, titles, cells = nodes.thead(), nodes.tbody(), nodes.row(), nodes.row()
        for title, names in zip(("in", "system", "out"), columns, strict=True):
            titles += nodes.entry("", nodes.paragraph(text=title))
            lines = nodes.line_block()
            lines += [nodes.line("", "", nodes.literal(text=str(name))) for name in names or ["none"]]
            cells += nodes.entry("", lines)
        head += titles
        body += cells
        group += [head, body]
        table += group
        return [table]


def setup(app: Sphinx) -> dict[str, Any]:
    """Tells Sphinx of the directive."""
    app.add_directive("pydrake_system", PydrakeSystem)
    return {"parallel_read_safe": True}
