"""The belief of a pose over time: is it right, honest and fast while an object moves in the hand?

python examples/in_hand_motions.py --motions 200 --out in_hand_motions

Four families of motion, with contacts on the true mesh at 100 Hz: a screwdriver is turned about its axis, a cylinder is
rolled between thumb and fingers, objects are carried about by the fingertips, and objects slip under load. Each begins
with a guess that is 33 mm and 16 degrees off. The estimate knows the noise, and the fingertips' velocities with theirs;
of the slip nobody tells it.

A mode is right when the truth, or an image of it under the object's symmetries, lies in the ellipsoid that holds 99.9 %
of its Gaussian. Where one mode has all but 1 % of the mass, and the belief does not call itself lost, the normalised
estimation error squared is taken: its mean is 6 for an honest belief; spins that change nothing have no part in it, and
it is scaled from five dimensions to six. The errors of one motion are much the same from its first instant to its last,
as the calibration's are: the standard error of the mean is that of the motions' means.
"""

import argparse
import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.progress import track
from scipy.stats import chi2

import tactopose_drake as tp
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.poses import compose, exp_so3, increments_between, make_poses, random_rotations, retract
from tactopose_drake.core.shape.free_spin import turn_toward
from tactopose_drake.core.tracking.frame import Frame
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tactopose_drake.core.tracking.pose_tracker import PoseTracker
from tactopose_drake.core.tracking.rolling_touch import RollingTouch
from tactopose_drake.resources import model_path

Array = NDArray[np.float64]
PERIOD = 0.01
UNIQUE = 0.99
CARRIED = ("bust", "mug", "spray_bottle", "tea_box", "light_bulb")


@dataclasses.dataclass(frozen=True)
class Step:
    """What happens in one period: the object's twist in P, the fingertips' turning, and whether they slide."""

    twist: Array
    tip_turn: Array
    slides: bool = False


@dataclasses.dataclass(frozen=True)
class Instant:
    """What the belief said at one time, and the truth.

    Attributes:
        time: s.
        status: the belief's.
        right: whether one of the modes is right.
        best_right: whether the best of them is.
        unique: whether one mode has all but 1 % of the mass, and the belief does not call itself lost.
        square: normalised estimation error squared of the best mode.
        translation, rotation: its error, m and rad.
        said_translation, said_rotation: root mean squares of what it says these are.
        seconds: that the update took.
        slides: whether the object truly slid.
    """

    time: float
    status: str
    right: bool
    best_right: bool
    unique: bool
    square: float
    translation: float
    rotation: float
    said_translation: float
    said_rotation: float
    seconds: float
    slides: bool


def about(point: Array, axis: Array, rate: float, speed: Array | float = 0.0) -> Array:
    """The twist at P's origin of a turn about an axis through a point, rad/s, and a translation, m/s."""
    w = rate * axis
    return np.concatenate([w, np.cross(point, w) + speed])


def around_axis(model: tp.ObjectModel, generator: np.random.Generator, heights: Array, angles: Array) -> Array:
    """Points about the z axis of O, near its surface, where fingertips may touch."""
    radius = np.linalg.norm(model.vertices[:, :2], axis=1).max()
    angles = angles + generator.normal(size=len(angles)) * 0.15
    outside = np.stack([radius * np.cos(angles), radius * np.sin(angles), heights], axis=1)
    nearest = np.linalg.norm(model.samples.points - outside[:, None], axis=2).argmin(axis=1)
    return model.samples.points[nearest]


