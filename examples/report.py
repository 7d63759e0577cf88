"""Reruns the tables and figures of the thesis, and the studies beyond it, and puts them on one page.

    python examples/report.py            # few trials each: some minutes
    python examples/report.py --full     # as many trials as the README's figures have: hours

Writes report.html (one file, pictures included) and report.md into `--out`. Nothing on the page is typed by hand: each
section is what its own script wrote or printed in this run, with the command that ran it; the machine and the versions
are asked.
A script that fails gets its last words into the report, and the exit status is 1.

Two scripts run at a time, each on a core of its own; what is real time or real load gets the machine to itself. The
times that the scripts state are of the processor, unless they say otherwise.
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
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
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
td:last-child { white-space: nowrap; }
img { display: block; max-width: 100%; }
pre { background: #f6f8fa; padding: 0.6rem; overflow-x: auto; font-size: 0.85rem; }
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
        alone: whether nothing else may run beside it, because its numbers are of the clock.
    """

    script: str
    covers: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    full: tuple[str, ...] = ()
    alone: bool = False

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
        quick=("--trials", "8", "--seed", "0"),
        full=("--trials", "100", "--seed", "0"),
    ),
    Section(
        script="thesis/figure_3_24.py",
        covers=("figure 3.24",),
        quick=("--objects", "soda_can", "--places", "1", "--seed", "0"),
        full=("--seed", "0"),
    ),
    Section(
        script="thesis/figures_3_25_and_3_26.py",
        covers=("figures 3.25 and 3.26",),
        quick=("--trials", "40", "--seed", "0"),
        full=("--trials", "200", "--seed", "0"),
    ),
    Section(
        script="thesis/search_progress.py",
        covers=("figure 4.5", "figure 4.19"),
        quick=("--seed", "0"),
        full=("--seed", "0"),
    ),
    Section(
        script="thesis/figures_4_7_and_4_11.py",
        covers=("figure 4.7", "figure 4.11"),
        quick=("--seed", "0"),
        full=("--seed", "0"),
    ),
    Section(
        script="thesis/section_4_3_1.py",
        covers=("figures 4.8 to 4.10", "figures 4.12 and 4.13", "figure 4.20"),
        quick=("--trials", "4", "--thesis-trials", "1", "0", "--likelihood-trials", "1", "0", "--seed", "0"),
        full=("--trials", "100", "--thesis-trials", "40", "2", "--likelihood-trials", "40", "2", "--seed", "0"),
    ),
    Section(
        script="hand_over_and_place.py",
        covers=("figures 4.17 and 4.18",),
        quick=("--seeds", "1", "--first-seed", "0"),
        full=("--seeds", "100", "--first-seed", "0"),
    ),
    Section(script="thesis/table_5_1.py", covers=("table 5.1", "figures 5.3 to 5.5")),
    Section(
        script="thesis/table_5_2.py",
        covers=("table 5.2",),
        quick=("--trials", "1", "--seed", "0"),
        full=("--trials", "20", "--seed", "0"),
    ),
    Section(
        script="thesis/table_5_3.py",
        covers=("table 5.3", "figure 5.12"),
        quick=("--trials", "3", "--seed", "0"),
        full=("--trials", "100", "--seed", "0"),
    ),
    Section(script="thesis/figure_5_11.py", covers=("figure 5.11",)),
    Section(script="thesis/figure_5_14.py", covers=("figure 5.14",), quick=("--seed", "0"), full=("--seed", "0")),
    Section(
        script="table_6_1.py",
        covers=("table 6.1",),
        quick=("--trials", "8", "--seed", "0"),
        full=("--trials", "100", "--seed", "0"),
    ),
    Section(
        script="thesis/figure_6_1.py",
        covers=("figure 6.1",),
        quick=("--grasps", "1", "--seed", "0"),
        full=("--grasps", "10", "--seed", "0"),
    ),
    Section(script="thesis/figure_6_2.py", covers=("figure 6.2",), quick=("--seed", "0"), full=("--seed", "0")),
    Section(script="thesis/figure_6_3.py", covers=("figure 6.3",), quick=("--seed", "0"), full=("--seed", "0")),
    Section(script="thesis/figure_6_4.py", covers=("figure 6.4",), quick=("--grasps", "2"), full=("--grasps", "100")),
    Section(
        script="calibration.py",
        quick=("--trials", "30", "--first-seed", "0"),
        full=("--trials", "1000", "--first-seed", "0"),
    ),
    Section(
        script="in_hand_motions.py",
        quick=("--motions", "4", "--steps", "50", "--first-seed", "0"),
        full=("--motions", "200", "--first-seed", "0"),
    ),
    Section(script="slip_in_station.py", quick=("--seconds", "0.3")),
    Section(
        script="identification_study.py",
        quick=("--trials", "10", "--seed", "0"),
        full=("--trials", "400", "--seed", "0"),
    ),
    Section(
        script="grasp_study.py",
        quick=("--objects", "mug", "--seeds", "1", "--first-seed", "0"),
        full=("--seeds", "10", "--first-seed", "0"),
    ),
    Section(script="can_latency.py", quick=("--duration", "2"), alone=True),
    Section(script="cost_growth.py", quick=("--trials", "1", "--seed", "0"), full=("--trials", "50", "--seed", "0")),
)
# What needs the hardware that the thesis had.
NOT_REPRODUCED = {
    "figures 3.20 to 3.23": "photographs and single runs of the real arm, hand and camera",
    "figures 4.14 to 4.16": "runs of the real hand and camera",
    "figures 5.8 to 5.10": "photographs and single runs of the real Barrett hand",
    "figure 5.13": "a run of the real Barrett hand",
}
# A progress bar that a script drew where it prints.
PROGRESS = re.compile(r"^.* ━+ +\d+% .*\n", re.M)


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
    """Runs a script; what it writes lies in the folder of its name, in place of what an earlier run wrote."""
    script = EXAMPLES / section.script
    for pattern in ("*.md", "*.png", "*.html"):
        for old in (folder / section.name).glob(pattern):
            old.unlink()
    options = section.full if is_full else section.quick
    place = ("--out", str(folder / section.name)) if '"--out"' in script.read_text(encoding="utf-8") else ()
    environment = os.environ | {"PYTHONUNBUFFERED": "1", "COLUMNS": "120", "OPENBLAS_NUM_THREADS": "1"}
    started = time.perf_counter()
    ended = subprocess.run(
        [sys.executable, str(script), *options, *place], capture_output=True, text=True, env=environment
    )
    words = (ended.stderr or ended.stdout).strip().splitlines()[-15:]
    command = " ".join(["python", f"examples/{section.script}", *options])
    failure = "\n".join(words) if ended.returncode else ""
    output = re.sub(PROGRESS, "", ended.stdout)
    return Run(section, command, time.perf_counter() - started, output, failure)


