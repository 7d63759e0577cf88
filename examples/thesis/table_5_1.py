"""Table 5.1 of the thesis repeated: how well the principal components of a pad's pressures show a shape's tilt.

    python examples/thesis/table_5_1.py --out out

Prints the scale alpha that `find_alpha` finds for a pad, and the table next to the thesis' numbers; writes it as
Markdown (table_5_1.md) together with figures 5.3 to 5.5 (figures_5_3_to_5_5.png). It takes a few seconds.

The thesis simulated the presses with finite elements of a hyperelastic rubber; here, Drake's hydroelastic contact is
used, with a layer of that rubber's modulus. The thesis states no sizes: the pad here is 40 x 15 mm with cells of 1 mm,
and 6 mm thick, the cylinder is as thick as a bottle, the thin flat shape and the legs of the L are 8 mm wide. Each
entry is over three depths and four positions of the shape's edges relative to the cells; alpha is the same for all.

One additional row is not in the thesis, and alpha is not fitted to it: a cylinder whose contact is narrower than the
pad, and narrows towards the shallow end. Therefore its patch is flatter than its axis. The same is true of the
cylinder's surface within the contact, which is what a patch is compared with in matching to a model (section 5.2.4).

Source: [B16] J. Bimbo, Touch Based Object Pose Estimation For Robotic Grasping, thesis, 2016, section 5.2.2.
"""

import math
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from tactopose_drake.hand import (
    DEPTH_SHARES,
    OFFSETS,
    TILTS_DEG,
    AlphaFit,
    Press,
    cylinder,
    find_alpha,
    patch_of,
    simulate_presses,
    tilt_errors,
)

Array = NDArray[np.float64]

MODULUS = (
    75e3  # Pa: three times the initial shear modulus of the thesis' Arruda-Boyce rubber (mu = 10 kPa, lambda = 1.1)
)
THICKNESS = 0.006  # m
THIN_RADIUS = 0.010  # m
THIN = "cylinder, 10 mm"
# [B16] table 5.1, deg, for the tilts of `TILTS_DEG`.
THESIS = {
    "cylinder": (0.0, 0.9, 0.14, 0.42),
    "L-shape": (0.19, 0.50, 0.81, 0.68),
    "flat, wide": (0.0, 0.4, 0.07, 0.5),
    "flat, thin": (0.0, 0.07, 0.0, 0.62),
}
LIMIT_DEG, MEAN_LIMIT_DEG = 1.0, 0.5

Errors = dict[str, Array]  # by shape: absolute, deg, shape (tilts, presses)


def errors_by_shape(fit: AlphaFit) -> Errors:
    """The errors of the thesis' shapes."""
    values = np.degrees(np.abs(fit.errors)).reshape(len(THESIS), len(TILTS_DEG), -1)
    return dict(zip(THESIS, values, strict=True))


def press_thin_cylinder(fit: AlphaFit) -> tuple[list[Press], Array]:
    """The presses of the thin cylinder and their absolute errors, deg, shape (tilts, presses)."""
    presses = simulate_presses(THIN, cylinder(THIN_RADIUS), fit.layout, modulus=MODULUS, thickness=THICKNESS)
    return presses, np.degrees(np.abs(tilt_errors(fit.layout, presses, fit.alpha))).reshape(len(TILTS_DEG), -1)


def own_tilt(fit: AlphaFit, press: Press) -> float:
    """The tilt of the thin cylinder's own surface below the pad, by its principal components, deg."""
    x, y = fit.layout.p_TC[:, 0], fit.layout.p_TC[:, 1]
    bulge = (THIN_RADIUS - np.sqrt(THIN_RADIUS**2 - y**2)) / math.cos(press.tilt)
    z = math.tan(press.tilt) * (fit.layout.corners[..., 0].max() - x) - press.depth + bulge
    points = np.column_stack([x, y, z])[z < 0]
    normal = np.linalg.eigh(np.cov(points.T))[1][:, 0]
    return math.degrees(math.atan2(normal[0], normal[2]) if normal[2] > 0 else math.atan2(-normal[0], -normal[2]))


