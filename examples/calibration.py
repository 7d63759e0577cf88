"""How honest the belief is: does the truth lie where the hypotheses say, as often as they say?

python examples/calibration.py --trials 1000 --out calibration

Objects in random poses are touched at random places, with the noise that the estimate is told. A hypothesis holds the
truth when the squared Mahalanobis distance between them, up to the object's symmetries, is below the 95 % point of
chi-square with six degrees of freedom. Asked is how often the truth lies in one of the smallest set of hypotheses that
holds 95 % of the mass.

An exact belief would not score 95 % by this: if the set holds less than all of the mass, as little as 0.95 x 0.95;
where ellipsoids overlap, or a symmetry leaves fewer than six dimensions, more. What it would score is found by drawing
truths from each belief itself: the line "promised".
"""

import argparse
import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from nearest_images import nearest_increments
from numpy.typing import NDArray
from rich.progress import track
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.poses import make_poses, random_rotations, retract
from tactopose_drake.core.posterior import cramer_rao_bound
from tactopose_drake.core.synthetic import touch_surface
from tactopose_drake.resources import model_path

OBJECTS = (
    "bust",
    "cube",
    "cylinder",
    "light_bulb",
    "mug",
    "pencil",
    "screwdriver",
    "soda_can",
    "spray_bottle",
    "tea_box",
    "thermal_bottle",
    "wine_glass",
)
LEVELS = np.array([0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99])
LEVEL = 0.95
# A pose is unique when its hypothesis carries more of the mass, and nothing is free there or at the truth. In what is
# left of the mass the truth may honestly be: at 0.99 it is in each fifth set of 1000 trials once, and the squared error
# of that trial, in the thousands, is most of the set's mean.
UNIQUE = 0.999
# It is well known when no direction is wider than this share of the object's size. The Cramer-Rao bound takes the
# surface for as curved as it is at the truth; over longer ways that is another surface, with edges.
WELL_KNOWN = 0.05
DRAWS = 20  # Truths drawn from each belief.

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """What one estimate said, and how far off it was.

    Attributes:
        name: the object's.
        held: for each of LEVELS, whether its region holds the truth.
        promised: for LEVEL, the share of truths drawn from the belief itself that its region holds.
        probability, cost: of the best hypothesis.
        unique: whether it is all that is left.
        mahalanobis: the best one's squared distance to the truth.
        well_known: whether it is narrow, too.
        translation, rotation: of the best one's error, m, rad.
        said_translation, said_rotation: the root mean squares that its covariance says.
        least_translation, least_rotation: the Cramer-Rao bounds of their root mean squares.
        seconds: that the estimate took.
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
    seconds: float


def region_holds(
    model: tp.ObjectModel, estimate: tp.PoseEstimate, X_true: Array, levels: Sequence[float] | Array
) -> NDArray[np.bool_]:
    """Whether the region of each level holds each of the poses (n, 3, 4), shape (n, levels)."""
    before = np.cumsum([0.0] + [hypothesis.probability for hypothesis in estimate.hypotheses])[:-1]
    held = np.zeros((len(X_true), len(levels)), dtype=np.bool_)
    for mass_before, hypothesis in zip(before, estimate.hypotheses, strict=True):
        if mass_before >= max(levels):
            break
        information = np.linalg.inv(hypothesis.covariance)
        u = nearest_increments(model, hypothesis.X_PO.GetAsMatrix34(), information, X_true)
        square = np.einsum("bi,ij,bj->b", u, information, u)
        held |= (square[:, None] < chi2.ppf(levels, 6)) & (mass_before < np.asarray(levels))
    return held


def run_trial(model: tp.ObjectModel, seed: int, arguments: argparse.Namespace, has_prior: bool) -> Trial:
    """Touches the object, estimates its pose, and compares."""
    noise = {"sigma_position": 0.0009 * arguments.noise, "sigma_normal": np.radians(5.0) * arguments.noise}
    generator = np.random.default_rng(seed)
    X_PO = make_poses(random_rotations(generator, 1), 0.05 * generator.normal(size=(1, 3)))[0]
    prior = tp.PosePrior(X_PO)
    prior = tp.PosePrior(retract(X_PO, generator.normal(size=6) * prior.sigmas)) if has_prior else None
    # The same random numbers with and without noise give the measured contacts and the true ones.
    state = generator.bit_generator.state
    contacts = touch_surface(model, X_PO, arguments.contacts, generator, spread=arguments.spread, **noise)
    generator.bit_generator.state = state
    exact = touch_surface(
        model, X_PO, arguments.contacts, generator, spread=arguments.spread, sigma_position=0.0, sigma_normal=0.0
    )
    estimate = tp.estimate_pose(model, contacts, prior=prior, seed=seed)

    best = estimate.best
    information = np.linalg.inv(best.covariance)
    error = nearest_increments(model, best.X_PO.GetAsMatrix34(), information, X_PO[None])[0]
    bound = cramer_rao_bound(model, tp.Contacts(exact.p_PC, exact.n_PC, **noise), X_PO, prior)
    unique = best.probability > UNIQUE and not len(best.free_directions) and not len(bound.free_directions)
    metres = np.repeat([model.size / 2.0, 1.0], 3)  # Of the surface, for each unit of the increments.
    widest = np.sqrt(np.linalg.eigvalsh(best.covariance * np.outer(metres, metres))[-1])
    return Trial(
        name=model.name,
        held=region_holds(model, estimate, X_PO[None], LEVELS)[0],
        promised=float(region_holds(model, estimate, draw(model, estimate, generator), [LEVEL]).mean()),
        probability=best.probability,
        cost=best.cost,
        unique=unique,
        well_known=unique and widest < WELL_KNOWN * model.size,
        mahalanobis=float(error @ information @ error),
        translation=float(np.linalg.norm(error[3:])),
        rotation=float(np.linalg.norm(error[:3])),
        said_translation=float(np.sqrt(np.trace(best.covariance[3:, 3:]))),
        said_rotation=float(np.sqrt(np.trace(best.covariance[:3, :3]))),
        least_translation=bound.rms_translation,
        least_rotation=bound.rms_rotation,
        seconds=estimate.duration,
    )


def draw(model: tp.ObjectModel, estimate: tp.PoseEstimate, generator: np.random.Generator) -> Array:
    """Poses (DRAWS, 3, 4) from the belief itself, but for turns that change nothing."""
    weights = np.array([hypothesis.probability for hypothesis in estimate.hypotheses])
    chosen = generator.choice(len(weights), DRAWS, p=weights / weights.sum())
    poses = []
    for hypothesis in (estimate.hypotheses[i] for i in chosen):
        X_PO = hypothesis.X_PO.GetAsMatrix34()
        u = np.linalg.cholesky(hypothesis.covariance) @ generator.normal(size=6)
        for symmetry in (symmetry for symmetry in model.symmetries if symmetry.is_continuous):
            turn = np.concatenate([symmetry.axis, -X_PO[:, :3] @ np.cross(symmetry.axis, symmetry.point)])
            u = u - (symmetry.axis @ u[:3]) * turn
        poses.append(retract(X_PO, u))
    return np.array(poses)


def rms(values: list[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def errors(trials: list[Trial]) -> str:
    """Root mean square errors, beside those that the covariances say, in units of the Cramer-Rao bound's."""
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
    """The figures in words, and those of each object."""
    at = int(np.flatnonzero(LEVELS == LEVEL)[0])
    held = np.array([trial.held[at] for trial in trials])
    unique = [trial for trial in trials if trial.unique]
    seconds = np.array([trial.seconds for trial in trials])
    error, promised = np.sqrt(held.mean() * (1 - held.mean()) / len(held)), np.mean([t.promised for t in trials])
    lines = [
        f"{title}: {len(trials)} trials, median {1e3 * np.median(seconds):.1f} ms, most {1e3 * seconds.max():.0f} ms",
        f"  truth in the smallest set that holds 95 %: {held.mean():.1%}, standard error {error:.1%}; "
        f"promised {promised:.1%}",
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
        row[1].hist(np.minimum(squares, 29.9), bins=30, range=(0, 30), density=True, alpha=0.5, label="unique poses")
        row[1].plot(grid, chi2.pdf(grid, 6), label="chi-square, 6 degrees of freedom")
        row[1].set(xlabel="squared Mahalanobis error (the last bin: and more)", ylabel="density")
        row[1].legend()

        cost = [trial.cost for trial in trials]
        millimetres = [1e3 * trial.translation for trial in trials]
        dots = row[2].scatter(cost, millimetres, c=[t.probability for t in trials], s=8, cmap="viridis", vmin=0, vmax=1)
        row[2].set(yscale="log", xlabel="cost of the best hypothesis", ylabel="its error, mm")
        figure.colorbar(dots, ax=row[2], label="its probability")
    FigureCanvasAgg(figure).print_png(path)


def main() -> None:
    """Prints the figures with a prior and without one, and draws them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--scans", type=Path, help="a folder of further meshes")
    parser.add_argument("--contacts", type=int, default=5)
    parser.add_argument("--noise", type=float, default=1.0, help="in units of 0.9 mm and 5 degrees")
    parser.add_argument("--spread", action="store_true", help="contacts far apart, rather than anywhere")
    parser.add_argument("--out", type=Path, default=Path("calibration"))
    arguments = parser.parse_args()
    meshes = [model_path("objects", f"{name}.obj") for name in arguments.objects]
    if arguments.scans is not None:
        meshes += sorted(arguments.scans.glob("*.obj"))
    models = [tp.ObjectModel.from_mesh(mesh) for mesh in meshes]

    started = time.perf_counter()
    runs: dict[str, list[Trial]] = {}
    for title, has_prior in (("with a prior of 33 mm and 16 degrees", True), ("without a prior", False)):
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.trials)
        runs[title] = [
            run_trial(models[seed % len(models)], seed, arguments, has_prior)
            for seed in track(seeds, description=title)
        ]
    text = "\n".join(summary(title, trials) for title, trials in runs.items())
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "calibration.txt").write_text(text + "\n", encoding="utf-8")
    save_figure(runs, arguments.out / "calibration.png")
    print(text)
    print(f"Written to {arguments.out} after {time.perf_counter() - started:.0f} s.")


if __name__ == "__main__":
    main()