def run_all(
    sections: Sequence[Section], is_full: bool, folder: Path, jobs: int, tell: Callable[[Section], None]
) -> list[Run]:
    """Runs the sections, so many at a time, and those that need the machine to themselves at last.

    Args:
        sections: which.
        is_full: whether with all trials.
        folder: where each gets a folder.
        jobs: how many at a time.
        tell: is told of each that has ended.

    Returns:
        In the sections' order.
    """

    def run_one(section: Section) -> Run:
        made = run(section, is_full, folder)
        tell(section)
        return made

    runs: list[Run] = []
    for alone in (False, True):
        with ThreadPoolExecutor(1 if alone else jobs) as executor:
            runs += executor.map(run_one, [section for section in sections if section.alone == alone])
    return sorted(runs, key=lambda made: sections.index(made.section))


def to_markdown(runs: Sequence[Run], folder: Path, is_full: bool, seconds: float) -> str:
    """The report of runs that took so long together, s."""
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
            # A script's own page begins with its title: here that is a section.
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
    """What a file shows, by its name: "figures_3_12_to_3_19" are "Figures 3.12 to 3.19"."""
    return re.sub(r"(\d+)_(\d+)", r"\1.\2", stem).replace("_", " ").capitalize()


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
@click.option("--jobs", type=click.IntRange(min=1), default=2, show_default=True, help="So many scripts at a time.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/report"), show_default=True, help="Folder.")
def main(is_full: bool, only: tuple[str, ...], jobs: int, out: Path) -> None:
    """Reruns the tables and figures of the thesis, and puts them on one page."""
    names = [section.name for section in SECTIONS]
    if unknown := sorted(set(only) - set(names)):
        raise click.UsageError(f"--only {unknown[0]}: is no section; sections are {', '.join(names)}.")
    out.mkdir(parents=True, exist_ok=True)
    chosen = [section for section in SECTIONS if not only or section.name in only]
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    started = time.perf_counter()
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("scripts", total=len(chosen))
        runs = run_all(
            chosen, is_full, out, jobs, lambda section: progress.update(task, advance=1, description=section.name)
        )
    markdown = to_markdown(runs, out, is_full, time.perf_counter() - started)
    (out / "report.md").write_text(markdown, encoding="utf-8")
    (out / "report.html").write_text(to_html(markdown, out), encoding="utf-8")
    print(f"Written: {out / 'report.html'}, {out / 'report.md'}")
    if failed := [made.section.name for made in runs if made.failure]:
        sys.exit(f"report.py: failed: {', '.join(failed)}; the report says how.")


if __name__ == "__main__":
    main()
