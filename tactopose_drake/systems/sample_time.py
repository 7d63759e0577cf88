"""The times of a simulated sensor's start and last sample, which tell whether the clock has been set back since."""

import weakref

import numpy as np
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from tactopose_drake.core.times import has_passed


class SampleTime:
    """Lets a system that samples begin anew when it is initialized at no later time than that of its last sample.

    Such a sample is of another run: the clock and the plant were set back. Without this, it would pass for a fresh one
    until the next. A simulator whose context's time was changed must be initialized before it goes on. All the system's
    state returns to its defaults then, so it must hold nothing but what comes from samples.
    """

    def __init__(self, system: LeafSystem, wait: float = 0.0) -> None:
        """Declares a discrete state and an event of the system; keeps a weak reference to it.

        Args:
            system: the system that samples.
            wait: time in s from the start of a run until there is something to sample.
        """
        self._system, self._wait = weakref.ref(system), wait
        # Of the last sample, and of the first initialization of the run.
        self._times = system.DeclareDiscreteState([-np.inf, -np.inf])
        system.DeclareInitializationUnrestrictedUpdateEvent(self._begin)

    def is_early(self, context: Context) -> bool:
        """Whether there is nothing to sample yet."""
        _, begun = context.get_discrete_state(self._times).value()
        return not has_passed(context.get_time(), begun, self._wait)

    def note(self, context: Context, state: State) -> None:
        """Notes that there is a sample of the context's time; for every update that takes one."""
        state.get_mutable_discrete_state(self._times).SetAtIndex(0, context.get_time())

    def _begin(self, context: Context, state: State) -> EventStatus:
        system = self._system()
        assert system is not None  # It has the event.
        now, (last, begun) = context.get_time(), context.get_discrete_state(self._times).value()
        if now > last and -np.inf < begun <= now:
            return EventStatus.DidNothing()
        if now <= last:
            default = system.CreateDefaultContext()
            for i in range(default.num_discrete_state_groups()):
                state.get_mutable_discrete_state(i).SetFromVector(default.get_discrete_state(i).value())
            for i in range(default.num_abstract_states()):
                state.get_mutable_abstract_state(i).SetFrom(default.get_abstract_state(i))
        state.get_mutable_discrete_state(self._times).SetAtIndex(1, now)
        return EventStatus.Succeeded()
