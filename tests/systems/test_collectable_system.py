"""Diagrams with systems in Python are freed, whatever these declare and however they were looked at."""

import gc
import importlib
import pkgutil
import weakref
from collections.abc import Callable

import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, EventStatus, LeafSystem, State

import tactopose_drake
from tactopose_drake.systems.collectable_system import CollectableSystem, declare_cache


class Everything(CollectableSystem):
    """Declares all that a system can, with callbacks that hold it."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[str] = []
        self.vector = self.DeclareVectorInputPort("vector", 1)
        self.abstract = self.DeclareAbstractInputPort("abstract", AbstractValue.Make(None))
        self.number = self.DeclareDiscreteState(1)
        self.thing = self.DeclareAbstractState(AbstractValue.Make(0))
        self.cached = declare_cache(
            self, "text", lambda: AbstractValue.Make(""), self._calc_cached, {self.abstract_state_ticket(self.thing)}
        )
        self.first = self.DeclareVectorOutputPort("first", 1, self._calc_vector, {self.cached.ticket()})

        def calc(context: Context, output: AbstractValue) -> None:
            output.set_value(self.cached.Eval(context))

        self.second = self.DeclareAbstractOutputPort("second", lambda: AbstractValue.Make(""), calc)
        self.third = self.DeclareStateOutputPort("third", self.thing)
        self.doubled = self.declare_value(
            "doubled", lambda context: 2 * self._count(context), {self.all_state_ticket()}
        )
        doubled = {self.doubled.ticket()}
        self.declare_output("doubled", 1, lambda context: [self.doubled.Eval(context)], doubled)
        self.declare_output("words", "", lambda context: f"twice {self._count(context)}", doubled)
        self.declare_output("always", [], lambda context: [self.calls is not None], ())
        self.DeclareInitializationPublishEvent(self._publish)
        self.DeclareInitializationDiscreteUpdateEvent(self._update_number)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._update)
        self.DeclarePeriodicPublishEvent(0.1, 0.1, self._publish)
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.1, self._update_number)
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.1, 0.1, self._update)

    def _count(self, context: Context) -> int:
        return context.get_abstract_state(int(self.thing)).get_value()

    def _calc_cached(self, context: Context, cached: AbstractValue) -> None:
        self.calls.append("cached")
        cached.set_value(str(self._count(context)))

    def _calc_vector(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self.cached.Eval(context)))

    def _publish(self, context: Context) -> EventStatus:
        self.calls.append("publish")
        return EventStatus.Succeeded()

    def _update_number(self, context: Context, values: object) -> EventStatus:
        self.calls.append("number")
        return EventStatus.Succeeded()

    def _update(self, context: Context, state: State) -> EventStatus:
        thing = state.get_mutable_abstract_state(int(self.thing))
        thing.set_value(thing.get_value() + 1)
        return EventStatus.Succeeded()


def diagram_of(system: LeafSystem) -> Diagram:
    builder = DiagramBuilder()
    builder.AddNamedSystem("system", system)
    for name in ("first", "second", "doubled", "words", "always"):
        builder.ExportOutput(system.GetOutputPort(name), name)
    return builder.Build()


def nested(diagram: Diagram) -> Diagram:
    builder = DiagramBuilder()
    builder.AddNamedSystem("inner", diagram)
    outer = builder.Build()
    outer.GetSubsystemByName("inner").GetSubsystemByName("system").GetOutputPort("first").get_index()
    return outer


def simulated(diagram: Diagram) -> Diagram:
    simulator = Simulator(diagram)
    simulator.set_monitor(lambda context: diagram.GetSubsystemByName("system") and None)
    simulator.AdvanceTo(0.25)
    assert simulator.get_system() is diagram
    return diagram


@pytest.mark.parametrize("use", [lambda diagram: diagram, nested, simulated])
def test_a_diagram_is_freed(use: Callable[[Diagram], Diagram]) -> None:
    diagram = use(diagram_of(Everything()))
    watched = weakref.ref(diagram)
    gc.collect()
    assert watched() is not None
    del diagram
    gc.collect()
    assert watched() is None


def test_callbacks_are_called_whoever_holds_the_system() -> None:
    simulator = Simulator(diagram_of(Everything()))
    gc.collect()
    simulator.AdvanceTo(0.25)
    diagram, context = simulator.get_system(), simulator.get_context()
    assert diagram.GetOutputPort("first").Eval(context) == [3.0]
    assert diagram.GetOutputPort("second").Eval(context) == "3"
    assert diagram.GetOutputPort("doubled").Eval(context) == [6.0]
    assert diagram.GetOutputPort("words").Eval(context) == "twice 3"
    assert diagram.GetOutputPort("always").Eval(context) == [True]
    calls = diagram.GetSubsystemByName("system").calls
    assert calls.count("publish") == calls.count("number") == 3
    assert calls.count("cached") == 1


def test_all_systems_of_the_package_are_of_this_kind() -> None:
    names = [
        module.name
        for module in pkgutil.walk_packages(tactopose_drake.__path__, "tactopose_drake.")
        if not module.ispkg
    ]
    systems = {
        found
        for name in names
        for found in vars(importlib.import_module(name)).values()
        if isinstance(found, type) and issubclass(found, LeafSystem) and found.__module__.startswith("tactopose_drake.")
    }
    assert len(systems) > 25
    assert [system.__name__ for system in systems if not issubclass(system, CollectableSystem)] == []
