"""Repeatability of estimates: contacts that are moved by a negligible distance, and another seed of the search.

python examples/held_still.py --trials 600

Objects in random poses are touched at random places, with three, five and eight contacts, with a prior and without, in
turn. The pose of each touch is estimated three times: once as it is, once with every coordinate moved by 1e-13 m, and
once with another seed. The study counts how often the probability of the best hypothesis changes by more than 0.02 and
0.05, and how often the best pose moves by more than one of its standard deviations.

Inputs are rounded to a nanometre, so that the first change has an effect only if a coordinate is at the border between
two of these. Two seeds are two searches. The hypotheses of both are weighted with the same samples; other samples would
change the weights by the standard error that the estimate states, or more: adapted samples underestimate their own
variance if many poses fit.
"""

import argparse
import itertools
from typing import NamedTuple

import numpy as np
from calibration import OBJECTS, touch
from nearest_images import nearest_increments
from rich.progress import track

import tactopose_drake as tp
from tactopose_drake.resources import model_path

MOVED = 1e-13  # m
NOTHING = np.zeros((2, 2, 0))
CELLS = tuple(itertools.product((3, 5, 8), (True, False)))  # number of contacts, and whether there is a prior


class Change(NamedTuple):
    """The change between two estimates from the same touch.

    Attributes:
        probability: change of the best hypothesis's probability.
        sigmas: change of the best pose, in standard deviations.
    """

    probability: float
    sigmas: float


def moved(contacts: tp.Contacts, generator: np.random.Generator) -> tp.Contacts:
    """The contacts with every coordinate moved in a random direction."""
    p_PC = contacts.p_PC + MOVED * generator.choice([-1.0, 1.0], size=contacts.p_PC.shape)
    return tp.Contacts(p_PC, contacts.n_PC, sigma_position=contacts.sigma_position, sigma_normal=contacts.sigma_normal)


def change(model: tp.ObjectModel, first: tp.PoseEstimate, other: tp.PoseEstimate) -> Change:
    """The change from the first estimate to the other."""
    information = np.linalg.inv(first.best.covariance)
    X_PO = [estimate.best.X_PO.GetAsMatrix34() for estimate in (first, other)]
    u = nearest_increments(model, X_PO[0], information, X_PO[1][None])[0]
    return Change(abs(first.best.probability - other.best.probability), float(np.sqrt(u @ information @ u)))


def run_trial(model: tp.ObjectModel, count: int, has_prior: bool, seed: int) -> tuple[Change, Change]:
    """Touches the object; returns the changes by moved contacts and by another seed."""
    usual = argparse.Namespace(noise=1.0, contacts=count, spread=False, without_normals=False)
    felt = touch(model, seed, usual, has_prior)
    answers = [
        tp.estimate_pose(model, contacts, prior=felt.prior, seed=of_search)
        for contacts, of_search in ((felt.contacts, 0), (moved(felt.contacts, felt.generator), 0), (felt.contacts, 1))
    ]
    return change(model, answers[0], answers[1]), change(model, answers[0], answers[2])


def main() -> None:
    """Prints a line for each number of contacts, with a prior and without."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=600, help="in all")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    arguments = parser.parse_args()
    models = [tp.ObjectModel.from_mesh(model_path("objects", f"{name}.obj")) for name in arguments.objects]
    changes: dict[tuple[int, bool], list[tuple[Change, Change]]] = {cell: [] for cell in CELLS}
    for trial in track(range(arguments.trials), description="touches"):
        cell = CELLS[trial % len(CELLS)]
        model = models[trial // len(CELLS) % len(models)]
        changes[cell].append(run_trial(model, *cell, arguments.first_seed + trial))
    for (count, has_prior), of_cell in changes.items():
        print(row(f"{count} contacts, {'with' if has_prior else 'without'} a prior", of_cell))
    print(row("all", [pair for of_cell in changes.values() for pair in of_cell]))


def row(name: str, of_cell: list[tuple[Change, Change]]) -> str:
    """A line of the table: the shares of touches whose change exceeds each limit."""
    by_move, by_seed = (np.array(each).reshape(-1, 2).T for each in zip(*of_cell, strict=True)) if of_cell else NOTHING
    asked = [by_move[0] > 0.02, by_move[1] > 1.0, by_seed[0] > 0.02, by_seed[0] > 0.05, by_seed[1] > 1.0]
    shares = [f"{np.count_nonzero(some) / max(len(some), 1):5.1%}" for some in asked]
    return (
        f"{name:27s} {len(of_cell):5d} touches; moved: {shares[0]} by > 0.02, {shares[1]} by > 1 sigma; "
        f"another seed: {shares[2]} by > 0.02, {shares[3]} by > 0.05, {shares[4]} by > 1 sigma"
    )


if __name__ == "__main__":
    main()
