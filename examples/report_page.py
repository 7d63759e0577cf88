"""The page of the report: the scripts' output in Markdown, and as one HTML file with pictures."""

import ast
import base64
import html
import mimetypes
import os
import platform
import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from markdown_it import MarkdownIt
from report_runs import Run
from report_sections import NOT_REPRODUCED, Section

PACKAGES = ("tactopose_drake", "drake", "numpy", "scipy", "numba", "trimesh", "matplotlib")
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #1f2328; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1rem 0; font-size: 0.9rem; }
th, td { border: 1px solid #d0d7de; padding: 0.2rem 0.6rem; } th { background: #f6f8fa; }
td:last-child { white-space: nowrap; }
img { display: block; max-width: 100%; }
pre { background: #f6f8fa; padding: 0.6rem; overflow-x: auto; font-size: 0.85rem; }
h2 { border-bottom: 1px solid #d0d7de; margin-top: 3rem; }
"""


def to_markdown(runs: Sequence[Run], folder: Path, is_full: bool, seconds: float) -> str:
    """The report in Markdown; `seconds` is the duration of all runs together."""
    lines = ["# tactopose_drake: the thesis' tables and figures again", ""]
    lines += [f"{'All' if is_full else 'A few'} trials of each; every number comes from this run.", "", *machine()]
    lines.append(f"- {seconds:.0f} s in all")
    lines += ["", "| of the thesis | here | time |", "|---|---|---:|"]
    for made in runs:
        what = ", ".join(made.section.covers) or "beyond it"
        state = "**failed**" if made.failure else f"{made.seconds:.0f} s"
        lines.append(f"| {what} | [{made.section.name}](#{made.section.name}) | {state} |")
    lines += [f"| {what} | not reproduced: {why} | |" for what, why in NOT_REPRODUCED.items()]
    for made in runs:
        lines += ["", f'<a id="{made.section.name}"></a>', ""]
        if made.failure:
            lines += [f"## {made.section.name}", "", f"`{made.command}` failed:", "", "```", made.failure, "```"]
            continue
        written = folder / made.section.name
        pages = sorted(written.glob("*.md"))
        for page in pages:
            # The title of a script's own page becomes a section heading.
            lines += [re.sub(r"^#", "##", page.read_text(encoding="utf-8"), flags=re.M), ""]
        if not pages:
            lines += [f"## {title(made.section)}", "", "```", made.output.strip(), "```", ""]
        for plot in sorted(written.glob("*.png"), key=in_order):
            lines += [f"![{plot.stem}]({made.section.name}/{plot.name})", f"*{caption(plot.stem)}*", ""]
        if scenes := sorted(written.glob("*.html")):
            links = ", ".join(f"[{caption(scene.stem)}]({made.section.name}/{scene.name})" for scene in scenes)
            lines += [f"To be turned in a browser: {links}.", ""]
        lines += ["", f"Made by `{made.command}` in {made.seconds:.0f} s."]
    return "\n".join(lines) + "\n"


def in_order(path: Path) -> tuple[list[int], str]:
    """A key that sorts figure 4.9 before figure 4.10."""
    return [int(number) for number in re.findall(r"\d+", path.stem)], path.stem


def caption(stem: str) -> str:
    """The caption of a file, from its name: "figures_3_12_to_3_19" becomes "Figures 3.12 to 3.19"."""
    return re.sub(r"(\d+)_(\d+)", r"\1.\2", stem).replace("_", " ").capitalize()


def title(section: Section) -> str:
    """The first line of the script's docstring."""
    tree = ast.parse(section.path.read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or section.name).partition("\n")[0].rstrip(".")


def to_html(markdown: str, folder: Path) -> str:
    """The report as one file, pictures included."""

    def embed(match: re.Match[str]) -> str:
        path = folder / html.unescape(match[1])
        kind = mimetypes.guess_type(path.name)[0]
        return f'src="data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"'

    body = MarkdownIt("commonmark").enable("table").render(markdown)
    body = re.sub(r'src="([^":]+)"', embed, body)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Report</title><style>{STYLE}</style>{body}</html>'
    )


def machine() -> list[str]:
    """The machine and the versions with which the report was made."""
    memory = (
        os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30 if hasattr(os, "sysconf") else float("nan")
    )
    cpuinfo = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.*)$", cpuinfo.read_text(), re.M) if cpuinfo.is_file() else []
    processor = names[0] if names else platform.processor() or platform.machine()
    return [
        f"- {processor}, {os.cpu_count()} cores, {memory:.0f} GB; {platform.system()} {platform.release()}",
        f"- Python {platform.python_version()}; " + ", ".join(f"{name} {version(name)}" for name in PACKAGES),
    ]
