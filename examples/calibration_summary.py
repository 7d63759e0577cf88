"""The summary and the figure of the trials of `calibration.py`."""

import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

LEVELS = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99])
LEVEL = 0.95
# A pose is well known if the standard deviation in no direction exceeds this share of the object's size. The Cramer-Rao
# bound uses the surface's curvature at the truth, which does not describe the surface farther away.
WELL_KNOWN = 0.05
SURE = 0.95
WRONG = chi2.ppf(0.999, 6)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """One estimate, and its error.

    Attributes:
        name: name of the object.
        held: for each of LEVELS, whether its region contains the truth.
        promised: for LEVEL, the share of truths drawn from the belief itself that its region contains.
        probability, cost: probability and cost of the best hypothesis.
        unique: whether the best hypothesis has practically all the probability, and no free direction.
        mahalanobis: squared Mahalanobis distance from the best hypothesis to the truth.
        well_known: whether it is unique and its standard deviations are small.
        translation, rotation: error of the best hypothesis, m and rad.
        said_translation, said_rotation: root mean square errors by its covariance, m and rad.
        least_translation, least_rotation: Cramer-Rao bounds of the root mean square errors, m and rad.
    """

    name: str
    held: NDArray[np.bool_]
    promised: float
    probability: float
    cost: float
    unique: bool
    well_known: bool
    mahalanobis: float
    translation: float
    rotation: float
    said_translation: float
    said_rotation: float
    least_translation: float
    least_rotation: float


def rms(values: list[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def errors(trials: list[Trial]) -> str:
    """Root mean square errors, in truth and by the covariances, also relative to the Cramer-Rao bounds."""
    millimetres, said_millimetres, least_millimetres = (
        1e3 * rms([getattr(trial, name) for trial in trials])
        for name in ("translation", "said_translation", "least_translation")
    )
    degrees, said_degrees, least_degrees = (
        np.degrees(rms([getattr(trial, name) for trial in trials]))
        for name in ("rotation", "said_rotation", "least_rotation")
    )
    return (
        f"rms errors {millimetres:.2f} mm, {degrees:.2f} deg, in units of the Cramer-Rao bound's "
        f"{millimetres / least_millimetres:.2f}, {degrees / least_degrees:.2f}; the covariances say "
        f"{said_millimetres / least_millimetres:.2f}, {said_degrees / least_degrees:.2f}"
    )


def summary(title: str, trials: list[Trial]) -> str:
    """The results as text, in total and for each object."""
    at = int(np.flatnonzero(LEVELS == LEVEL)[0])
    held = np.array([trial.held[at] for trial in trials])
    unique = [trial for trial in trials if trial.unique]
    error, promised = np.sqrt(held.mean() * (1 - held.mean()) / len(held)), np.mean([t.promised for t in trials])
    sure = [trial for trial in trials if trial.probability > SURE]
    wrong = sum(trial.mahalanobis > WRONG for trial in sure)
    lines = [
        f"{title}: {len(trials)} trials",
        f"  truth in the smallest set that holds 95 %: {held.mean():.1%}, standard error {error:.1%}; "
        f"promised {promised:.1%}",
        f"  of {len(sure)} answers with more than {SURE:.0%}, {wrong} are wrong beyond 99.9 % of their own covariance",
    ]
    if unique:
        square = np.array([trial.mahalanobis for trial in unique])
        lines += [
            f"  unique in {len(unique)} trials: mean squared Mahalanobis error {square.mean():.2f} (exact: 6), median "
            f"{np.median(square):.2f} (exact: {chi2.median(6):.2f})",
            f"    {errors(unique)}",
        ]
    if well_known := [trial for trial in unique if trial.well_known]:
        lines.append(f"  to {WELL_KNOWN:.0%} of the size or better in {len(well_known)} of these: {errors(well_known)}")
    for name in dict.fromkeys(trial.name for trial in trials):
        own = [trial for trial in trials if trial.name == name]
        share = np.mean([trial.held[at] for trial in own])
        lines.append(f"    {name:15s} {share:4.0%} of {len(own)}, promised {np.mean([t.promised for t in own]):4.0%}")
    return "\n".join(lines)


def save_figure(runs: dict[str, list[Trial]], path: Path) -> None:
    """A row for each run: reliability, the distribution of the Mahalanobis errors, and cost against error."""
    figure = Figure(figsize=(15, 4.8 * len(runs)), layout="constrained")
    axes = figure.subplots(len(runs), 3, squeeze=False)
    for (title, trials), row in zip(runs.items(), axes, strict=True):
        share = np.mean([trial.held for trial in trials], axis=0)
        error = 1.96 * np.sqrt(share * (1 - share) / len(trials))
        row[0].plot([0, 1], [0, 1], color="0.7", label="as said")
        row[0].errorbar(LEVELS, share, yerr=error, fmt="o-", capsize=3, label="found, with 95 % intervals")
        row[0].set(xlabel="mass of the set, and level of its ellipsoids", ylabel="share of trials that hold the truth")
        row[0].set_title(title)
        row[0].legend(loc="lower right")

        squares = [trial.mahalanobis for trial in trials if trial.unique]
        grid = np.linspace(0, 30, 121)
        row[1].hist(
            np.minimum(squares, 29.9), bins=30, range=(0, 30), density=len(squares) > 0, alpha=0.5, label="unique poses"
        )
        row[1].plot(grid, chi2.pdf(grid, 6), label="chi-square, 6 degrees of freedom")
        row[1].set(xlabel="squared Mahalanobis error (the last bin: and more)", ylabel="density")
        row[1].legend()

        cost = [trial.cost for trial in trials]
        millimetres = [1e3 * trial.translation for trial in trials]
        dots = row[2].scatter(cost, millimetres, c=[t.probability for t in trials], s=8, cmap="viridis", vmin=0, vmax=1)
        row[2].set(yscale="log", xlabel="cost of the best hypothesis", ylabel="its error, mm")
        figure.colorbar(dots, ax=row[2], label="its probability")
    FigureCanvasAgg(figure).print_png(path)
