"""Seeds of the random sources in a diagram: same seed, same log."""

from pydrake.common import RandomGenerator
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import RandomSource


def seed_random_sources(diagram: Diagram, context: Context, seed: int) -> int:
    """Seeds every random source in a diagram, at any depth, in the order of its systems.

    Without it Drake numbers the sources over the life of the process, so a second diagram of the same program has other
    noise. Nothing but the random sources is touched (`Diagram.SetRandomContext` would move the plant too).

    Args:
        diagram: root diagram, e.g. one that `AddRandomInputs` has worked on.
        context: its root context, before `Simulator.Initialize`.
        seed: any integer >= 0.

    Returns:
        How many sources were seeded.
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
