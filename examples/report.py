"""Reruns the tables and figures of the thesis, and the studies beyond it, and puts them on one page.

    python examples/report.py            # few trials each: some minutes
    python examples/report.py --full     # as many trials as the README's figures have: hours

Writes report.html (one file, pictures included) and report.md into `--out`. Nothing on the page is typed by hand: each
section is what its own script wrote or printed in this run, with the command that ran it; the machine and the versions
are asked.
A script that fails gets its last words into the report, and the exit status is 1.
"""

import ast
import base64
import dataclasses
import html
import mimetypes
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import click
from markdown_it import MarkdownIt
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

EXAMPLES = Path(__file__).parent
PACKAGES = ("tactopose_drake", "drake", "numpy", "scipy", "numba", "trimesh", "matplotlib")
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #1f2328; }
table { border-collapse: collapse; display: block; overflow-x: auto; margin: 1rem 0; font-size: 0.9rem; }
th, td { border: 1px solid #d0d7de; padding: 0.2rem 0.6rem; } th { background: #f6f8fa; }
img { max-width: 100%; } pre { background: #f6f8fa; padding: 0.6rem; overflow-x: auto; font-size: 0.85rem; }
h2 { border-bottom: 1px solid #d0d7de; margin-top: 3rem; }
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Section:
    """One script of the examples, and what it regenerates.

    Attributes:
        script: its path from `examples/`.
        covers: what of the thesis it regenerates, as the thesis names it; empty where it goes beyond.
        quick: its options for a few trials.
        full: its options for all of them.
    """

    script: str
    covers: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    full: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The script's name without its ending: the section's anchor and folder."""
        return Path(self.script).stem


@dataclasses.dataclass(frozen=True)
class Run:
    """How a section's script ended.

    Attributes:
        section: which.
        command: what was run, as one would type it.
        seconds: how long it took.
        output: what it printed.
        failure: its last words, if it failed.
    """

    section: Section
    command: str
    seconds: float
    output: str
    failure: str


SECTIONS = (
    Section(
        script="thesis/table_3_1.py",
        covers=("table 3.1", "figures 3.12 to 3.19"),
        quick=("--trials", "4"),
        full=("--trials", "100"),
    ),
    Section(script="thesis/figure_3_24.py", covers=("figure 3.24",), quick=("--objects", "soda_can", "--places", "1")),
    Section(
        script="thesis/figures_3_25_and_3_26.py",
        covers=("figure 3.25", "figure 3.26"),
        quick=("--trials", "40"),
        full=("--trials", "200"),
    ),
    Section(script="thesis/search_progress.py", covers=("figure 4.5", "figure 4.19")),
    Section(script="thesis/figures_4_7_and_4_11.py", covers=("figure 4.7", "figure 4.11")),
    Section(
        script="thesis/section_4_3_1.py",
        covers=("figures 4.8 to 4.10", "figures 4.12, 4.13", "figure 4.20"),
        quick=("--trials", "1", "--thesis-trials", "1", "0"),
        full=("--trials", "100", "--thesis-trials", "100", "10"),
    ),
    Section(script="hand_over_and_place.py", covers=("figures 4.17, 4.18",), quick=("--seeds", "1")),
    Section(script="thesis/table_5_1.py", covers=("table 5.1", "figures 5.3 to 5.5")),
    Section(script="thesis/table_5_2.py", covers=("table 5.2",), quick=("--trials", "1"), full=("--trials", "20")),
    Section(
        script="thesis/table_5_3.py",
        covers=("table 5.3", "figure 5.12"),
        quick=("--trials", "2"),
        full=("--trials", "100"),
    ),
    Section(script="thesis/figure_5_11.py", covers=("figure 5.11",)),
    Section(script="thesis/figure_5_14.py", covers=("figure 5.14",)),
    Section(script="table_6_1.py", covers=("table 6.1",), quick=("--trials", "8"), full=("--trials", "100")),
    Section(script="thesis/figure_6_1.py", covers=("figure 6.1",), quick=("--grasps", "1"), full=("--grasps", "10")),
    Section(script="thesis/figure_6_2.py", covers=("figure 6.2",)),
    Section(script="thesis/figure_6_3.py", covers=("figure 6.3",)),
    Section(script="thesis/figure_6_4.py", covers=("figure 6.4",), quick=("--grasps", "2"), full=("--grasps", "100")),
    Section(script="calibration.py", quick=("--trials", "30"), full=("--trials", "1000")),
    Section(script="in_hand_motions.py", quick=("--motions", "4", "--steps", "50"), full=("--motions", "200")),
    Section(script="slip_in_station.py", quick=("--seconds", "0.3")),
    Section(script="identification_study.py", quick=("--trials", "10"), full=("--trials", "400")),
    Section(script="grasp_study.py", quick=("--objects", "mug", "--seeds", "1"), full=("--seeds", "10")),
    Section(script="can_latency.py", quick=("--duration", "2")),
    Section(script="cost_growth.py", quick=("--trials", "1"), full=("--trials", "50")),
)
# What needs the hardware that the thesis had.
NOT_REPRODUCED = {
    "figures 3.20 to 3.23": "photographs and single runs of the real arm, hand and camera",
    "figures 4.14 to 4.16": "runs of the real hand and camera",
    "figure 5.13": "a run of the real Barrett hand",
}


def machine() -> list[str]:
    """What the report was made on."""
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


def run(section: Section, is_full: bool, folder: Path) -> Run:
    """Runs a script; what it writes lies in the folder of its name."""
    script = EXAMPLES / section.script
    options = section.full if is_full else section.quick
    place = ("--out", str(folder / section.name)) if '"--out"' in script.read_text(encoding="utf-8") else ()
    environment = os.environ | {"PYTHONUNBUFFERED": "1", "COLUMNS": "120"}
    started = time.perf_counter()
    ended = subprocess.run(
        [sys.executable, str(script), *options, *place], capture_output=True, text=True, env=environment
    )
    words = (ended.stderr or ended.stdout).strip().splitlines()[-15:]
    command = " ".join(["python", f"examples/{section.script}", *options])
    failure = "\n".join(words) if ended.returncode else ""
    return Run(section, command, time.perf_counter() - started, ended.stdout, failure)


def to_markdown(runs: Sequence[Run], folder: Path, is_full: bool) -> str:
    """The report."""
    lines = ["# tactopose_drake: the thesis' tables and figures again", ""]
    lines += [f"{'All' if is_full else 'A few'} trials of each; every number comes from this run.", "", *machine()]
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
            # A script's own page begins with its title: here that is a section.
            lines += [re.sub(r"^#", "##", page.read_text(encoding="utf-8"), flags=re.M), ""]
        if not pages:
            lines += [f"## {title(made.section)}", "", "```", made.output.strip(), "```", ""]
        lines += [f"![{plot.stem}]({made.section.name}/{plot.name})" for plot in sorted(written.glob("*.png"))]
        lines += ["", f"Made by `{made.command}` in {made.seconds:.0f} s."]
    return "\n".join(lines) + "\n"


def title(section: Section) -> str:
    """The first line of what the script says of itself."""
    tree = ast.parse((EXAMPLES / section.script).read_text(encoding="utf-8"))
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


@click.command()
@click.option("--full", "is_full", is_flag=True, help="All trials, not a few; takes hours.")
@click.option("--only", multiple=True, help="Of the sections, only this one; may be given more than once.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/report"), show_default=True, help="Folder.")
def main(is_full: bool, only: tuple[str, ...], out: Path) -> None:
    """Reruns the tables and figures of the thesis, and puts them on one page."""
    names = [section.name for section in SECTIONS]
    if unknown := sorted(set(only) - set(names)):
        raise click.UsageError(f"--only {unknown[0]}: is no section; sections are {', '.join(names)}.")
    out.mkdir(parents=True, exist_ok=True)
    runs = []
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True)) as progress:
        chosen = [section for section in SECTIONS if not only or section.name in only]
        task = progress.add_task("", total=len(chosen))
        for section in chosen:
            progress.update(task, description=section.name)
            runs.append(run(section, is_full, out))
            progress.advance(task)
    markdown = to_markdown(runs, out, is_full)
    (out / "report.md").write_text(markdown, encoding="utf-8")
    (out / "report.html").write_text(to_html(markdown, out), encoding="utf-8")
    print(f"Written: {out / 'report.html'}, {out / 'report.md'}")
    if failed := [made.section.name for made in runs if made.failure]:
        sys.exit(f"report.py: failed: {', '.join(failed)}; the report says how.")


if __name__ == "__main__":
    main()
