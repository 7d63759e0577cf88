"""Systems in Python whose diagram is freed when nobody uses it any more.

A diagram and its systems refer to each other, and only Python's garbage collector can free them. What Drake's C++ holds
of Python it does not see: the callback of an output port or of a cache entry, and the handle of one, keep the diagram
for ever, where those of events do not. So these callbacks are kept by the system, and C++ gets them by way of a weak
reference.
"""

import weakref
from collections.abc import Callable
from typing import Any

from pydrake.systems.framework import DependencyTicket, LeafSystem, ValueProducer

from tactopose_drake.core.kernel_library import make_kernels_ready

_LeafType: Any = type(LeafSystem)


class _OneDictionary(_LeafType):
    """Classes whose objects have no dictionary beside their base's, which the collector would count twice."""

    def __new__(cls, name: str, bases: tuple[type, ...], content: dict[str, Any], **options: Any) -> Any:
        return super().__new__(cls, name, bases, {"__slots__": (), **content}, **options)


def _keeping(declare: Any) -> Any:
    """One of LeafSystem's methods that declare something, with callbacks that are kept by the system."""

    def declare_kept(self: LeafSystem, *arguments: Any, **options: Any) -> Any:
        """As of a LeafSystem."""
        kept = [_kept(self, value) for value in arguments]
        return declare(self, *kept, **{name: _kept(self, value) for name, value in options.items()})

    return declare_kept


class CollectableSystem(LeafSystem, metaclass=_OneDictionary):
    """The base of all systems here: a LeafSystem that Python's garbage collector can free with its diagram.

    Once it is made, the compiled loops that it may run are ready.
    """

    def __init__(self) -> None:
        """Compiles or loads what is not ready yet."""
        super().__init__()
        make_kernels_ready()

    DeclareVectorOutputPort = _keeping(LeafSystem.DeclareVectorOutputPort)
    DeclareAbstractOutputPort = _keeping(LeafSystem.DeclareAbstractOutputPort)


class CachedValue:
    """A cache entry of a system, by its number."""

    def __init__(self, system: LeafSystem, index: Any) -> None:
        """Keeps a weak reference to the system."""
        self._system, self._index = weakref.ref(system), index

    def Eval(self, context: Any) -> Any:
        """The value in a context of the system."""
        return self._entry().Eval(context)

    def ticket(self) -> DependencyTicket:
        """What depends on the value has this among its prerequisites."""
        return self._entry().ticket()

    def _entry(self) -> Any:
        system = self._system()
        assert system is not None  # Its own methods ask.
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
        system: whose it is.
        description: for messages.
        allocate: makes an AbstractValue.
        calc: computes it, of a context and the value.
        prerequisites: what it depends on.
    """
    producer = ValueProducer(allocate=_kept(system, allocate), calc=_kept(system, calc))
    return CachedValue(system, system.DeclareCacheEntry(description, producer, prerequisites).cache_index())


def _kept(system: LeafSystem, value: Any) -> Any:
    """A value that C++ may keep: in place of a function, one that looks for it at the system."""
    if not callable(value):
        return value
    functions = system.__dict__.setdefault("_functions", [])
    functions.append(value)
    owner, index = weakref.ref(system), len(functions) - 1

    def call(*arguments: Any) -> Any:
        return owner()._functions[index](*arguments)  # type: ignore[union-attr]

    return call