def spread_points(model: tp.ObjectModel, generator: np.random.Generator, count: int) -> Array:
    """Points all over the surface, far from each other."""
    points = model.samples.points
    chosen = [int(generator.integers(len(points)))]
    for _ in range(count - 1):
        some = generator.integers(len(points), size=10)
        gaps = np.linalg.norm(points[some, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(some[gaps.argmax()]))
    return points[chosen]


Motion = tuple[tp.ObjectModel, Array, Callable[[RollingTouch], Iterator[Step]]]


def turn_screwdriver(generator: np.random.Generator, steps: int) -> Motion:
    """Five fingertips on handle and collar turn it back and forth, and roll on it as they go."""
    model = load("screwdriver")
    height = model.vertices[:, 2].max()
    heights = height * generator.uniform(0.05, 0.5, size=5)
    p_OC = around_axis(model, generator, heights, np.linspace(0.0, 2.0 * np.pi, 5, endpoint=False))
    rate, share, phase = generator.uniform(0.5, 1.5), generator.uniform(-0.5, 0.5), generator.uniform(2.0, 5.0)
    tilt = 0.1 * generator.normal(size=3)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            axis = touch.X_PO[:, 2]
            now = rate * np.cos(phase * i * PERIOD)
            twist = about(touch.X_PO[:, 3], axis, now) + about(touch.X_PO[:, 3], tilt, now)
            yield Step(twist, np.tile(share * now * axis, (5, 1)))

    return model, p_OC, motion


def roll_cylinder(generator: np.random.Generator, steps: int) -> Motion:
    """The thumb stays, three or four fingers opposite move across, and the cylinder rolls between them."""
    model = load("cylinder")
    height = model.vertices[:, 2].max()
    count = int(generator.integers(4, 6))
    heights = height * np.linspace(0.1, 1.0, count)
    angles = np.where(np.arange(count) == 1, np.pi, 0.4 * generator.normal(size=count))
    p_OC = around_axis(model, generator, heights, angles)
    rate, phase = generator.uniform(0.3, 0.8), generator.uniform(2.0, 4.0)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            # About the thumb's contact: there the cylinder stands still.
            twist = about(touch.p_PC[1], touch.X_PO[:, 2], rate * np.cos(phase * i * PERIOD))
            yield Step(twist, np.zeros((count, 3)))

    return model, p_OC, motion


def carry(generator: np.random.Generator, steps: int) -> Motion:
    """Five fingertips that stick move it about and turn it."""
    model = load(CARRIED[int(generator.integers(len(CARRIED)))])
    axis, way = generator.normal(size=(2, 3))
    rate, speed, phase = generator.uniform(0.2, 0.8), generator.uniform(0.01, 0.04), generator.uniform(2.0, 4.0)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            now = np.cos(phase * i * PERIOD)
            w = rate * now * axis / np.linalg.norm(axis)
            twist = about(touch.X_PO[:, 3], w, 1.0, speed * now * way / np.linalg.norm(way))
            yield Step(twist, np.tile(w, (5, 1)))

    return model, spread_points(model, generator, 5), motion


def slip(generator: np.random.Generator, steps: int) -> Motion:
    """Fingers that hold still lose it after a while: it slides some way, and then it is held again."""
    model = load(CARRIED[int(generator.integers(len(CARRIED)))])
    start = int(generator.uniform(0.25, 0.5) * steps)
    end = start + int(generator.uniform(0.15, 0.3) * steps)
    way = generator.normal(size=3)
    way *= generator.uniform(0.005, 0.03) / np.linalg.norm(way)
    turn = 0.2 * generator.normal(size=3)

    def motion(touch: RollingTouch) -> Iterator[Step]:
        for i in range(steps):
            slides = start <= i < end
            twist = about(touch.X_PO[:, 3], turn, 1.0, way) if slides else np.zeros(6)
            yield Step(twist, np.zeros((5, 3)), slides)

    return model, spread_points(model, generator, 5), motion


FAMILIES = {"turn": turn_screwdriver, "roll": roll_cylinder, "carry": carry, "slip": slip}
_models: dict[str, tp.ObjectModel] = {}


def load(name: str) -> tp.ObjectModel:
    """An object of the package, loaded once."""
    if name not in _models:
        _models[name] = tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj"))
    return _models[name]


def images(model: tp.ObjectModel, X_PO: Array, information: Array, X_true: Array) -> Array:
    """Increments from a pose (3, 4) to the true one's images, nearest about continuous axes, shape (g, 6)."""
    turned = turn_toward(compose(X_true, model.symmetry_poses), X_PO, model.symmetries)
    for symmetry in [symmetry for symmetry in model.symmetries if symmetry.is_continuous] * 3:
        u = increments_between(X_PO, turned)
        shift = -turned[:, :, :3] @ np.cross(symmetry.axis, symmetry.point)
        turn = np.concatenate([np.broadcast_to(symmetry.axis, shift.shape), shift], axis=1)
        slope, bend = np.einsum("bi,ij,bj->b", turn, information, u), np.einsum("bi,ij,bj->b", turn, information, turn)
        R = exp_so3(-(slope / bend)[:, None] * symmetry.axis)
        turned = compose(turned, make_poses(R, symmetry.point - R @ symmetry.point))
    return increments_between(X_PO, turned)


def judge(model: tp.ObjectModel, belief: PoseBelief, X_true: Array, seconds: float, slides: bool) -> Instant:
    """Compares a belief with the truth."""
    dimensions = 6 - sum(symmetry.is_continuous for symmetry in model.symmetries)
    right: list[bool] = []
    square, error, covariance = np.nan, np.full(6, np.nan), np.full((6, 6), np.nan)
    for b in range(len(belief.X_PO)):
        information = np.linalg.inv(belief.covariance[b])
        u = images(model, belief.X_PO[b], information, X_true)
        squares = np.einsum("bi,ij,bj->b", u, information, u)
        right.append(bool(squares.min() < chi2.ppf(0.999, dimensions)))
        if b == 0:
            square, error, covariance = squares.min(), u[squares.argmin()], belief.covariance[0]
    return Instant(
        belief.time,
        belief.status,
        any(right),
        bool(right and right[0]),
        bool(len(belief.X_PO) and belief.probability[0] > UNIQUE and belief.status != "lost"),
        float(square) * 6.0 / dimensions,
        float(np.linalg.norm(error[3:])),
        float(np.linalg.norm(error[:3])),
        float(np.sqrt(np.trace(covariance[3:, 3:]))),
        float(np.sqrt(np.trace(covariance[:3, :3]))),
        seconds,
        slides,
    )


def run_motion(family: str, seed: int, steps: int) -> list[Instant]:
    """Moves one object, and follows it."""
    generator = np.random.default_rng([sorted(FAMILIES).index(family), seed])
    model, p_OC, motion = FAMILIES[family](generator, steps)
    R_PO = random_rotations(generator, 1)[0]
    X_PO = make_poses(R_PO, 0.03 * generator.normal(size=3) - R_PO @ model.vertices.mean(axis=0))
    touch = RollingTouch(model, X_PO, p_OC, generator)
    guess = tp.PosePrior(X_PO)
    guess = tp.PosePrior(retract(X_PO, generator.normal(size=6) * guess.sigmas))
    tracker = PoseTracker(model)
    belief, instants = tracker.start(0.0), []
    for i, step in enumerate(motion(touch)):
        touch.move(step.twist, step.tip_turn, step.slides, PERIOD)
        contacts, velocities = touch.measure()
        started = time.process_time()
        frame = Frame(PERIOD * (i + 1), Evidence(contacts, prior=guess), touch.sources, velocities)
        belief = tracker.step(belief, frame)
        instants.append(judge(model, belief, touch.X_PO, time.process_time() - started, step.slides))
    return instants


@dataclasses.dataclass(frozen=True)
class Figures:
    """Of one family: what is asked of the belief, and how long a break goes unnoticed and unhealed."""

    motions: int
    instants: int
    right: float
    best_right: float
    unique: float
    square: float
    square_error: float
    translation: float
    rotation: float
    median: float
    slowest: float
    detected: tuple[float, ...]
    recovered: tuple[float, ...]


def figures(runs: list[list[Instant]]) -> Figures:
    """Means over all instants of all motions."""
    instants = [instant for run in runs for instant in run]
    of_runs = [[instant.square for instant in run if instant.unique] for run in runs]
    squares = np.array([square for of_run in of_runs for square in of_run])
    sums = np.array([np.sum(np.array(of_run) - squares.mean()) for of_run in of_runs]) if len(squares) else np.zeros(1)
    seconds = [instant.seconds for instant in instants]
    detected, recovered = [], []
    for run in runs:
        begins = [i for i in range(1, len(run)) if run[i].slides and not run[i - 1].slides]
        ends = [i for i in range(1, len(run)) if run[i - 1].slides and not run[i].slides]
        detected += [next((b.time - run[i].time for b in run[i:] if b.status == "slipping"), np.inf) for i in begins]
        recovered += [next((b.time - run[i].time for b in run[i:] if b.right), np.inf) for i in ends]
    return Figures(
        motions=len(runs),
        instants=len(instants),
        right=float(np.mean([instant.right for instant in instants])),
        best_right=float(np.mean([instant.best_right for instant in instants])),
        unique=len(squares) / len(instants),
        square=float(squares.mean()) if len(squares) else np.nan,
        square_error=float(np.sqrt(np.sum(sums**2)) / len(squares)) if len(squares) else np.nan,
        translation=float(np.sqrt(np.nanmean([instant.translation**2 for instant in instants]))),
        rotation=float(np.sqrt(np.nanmean([instant.rotation**2 for instant in instants]))),
        median=float(np.median(seconds)),
        slowest=float(np.quantile(seconds, 0.99)),
        detected=tuple(detected),
        recovered=tuple(recovered),
    )


def line(name: str, f: Figures) -> str:
    """The figures in words."""
    text = (
        f"{name}: {f.motions} motions, {f.instants} instants; a right mode in {f.right:.1%}, the best is right in "
        f"{f.best_right:.1%}; unique in {f.unique:.0%}, NEES there {f.square:.2f} +- {f.square_error:.2f} (honest: 6); "
        f"errors {1e3 * f.translation:.2f} mm, {np.degrees(f.rotation):.2f} deg rms; "
        f"update {1e3 * f.median:.2f} ms median, {1e3 * f.slowest:.2f} ms at 99 %"
    )
    if f.recovered:
        late = [seconds for seconds in f.recovered if seconds > 0.2]
        seen = [seconds for seconds in f.detected if np.isfinite(seconds)]
        text += (
            f"; {len(f.recovered)} slips: {len(seen)} called so, after {1e3 * np.median(seen or [np.nan]):.0f} ms in "
            f"the median; {len(f.recovered) - len(late)} right within 200 ms of their end"
        )
    return text


def save_figure(runs: dict[str, list[list[Instant]]], path: Path) -> None:
    """For each family one motion in time, and the distribution of the normalised errors of all."""
    figure = Figure(figsize=(16, 3.4 * len(runs)), layout="constrained")
    axes = figure.subplots(len(runs), 3, squeeze=False)
    for (family, motions), row in zip(runs.items(), axes, strict=True):
        run = motions[0]
        t = [instant.time for instant in run]
        for ax, unit, error, said in (
            (row[0], "mm", [1e3 * i.translation for i in run], [1e3 * i.said_translation for i in run]),
            (row[1], "deg", np.degrees([i.rotation for i in run]), np.degrees([i.said_rotation for i in run])),
        ):
            ax.plot(t, error, label="error")
            ax.plot(t, said, "--", label="standard deviation that the belief states")
            for name, color in (("slipping", "tab:orange"), ("ambiguous", "tab:purple"), ("lost", "tab:red")):
                there = [instant.status == name for instant in run]
                if any(there):
                    ax.fill_between(t, 0, 1, where=there, transform=ax.get_xaxis_transform(), alpha=0.2, color=color)
                    ax.plot([], [], color=color, alpha=0.4, linewidth=6, label=f"it says {name}")
            slides = [instant.slides for instant in run]
            if any(slides):
                ax.fill_between(t, 0, 0.03, where=slides, transform=ax.get_xaxis_transform(), color="0.3")
                ax.plot([], [], color="0.3", linewidth=4, label="it truly slides")
            ax.set(xlabel="time, s", ylabel=f"of the first motion, {unit}", title=family, yscale="log")
            ax.legend(fontsize=7, loc="upper right")
        squares = [i.square for motion in motions for i in motion if i.unique]
        grid = np.linspace(0, 30, 121)
        row[2].hist(np.minimum(squares, 29.9), bins=60, range=(0, 30), density=True, alpha=0.5, label="all motions")
        row[2].plot(grid, chi2.pdf(grid, 6), label="chi-square, 6 degrees of freedom: an honest belief")
        row[2].set(
            xlabel="normalised estimation error squared (the last bin: and more)", ylabel="density", title=family
        )
        row[2].legend(fontsize=7)
    FigureCanvasAgg(figure).print_png(path)


def main() -> None:
    """Prints the figures of each family and of all, and draws them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=200, help="in all, shared out among the families")
    parser.add_argument("--steps", type=int, default=200, help="of 10 ms each")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES))
    parser.add_argument("--out", type=Path, default=Path("in_hand_motions"))
    arguments = parser.parse_args()
    each = max(1, arguments.motions // len(arguments.families))
    run_motion(arguments.families[0], arguments.first_seed, 3)  # The first compiles.
    runs = {
        family: [
            run_motion(family, arguments.first_seed + seed, arguments.steps)
            for seed in track(range(each), description=family)
        ]
        for family in arguments.families
    }
    lines = [line(family, figures(motions)) for family, motions in runs.items()]
    lines.append(line("all", figures([motion for motions in runs.values() for motion in motions])))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "in_hand_motions.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    save_figure(runs, arguments.out / "in_hand_motions.png")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
