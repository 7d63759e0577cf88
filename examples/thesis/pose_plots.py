"""The figures of section 4.3.1 of the thesis, and 4.20, from the runs of its experiments.

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 4.3.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from grasp_library import Array
from grasp_trials import Errors
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pose_experiments import FINGER_COUNTS, LEVELS, MAIN_CELL, METHODS, Cell, Results, Runs

PARTS = ("position error, mm", "orientation error, deg")
# The thesis' figures of mean errors and success rates, by the experiment's name.
MEAN_ERRORS = {"correction": "figure_4_9", "global": "figure_4_12"}
SUCCESS_RATES = {"correction": "figure_4_10", "global": "figure_4_13"}


def save_figures(results: Results, folder: Path) -> None:
    """Plots mean errors and success rates; with a displaced pose, also histograms, and initial against final errors."""
    name = results.experiment.name
    _print(_mean_errors(results), folder / f"{MEAN_ERRORS[name]}.png")
    _print(_success_rates(results), folder / f"{SUCCESS_RATES[name]}.png")
    if results.experiment.guess:
        _print(_histograms(results), folder / "figure_4_8.png")
        _print(_initial_against_final(results), folder / "figure_4_20.png")


def _methods(results: Results) -> list[str]:
    return [method for method in METHODS if (MAIN_CELL, method) in results.runs]


def _units(errors: Errors) -> tuple[Array, Array]:
    """Converts to millimetres and degrees."""
    return 1e3 * errors.translation, np.degrees(errors.rotation)


def _mean_errors(results: Results) -> Figure:
    """Plots [B16] figures 4.9 and 4.12."""
    figure, grid = _panels(results, rows=2)
    for line, part, label in zip(grid, (0, 1), PARTS, strict=True):
        _bars(line, results, lambda runs, part=part: float(_units(runs.errors)[part].mean()))
        line[0].set_ylabel(f"mean {label}")
    return figure


def _success_rates(results: Results) -> Figure:
    """Plots [B16] figures 4.10 and 4.13."""
    figure, grid = _panels(results, rows=1)
    _bars(grid[0], results, lambda runs: 100.0 * float(runs.errors.success.mean()))
    grid[0, 0].set(ylabel="trials under 1 cm and 15°, %", ylim=(0, 100))
    return figure


def _panels(results: Results, rows: int) -> tuple[Figure, NDArray[np.object_]]:
    """A figure with a column of axes for each method, shape (rows, methods)."""
    figure = Figure(figsize=(1 + 4.5 * len(_methods(results)), 1 + 3.5 * rows), layout="constrained")
    figure.suptitle(results.experiment.title)
    return figure, figure.subplots(rows, len(_methods(results)), sharey="row", squeeze=False)


def _bars(line: NDArray[np.object_], results: Results, height: Callable[[Runs], float]) -> None:
    """Draws on each method's axes a group of bars for each noise, with a colour for each number of fingers."""
    width = 0.85 / len(FINGER_COUNTS)
    for axes, method in zip(line, _methods(results), strict=True):
        for i, fingers in enumerate(FINGER_COUNTS):
            heights = [height(results.runs[Cell(fingers, noise), method]) for noise in LEVELS]
            axes.bar(np.arange(len(LEVELS)) + (i - 1) * width, heights, width, label=f"{fingers} fingers")
        axes.set_xticks(range(len(LEVELS)), [str(noise).replace(", ", "\n") for noise in LEVELS])
        axes.set_title(f"{method}, {len(results.runs[MAIN_CELL, method])} trials")
    line[0].legend(fontsize="small")


def _histograms(results: Results) -> Figure:
    """Plots [B16] figure 4.8: initial errors above, final ones below, with five fingers and the thesis' noise.

    The last bin, which ends at the largest initial error, also contains the final errors beyond it.
    """
    methods = _methods(results)
    rows = [("initial", results.initial)]
    rows += [(f"final, {method}", results.runs[MAIN_CELL, method].errors) for method in methods]
    figure = Figure(figsize=(10, 3 * len(rows)), layout="constrained")
    limits = [values.max() for values in _units(results.initial)]
    for line, (name, errors) in zip(figure.subplots(len(rows), 2), rows, strict=True):
        for axes, values, limit, label in zip(line, _units(errors), limits, PARTS, strict=True):
            axes.hist(np.minimum(values, limit), bins=np.linspace(0.0, limit, 31))
            axes.set(xlabel=label, title=f"{name}: mean {values.mean():.1f}, s.d. {values.std():.1f}")
    return figure


def _initial_against_final(results: Results) -> Figure:
    """Plots [B16] figure 4.20, which is for the same correction; points below the line have a decreased error."""
    methods = _methods(results)
    figure = Figure(figsize=(5 * len(methods), 9), layout="constrained")
    grid = figure.subplots(2, len(methods), sharex="row", sharey="row", squeeze=False)
    for column, method in zip(grid.T, methods, strict=True):
        final = results.runs[MAIN_CELL, method].errors
        initial = Errors(*(values[: len(final.translation)] for values in results.initial))
        for axes, x, y, label in zip(column, _units(initial), _units(final), PARTS, strict=True):
            axes.plot(x, y, ".")
            axes.axline((0, 0), slope=1, color="C2")
            axes.set(xlabel=f"initial {label}", ylabel=f"final {label}", title=f"{method}: {np.mean(y < x):.0%} fell")
    return figure


def _print(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure).print_png(path)
