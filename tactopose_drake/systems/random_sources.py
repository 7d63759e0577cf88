"""Seeding of the random sources in a diagram, so that equal seeds give equal logs."""

from pydrake.common import RandomGenerator
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import RandomSource


def seed_random_sources(diagram: Diagram, context: Context, seed: int) -> int:
    """Seeds every random source in a diagram, at any depth, in the order of its systems.

    By default Drake numbers the sources over the life of the process, so that a second diagram in the same process has
    different noise. Only the random sources are changed (`Diagram.SetRandomContext` would move the plant, too).

    Args:
        diagram: root diagram, e.g. one to which `AddRandomInputs` was applied.
        context: its root context, before `Simulator.Initialize`.
        seed: any integer >= 0.

    Returns:
        The number of sources that were seeded.
    """
    return _seed(diagram, context, RandomGenerator(seed))


def _seed(diagram: Diagram, root_context: Context, generator: RandomGenerator) -> int:
    count = 0
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            count += _seed(system, root_context, generator)
        elif isinstance(system, RandomSource):
            system.SetRandomContext(system.GetMyContextFromRoot(root_context), generator)
            count += 1
    return count
