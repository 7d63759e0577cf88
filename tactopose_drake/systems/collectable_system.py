"""Python systems that the garbage collector can free together with their diagram.

A diagram and its systems refer to each other, so only Python's garbage collector can free them. It does not see the
Python objects that Drake's C++ code holds: callbacks of output ports and cache entries, and handles of cache entries,
would keep the diagram alive for ever (callbacks of events do not). Here the system itself holds those callbacks, and
C++ reaches them through a weak reference.
"""

import weakref
from collections.abc import Callable, Collection
from typing import Any, Self

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DependencyTicket, LeafSystem, OutputPort, ValueProducer

from tactopose_drake.core.kernel_library import make_kernels_ready

_LeafType: Any = type(LeafSystem)


class _OneDictionary(_LeafType):
    """Metaclass that adds `__slots__`, so that objects have only their base's dictionary.

    The garbage collector would count a second one twice.
    """

    def __new__(cls, name: str, bases: tuple[type, ...], content: dict[str, Any], **options: Any) -> Any:
        return super().__new__(cls, name, bases, {"__slots__": (), **content}, **options)


def _keeping(declare: Any) -> Any:
    """Wraps one of LeafSystem's Declare methods so that the system holds the callbacks."""

    def declare_kept(self: LeafSystem, *arguments: Any, **options: Any) -> Any:
        """As in LeafSystem."""
        kept = [_kept(self, value) for value in arguments]
        return declare(self, *kept, **{name: _kept(self, value) for name, value in options.items()})

    return declare_kept


class CollectableSystem(LeafSystem, metaclass=_OneDictionary):
    """The base of all systems here: a LeafSystem that Python's garbage collector can free with its diagram.

    Its constructor makes the compiled kernels ready, so that the first update need not wait for them.
    """

    def __init__(self) -> None:
        """Compiles or loads the kernels that are not ready yet."""
        super().__init__()
        make_kernels_ready()

    DeclareVectorOutputPort = _keeping(LeafSystem.DeclareVectorOutputPort)
    DeclareAbstractOutputPort = _keeping(LeafSystem.DeclareAbstractOutputPort)

    def declare_output(
        self, name: str, model: Any, value: Callable[[Context], Any], needs: Collection[DependencyTicket]
    ) -> OutputPort:
        """Declares an output port whose value is a function of the context.

        Args:
            name: name of the port.
            model: a value of the type that the port holds; of a vector port, its size.
            value: computes the port's value, given a context of this system.
            needs: tickets of what the value depends on; may be empty.
        """
        tickets = set(needs) or {self.nothing_ticket()}
        if isinstance(model, int):
            return self.DeclareVectorOutputPort(
                name, model, lambda context, output: output.SetFromVector(value(context)), tickets
            )
        return self.DeclareAbstractOutputPort(
            name, AbstractValue.Make(model).Clone, lambda context, output: output.set_value(value(context)), tickets
        )

    def declare_value(
        self, description: str, value: Callable[[Context], Any], needs: Collection[DependencyTicket]
    ) -> "CachedValue":
        """Declares a cache entry whose value is a function of the context; the arguments are those of `declare_output`.

        The description is the entry's name in messages.
        """
        return declare_cache(
            self,
            description,
            lambda: AbstractValue.Make(None),
            lambda context, cached: cached.set_value(value(context)),
            set(needs),
        )


class SharedState:
    """Base of immutable values of abstract state: Drake copies all state with each event, and a copy is the value."""

    def __deepcopy__(self, memo: Any) -> Self:
        return self


class CachedValue:
    """A cache entry of a system, referred to by its index."""

    def __init__(self, system: LeafSystem, index: Any) -> None:
        """Keeps a weak reference to the system."""
        self._system, self._index = weakref.ref(system), index

    def Eval(self, context: Any) -> Any:
        """Evaluates the entry in a context of its system."""
        return self._entry().Eval(context)

    def ticket(self) -> DependencyTicket:
        """The dependency ticket for computations that depend on the entry."""
        return self._entry().ticket()

    def _entry(self) -> Any:
        system = self._system()
        assert system is not None  # Only its own methods call this.
        return system.get_cache_entry(self._index)


def declare_cache(
    system: LeafSystem,
    description: str,
    allocate: Callable[[], Any],
    calc: Callable[[Any, Any], None],
    prerequisites: set[DependencyTicket],
) -> CachedValue:
    """Declares a cache entry.

    Args:
        system: the system that owns the entry.
        description: the entry's name in messages.
        allocate: returns a new AbstractValue.
        calc: computes the value, given a context and the AbstractValue to set.
        prerequisites: tickets of what the entry depends on.
    """
    producer = ValueProducer(allocate=_kept(system, allocate), calc=_kept(system, calc))
    return CachedValue(system, system.DeclareCacheEntry(description, producer, prerequisites).cache_index())


def _kept(system: LeafSystem, value: Any) -> Any:
    """A value that C++ may hold: a function is stored in the system and replaced by one that looks it up there."""
    if not callable(value):
        return value
    functions = system.__dict__.setdefault("_functions", [])
    functions.append(value)
    owner, index = weakref.ref(system), len(functions) - 1

    def call(*arguments: Any) -> Any:
        return owner()._functions[index](*arguments)  # type: ignore[union-attr]

    return call