def verdicts(fit: AlphaFit, errors: Errors) -> list[str]:
    """The results in sentences."""
    every = np.concatenate([values.ravel() for values in errors.values()])
    held = every.max() <= LIMIT_DEG and every.mean() <= MEAN_LIMIT_DEG
    thesis = np.array(list(THESIS.values()))
    thin, thin_errors = press_thin_cylinder(fit)
    steepest = thin[-1]
    seen = math.degrees(steepest.tilt + tilt_errors(fit.layout, [steepest], fit.alpha)[0])
    return [
        f"alpha = {fit.alpha:.4g} m/Pa, {fit.alpha * MODULUS / THICKNESS:.3f} of the layer's thickness over modulus.",
        f"Largest error {every.max():.2f} deg (thesis {thesis.max():.2f}), mean {every.mean():.2f} deg (thesis "
        f"{thesis.mean():.2f}); at most {LIMIT_DEG:g} and {MEAN_LIMIT_DEG:g} deg were asked for: "
        f"{'held' if held else 'NOT held'}.",
        f"{THIN} radius: up to {thin_errors.max():.2f} deg. At {math.degrees(steepest.tilt):g} deg the deepest press "
        f"leaves a patch of {seen:.2f} deg, and the cylinder's own surface there is at {own_tilt(fit, steepest):.2f}.",
    ]


def rows(fit: AlphaFit, errors: Errors) -> list[tuple[str, ...]]:
    """The table's cells as text: mean and largest error, with the thesis' number in brackets."""
    thin = {THIN: press_thin_cylinder(fit)[1]}
    lines = []
    for shape, values in (errors | thin).items():
        printed = [f" ({x:g})" for x in THESIS[shape]] if shape in THESIS else [""] * len(TILTS_DEG)
        cells = [f"{v.mean():.2f}, {v.max():.2f}{x}" for v, x in zip(values, printed, strict=True)]
        lines.append((shape, *cells))
    return lines


def markdown(fit: AlphaFit, errors: Errors) -> str:
    """The table and the verdicts as Markdown."""
    lines = [
        "# Table 5.1",
        "",
        f"Angle error in degrees over {len(DEPTH_SHARES)} depths and {len(OFFSETS)} places: mean, largest (thesis).",
        "",
        "| shape | " + " | ".join(f"{tilt:g} deg" for tilt in TILTS_DEG) + " |",
        "|---|" + "---:|" * len(TILTS_DEG),
    ]
    lines += ["| " + " | ".join(row) + " |" for row in rows(fit, errors)]
    return "\n".join([*lines, "", *(f"- {line}" for line in verdicts(fit, errors)), ""])


def print_table(fit: AlphaFit, errors: Errors, console: Console) -> None:
    """Prints the table."""
    table = Table(title="Table 5.1, deg: mean, largest (thesis)", box=box.SIMPLE_HEAD)
    for heading in ("shape", *(f"{tilt:g} deg" for tilt in TILTS_DEG)):
        table.add_column(heading, justify="left" if heading == "shape" else "right")
    for row in rows(fit, errors):
        table.add_row(*row)
    console.print(table)
    for line in verdicts(fit, errors):
        console.print(f"- {line}")


def find_press(fit: AlphaFit, shape: str, tilt_deg: float, depth: int) -> Press:
    """The press of a shape at a tilt and one of the depths, with its edges aligned with the cells'."""
    first = list(THESIS).index(shape) * len(TILTS_DEG) + TILTS_DEG.index(tilt_deg)
    return fit.presses[(first * len(DEPTH_SHARES) + depth) * len(OFFSETS)]


