"""Searches for tactile arrays: pairs of touches propose poses, the arrays' cells select among them."""

from collections.abc import Sequence

import numpy as np

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.patch_contacts import with_patches
from tactopose_drake.core.searches.evolution_strategy import EvolutionStrategy
from tactopose_drake.core.searches.pair_search import PairSearch, Start, global_stages, near_stages
from tactopose_drake.core.searches.search import PoseSpace, is_near_prior
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import FloatArray


def patch_search(model: ObjectModel, patches: Sequence[Patch], contacts: Contacts | None = None) -> PairSearch:
    """A pair search on the centroids and normals of the patches, and on contacts, for objectives on the patches' cells.

    Such an objective costs ten times as much as one on contacts, and fewer of its minima are spurious: so fewer of the
    same candidates are refined.

    Args:
        model: the object.
        patches: the touch that poses are proposed from; at least one pad feels the object.
        contacts: further contacts.
    """
    return PairSearch(
        model=model,
        contacts=with_patches(Contacts.empty() if contacts is None else contacts, patches),
        stages=global_stages(starts=60, kept=20),
        near_start=Start(candidates=120, samples=30, fewest=30, kept=20),
        near_stages=near_stages(kept=8),
    )


def corner_search(model: ObjectModel, patches: Sequence[Patch]) -> EvolutionStrategy:
    """The same proposals for objectives with jumps and kinks, such as those of point clouds.

    Their derivative says little: a point that enters a pad's sensing box makes the cost jump, and where the nearest
    point changes it has a kink. Descent along the derivative ends well above the minimum.

    Args:
        model: the object.
        patches: the touch that poses are proposed from; at least one pad feels the object.
    """
    pairs = patch_search(model, patches)

    def propose(space: PoseSpace, generator: np.random.Generator) -> FloatArray:
        start = pairs.near_start if is_near_prior(space) else pairs.start
        return pairs.proposals(space, generator).best(start.candidates)[0]

    return EvolutionStrategy(proposals=propose)
