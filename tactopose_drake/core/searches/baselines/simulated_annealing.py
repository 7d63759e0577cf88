"""Simulated annealing over the increments from the centre of a space, by SciPy.

Source: [X97] Y. Xiang et al., Generalized simulated annealing algorithm and its application to the Thomson model, 1997,
which `scipy.optimize.dual_annealing` implements.
"""

import contextlib
import dataclasses

import numpy as np
import scipy

from tactopose_drake.core.searches.box_search import BoxSearch
from tactopose_drake.core.searches.candidates import CandidatePoses
from tactopose_drake.core.searches.search import StopSignal
from tactopose_drake.core.validation import FloatArray


class _StoppedError(Exception):
    """Ends SciPy's loop from within the cost."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulatedAnnealing(BoxSearch):
    """Generalised simulated annealing on the box that the space reaches; the best poses evaluated are refined."""

    max_evaluations: int = 30_000

    def try_poses(self, candidates: CandidatePoses, generator: np.random.Generator, should_stop: StopSignal) -> None:
        """Runs dual annealing until the evaluations are spent, or it should stop."""

        def cost(y: FloatArray) -> float:
            if len(candidates) and should_stop():
                raise _StoppedError
            return candidates.try_pose(y)

        with contextlib.suppress(_StoppedError):
            scipy.optimize.dual_annealing(
                cost,
                [(-1.0, 1.0)] * 6,
                maxiter=self.max_evaluations,  # Not binding: the number of evaluations is.
                maxfun=self.max_evaluations,
                no_local_search=True,  # It would use finite-difference gradients.
                x0=np.zeros(6),
                rng=generator,
            )
