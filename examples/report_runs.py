"""Runs the scripts of the report's sections, some at a time, and keeps what they print or die of."""

import dataclasses
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from report_sections import Section

# A progress bar that a script drew where it prints.
PROGRESS = re.compile(r"^.* ━+ +\d+% .*\n", re.M)


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


def run(section: Section, is_full: bool, folder: Path) -> Run:
    """Runs a script; what it writes lies in the folder of its name, in place of what an earlier run wrote."""
    for pattern in ("*.md", "*.png", "*.html"):
        for old in (folder / section.name).glob(pattern):
            old.unlink()
    options = section.full if is_full else section.quick
    place = ("--out", str(folder / section.name)) if '"--out"' in section.path.read_text(encoding="utf-8") else ()
    environment = os.environ | {"PYTHONUNBUFFERED": "1", "COLUMNS": "120", "OPENBLAS_NUM_THREADS": "1"}
    started = time.perf_counter()
    ended = subprocess.run(
        [sys.executable, str(section.path), *options, *place], capture_output=True, text=True, env=environment
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
