"""Reruns the tables and figures of the thesis, and the studies beyond it, and puts them on one page.

    python examples/report.py            # few trials each: some minutes
    python examples/report.py --full     # as many trials as docs/results.md has, or nearly: an hour or two

Writes report.html (one file, pictures included) and report.md into `--out`. The whole page is generated: each section
is the output of its script in this run, with the command; the machine and the versions are detected. If a script fails,
the report has the end of its output, and the exit status is 1.

Two scripts run at a time, each on its own core; scripts that measure real time run alone. Times in the scripts' output
are CPU times, unless stated otherwise.
"""

import sys
import time
from pathlib import Path

import click
from report_page import to_html, to_markdown
from report_runs import run_all
from report_sections import SECTIONS
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


@click.command()
@click.option("--full", "is_full", is_flag=True, help="All trials, not a few; takes an hour or two.")
@click.option("--only", multiple=True, help="Of the sections, only this one; may be given more than once.")
@click.option("--jobs", type=click.IntRange(min=1), default=2, show_default=True, help="So many scripts at a time.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/report"), show_default=True, help="Folder.")
def main(is_full: bool, only: tuple[str, ...], jobs: int, out: Path) -> None:
    """Reruns the tables and figures of the thesis, and puts them on one page."""
    names = [section.name for section in SECTIONS]
    if unknown := sorted(set(only) - set(names)):
        raise click.UsageError(f"--only must be one of the sections {', '.join(names)}, not {unknown[0]!r}.")
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
