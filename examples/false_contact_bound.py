"""What an ideal estimator makes of touches of which one contact is off: a bound for the study `world_not_as_told.py`.

python examples/false_contact_bound.py --trials 200 --probabilities 1 0.68 0.23

The ideal estimator knows how the study makes the touches, see `ideal_belief.py`, except for one thing: that a contact
is off. It believes so with the probability that the table names. With 1 it knows everything; with 0.68 the odds of a
displaced contact are those of `tp.estimate_pose`; with 0.23 each contact is displaced with about 5 %. What counts as
right, as sure and as wrong is as in that study.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np
from calibration import OBJECTS
from ideal_belief import Surface, believe, find_starts
from rich.progress import track
from world_not_as_told import SURE, WORLDS, Array, is_beyond, is_right, touch_object

import tactopose_drake as tp
from tactopose_drake.core.posterior import GaussianMixture
from tactopose_drake.resources import model_path

WORLD = "one contact 10 to 30 mm off"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Answer:
    """An answer, compared with the truth.

    Attributes:
        right: whether the pose is right.
        sure: whether its probability is above 95 %.
        beyond: whether the truth is outside of its 99.9 % ellipsoid.
        of_package, of_truth: probability of the modes whose 99.9 % ellipsoids contain the package's answer, and the
            true pose.
    """

    right: bool
    sure: bool
    beyond: bool
    of_package: float
    of_truth: float


def answer_of(model: tp.ObjectModel, mixture: GaussianMixture, X_true: Array, X_package: Array) -> Answer:
    """The answer that a belief gives: its first mode."""
    X_PO, covariance, weights = mixture.X_PO, mixture.covariance, mixture.weights

    def mass_at(X_asked: Array) -> float:
        worth = np.flatnonzero(weights > 1e-4)
        return sum(float(weights[j]) for j in worth if not is_beyond(model, X_PO[j], covariance[j], X_asked))

    return Answer(
        right=is_right(model, X_PO[0], X_true),
        sure=bool(weights[0] > SURE),
        beyond=is_beyond(model, X_PO[0], covariance[0], X_true),
        of_package=mass_at(X_package),
        of_truth=mass_at(X_true),
    )


def run_trial(
    surface: Surface, seed: int, has_prior: bool, probabilities: list[float], only_wrong: bool
) -> list[Answer]:
    """The answers of the package, and of the ideal estimator for each probability, to one touch.

    If `only_wrong`, those of the ideal estimator are missing unless the package's answer is sure and wrong.
    """
    model, generator = surface.model, np.random.default_rng(seed)
    touch = touch_object(model, WORLDS[WORLD], seed, 5, has_prior)
    hypotheses = tp.estimate_pose(model, touch.contacts, prior=touch.prior, seed=seed).hypotheses
    belief = GaussianMixture(
        np.array([hypothesis.X_PO.GetAsMatrix34() for hypothesis in hypotheses]),
        np.array([hypothesis.probability for hypothesis in hypotheses]),
        np.array([hypothesis.covariance for hypothesis in hypotheses]),
    )
    X_package = belief.X_PO[0]
    answers = [answer_of(model, belief, touch.X_PO, X_package)]
    if only_wrong and not (answers[0].sure and answers[0].beyond):
        return answers
    starts = find_starts(model, touch, generator)
    for probability in probabilities:
        mixture = believe(surface, touch, starts, probability, generator).mixture
        answers.append(answer_of(model, mixture, touch.X_PO, X_package))
    return answers


def row(name: str, answers: list[Answer]) -> str:
    """A line of the table."""
    sure = [answer for answer in answers if answer.sure]
    return (
        f"{name:28s} right {np.mean([answer.right for answer in answers]):5.1%}, "
        f"sure and wrong {sum(answer.beyond for answer in sure):3d} of {len(sure):3d}"
    )


def row_of_wrong(name: str, answers: list[Answer]) -> str:
    """A line on the touches in which the package is sure and wrong."""
    sure = [answer for answer in answers if answer.sure]
    return (
        f"{name:28s} of {len(answers)}: sure and right {sum(not answer.beyond for answer in sure):3d}, "
        f"sure and wrong {sum(answer.beyond for answer in sure):3d}, not sure {len(answers) - len(sure):3d}; "
        f"gives the truth {np.mean([answer.of_truth for answer in answers]):.0%} and the package's answer "
        f"{np.mean([answer.of_package for answer in answers]):.0%} in the mean"
    )


def main() -> None:
    """Prints the table with a prior and without one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--scans", type=Path, help="a folder of further meshes")
    parser.add_argument("--probabilities", nargs="+", type=float, default=[1.0, 0.68, 0.23], help="of a displaced one")
    parser.add_argument("--only-wrong", action="store_true", help="the ideal answers only where the package is wrong")
    arguments = parser.parse_args()
    meshes = [model_path("objects", f"{name}.obj") for name in arguments.objects]
    if arguments.scans is not None:
        meshes += sorted(arguments.scans.glob("*.obj"))
    surfaces = [Surface(tp.ObjectModel.from_mesh(mesh)) for mesh in meshes]
    names = ["the package", *(f"ideal, believes in {share:.0%}" for share in arguments.probabilities)]
    for title, has_prior in (("with a prior of 33 mm and 16 degrees", True), ("without a prior", False)):
        print(f"{title}:")
        trials = [
            run_trial(surfaces[seed % len(surfaces)], seed, has_prior, arguments.probabilities, arguments.only_wrong)
            for seed in track(range(arguments.first_seed, arguments.first_seed + arguments.trials), description=title)
        ]
        if not arguments.only_wrong:
            for name, answers in zip(names, zip(*trials, strict=True), strict=True):
                print(row(name, list(answers)))
        wrong = [answers for answers in trials if answers[0].sure and answers[0].beyond]
        for name, answers in zip(names[1:], zip(*(answers[1:] for answers in wrong), strict=True), strict=bool(wrong)):
            print(row_of_wrong(name, list(answers)))


if __name__ == "__main__":
    main()