def plot_profile(axis: Axes, fit: AlphaFit, press: Press, alpha: float, color: str) -> None:
    """Plots the profile of the pressures from the side, and the principal component in the plane of the tilt, in mm."""
    patch = patch_of(fit.layout, press, alpha)
    axis.plot(*(1e3 * patch.points[patch.active][:, [0, 2]].T), ".", color=color, markersize=3)
    third = patch.eigenvectors[:, 2]
    along = np.array([-third[2], third[0]]) / math.hypot(third[0], third[2])
    center = 1e3 * patch.centroid[[0, 2]]
    label = f"alpha = {alpha:.2g}, depth {1e3 * press.depth:.1f} mm"
    axis.plot(*np.transpose([center - 8 * along, center + 8 * along]), color=color, label=label)


def plot_shape(axis: Axes, fit: AlphaFit, press: Press) -> None:
    """Plots the underside of the shape in black, in mm."""
    end = fit.layout.corners[..., 0].max()
    x = np.array([end - press.depth / math.tan(press.tilt) - 0.004, end])
    axis.plot(1e3 * x, 1e3 * (math.tan(press.tilt) * (end - x) - press.depth), "k", linewidth=0.8)


def plot(fit: AlphaFit, path: Path) -> None:
    """Plots figures 5.3 (effect of alpha on a cylinder's patch), 5.4 (its profile) and 5.5 (different depths)."""
    figure = Figure(figsize=(15, 9), layout="constrained")
    round_press, flat_press = find_press(fit, "cylinder", 5.0, 2), find_press(fit, "flat, wide", 5.0, 2)
    for column, factor in enumerate((0.2, 1.0, 5.0)):
        axis = figure.add_subplot(2, 3, column + 1, projection="3d")
        patch = patch_of(fit.layout, round_press, factor * fit.alpha)
        points = 1e3 * patch.points[patch.active]
        axis.scatter(*points.T, c=patch.pressure[patch.active], s=4)
        for k, color in enumerate(("tab:blue", "tab:red", "gold")):
            reach = 2e3 * math.sqrt(patch.eigenvalues[k]) * patch.eigenvectors[:, k]
            axis.plot(*np.transpose([1e3 * patch.centroid, 1e3 * patch.centroid + reach]), color=color, linewidth=3)
        axis.set(title=f"Figure 5.3: cylinder, 5 deg, alpha = {factor * fit.alpha:.2g} m/Pa", xlabel="x, mm")
        axis.set_aspect("equal")
        axis.locator_params(axis="z", nbins=3)
    profile, depths = figure.add_subplot(2, 2, 3), figure.add_subplot(2, 2, 4)
    for factor, color in ((0.5, "tab:orange"), (1.0, "tab:blue"), (2.0, "tab:green")):
        plot_profile(profile, fit, flat_press, factor * fit.alpha, color)
    plot_shape(profile, fit, flat_press)
    profile.set_title("Figure 5.4: wide flat, 5 deg, and its principal component for three alphas")
    for depth, color in enumerate(("tab:orange", "tab:blue", "tab:green")):
        press = find_press(fit, "flat, wide", 5.0, depth)
        plot_profile(depths, fit, press, fit.alpha, color)
        plot_shape(depths, fit, press)
    depths.set_title("Figure 5.5: wide flat, 5 deg, three depths")
    for axis in (profile, depths):
        axis.set(xlabel="x, mm", ylabel="z, mm")
        axis.legend()
    FigureCanvasAgg(figure).print_png(path)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--out", type=click.Path(path_type=Path), help="Writes the Markdown table and the plots here.")
def main(out: Path | None) -> None:
    """Regenerates table 5.1 of the thesis, next to its numbers."""
    fit = find_alpha(modulus=MODULUS, thickness=THICKNESS)
    errors = errors_by_shape(fit)
    print_table(fit, errors, Console())
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "table_5_1.md").write_text(markdown(fit, errors), encoding="utf-8")
        plot(fit, out / "figures_5_3_to_5_5.png")


if __name__ == "__main__":
    main()
