"""Runs the scripts of the report's sections, several at a time, and captures their output and errors."""

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

# A progress bar in a script's standard output.
PROGRESS = re.compile(r"^.* ━+ +\d+% .*\n", re.M)


@dataclasses.dataclass(frozen=True)
class Run:
    """The run of a section's script.

    Attributes:
        section: the section.
        command: the command, as typed in a shell.
        seconds: its duration.
        output: its standard output.
        failure: the end of its output if it failed; else empty.
    """

    section: Section
    command: str
    seconds: float
    output: str
    failure: str


def run(section: Section, is_full: bool, folder: Path) -> Run:
    """Runs a script, which writes into the folder of its name; output of an earlier run is deleted."""
    for pattern in ("*.md", "*.png", "*.html"):
        for old in (folder / section.name).glob(pattern):
            old.unlink()
    options = (section.full if is_full else section.quick).split()
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
    """Runs the sections, several at a time, and finally, one by one, those that must run alone.

    Args:
        sections: the sections.
        is_full: whether to run all trials.
        folder: parent of the sections' folders.
        jobs: number of scripts at a time.
        tell: called with each section that has ended.

    Returns:
        The runs, in the order of the sections.
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
