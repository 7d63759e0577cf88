"""The time of a simulated sensor's last sample, which tells whether the clock has been set back since."""

import weakref

import numpy as np
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State


class SampleTime:
    """Lets a system that samples begin anew when it is initialized at no later time than that of its last sample.

    Such a sample is of another run: the clock and the plant were set back. Without this, it would pass for a fresh one
    until the next. A simulator whose context's time was changed must be initialized before it goes on. All the system's
    state returns to its defaults then, so it must hold nothing but what comes from samples.
    """

    def __init__(self, system: LeafSystem) -> None:
        """Declares a discrete state and an event of the system; keeps a weak reference to it."""
        self._system, self._time = weakref.ref(system), system.DeclareDiscreteState([-np.inf])
        system.DeclareInitializationUnrestrictedUpdateEvent(self._begin)

    def note(self, context: Context, state: State) -> None:
        """Notes that there is a sample of the context's time; for every update that takes one."""
        state.get_mutable_discrete_state(self._time).SetFromVector([context.get_time()])

    def _begin(self, context: Context, state: State) -> EventStatus:
        system = self._system()
        assert system is not None  # It has the event.
        if context.get_time() > context.get_discrete_state(self._time).value()[0]:
            return EventStatus.DidNothing()
        default = system.CreateDefaultContext()
        for i in range(default.num_discrete_state_groups()):
            state.get_mutable_discrete_state(i).SetFromVector(default.get_discrete_state(i).value())
        for i in range(default.num_abstract_states()):
            state.get_mutable_abstract_state(i).SetFrom(default.get_abstract_state(i))
        return EventStatus.Succeeded()
