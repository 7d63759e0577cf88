"""`tactopose warm-up`: compiles all kernels that are not compiled yet."""

import os
import time

import click
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tactopose_drake.cli.consoles import OUT, progress_bar
from tactopose_drake.cli.workers import processes
from tactopose_drake.core.kernel_library import compile_kernels, missing_kernels


@click.command(name="warm-up")
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=os.cpu_count() or 1,
    show_default="number of cores",
    help="Number of processes that compile.",
)
def warm_up(jobs: int) -> None:
    """Compiles all kernels that are not compiled yet, so that nothing waits for them later."""
    started, missing = time.perf_counter(), missing_kernels()
    total = sum(len(names) for names in missing.values())
    if not total:
        OUT.print("All kernels are compiled.")
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with progress_bar(*columns) as progress, processes(min(jobs, len(missing))) as executor:
        task = progress.add_task("compiling kernels", total=total)
        for done in compile_kernels(missing, executor.submit):
            name = done.module.rsplit(".", 1)[-1].removesuffix("_kernels").replace("_", " ")
            progress.update(task, advance=done.kernels, description=f"{name}: {done.duration:.1f} s")
    OUT.print(f"Compiled {total} kernels in {time.perf_counter() - started:.0f} s.")
