"""A belief in a diagram whose inputs follow a script, and what it says at each of its periods.

Never may a pose be called an estimate that is none: `Run.assert_never_a_silent_guess` looks at every instant.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.poses import increments_between
from tactopose_drake.core.tracking.frame import PoseMeasurement
from tactopose_drake.core.tracking.pose_belief import PoseBelief
from tests.core.tracking.boxes import touch

PERIOD = 0.01
X_PO = RigidTransform(RollPitchYaw(0.4, -0.2, 1.0), [0.02, -0.03, 0.1])
COVARIANCE = np.diag(np.repeat([math.radians(10.0) ** 2, 0.02**2], 3))
FINGERS = tuple("abcdef")
METRES_OFF = RigidTransform([2.0, 0.0, 0.0]) @ X_PO
ANYWHERE = HandGeometry(np.array([[1.0, 0.0, 0.0]]), np.array([0.01]))

Signal = Callable[[float], Any]


class Script(LeafSystem):
    """Gives values by the time."""

    def __init__(self, **signals: Signal) -> None:
        super().__init__()
        for name, signal in signals.items():
            self._declare(name, signal)

    def _declare(self, name: str, signal: Signal) -> None:
        first = signal(0.0)
        when = {self.time_ticket()}
        if isinstance(first, np.ndarray):

            def calc(context: Context, output: BasicVector) -> None:
                output.SetFromVector(signal(context.get_time()))

            self.DeclareVectorOutputPort(name, len(first), calc, when)
        else:

            def calc_value(context: Context, output: AbstractValue) -> None:
                output.set_value(signal(context.get_time()))

            model = AbstractValue.Make(first if isinstance(first, RigidTransform) else None)
            self.DeclareAbstractOutputPort(name, model.Clone, calc_value, when)


class Instant(NamedTuple):
    time: float
    belief: PoseBelief
    status: str
    pose: RigidTransform

    @property
    def word(self) -> str:
        return self.status.split(":")[0]


class Run:
    """A belief in a diagram with scripted inputs, and what it said at each of its periods."""

    def __init__(self, system: LeafSystem | Diagram, **signals: Signal) -> None:
        builder = DiagramBuilder()
        self.system = builder.AddNamedSystem("belief", system)
        script = builder.AddSystem(Script(**signals))
        for name in signals:
            builder.Connect(script.GetOutputPort(name), self.system.GetInputPort(name))
        self.simulator = Simulator(builder.Build())
        self.context = self.simulator.get_mutable_context()
        self.instants: list[Instant] = []

    def until(self, time: float) -> Instant:
        """Advances to where the belief is of that time, in the middle between two of its periods."""
        for k in range(round(self.context.get_time() / PERIOD - 0.5) + 1, round(time / PERIOD) + 1):
            self.simulator.AdvanceTo((k + 0.5) * PERIOD)
            belief, status, pose = (self.read(name) for name in ("belief", "status", "object_pose"))
            # A pose that is read is the system's own, which changes.
            self.instants.append(Instant(belief.time, belief, status, RigidTransform(pose)))
        return self.instants[-1]

    def set_back(self, time: float) -> None:
        """Lets an earlier time begin once more, with the state as it is."""
        self.context.SetTime(time)
        self.simulator.Initialize()
        self.simulator.AdvanceTo(time + 1e-6)

    def read(self, name: str) -> Any:
        return self.system.GetOutputPort(name).Eval(self.system.GetMyContextFromRoot(self.context))

    def words(self, start: float, end: float) -> set[str]:
        return {instant.word for instant in self.instants if start < instant.time <= end}

    def assert_never_a_silent_guess(self, truth: Callable[[float], RigidTransform], limit: float = 0.01) -> None:
        for time, belief, status, pose in self.instants:
            word = status.split(":")[0]
            if word in ("no_contact", "lost"):
                continue
            one_of_several = word == "ambiguous" or belief.probability[0] < 0.5
            assert word == "ambiguous" or not one_of_several or "several poses" in status, status
            modes = belief.X_PO if one_of_several else belief.X_PO[:1]
            off = [increments_between(X, truth(time).GetAsMatrix34()) for X in modes]
            assert min(float(np.linalg.norm(u[3:])) for u in off) < limit, (time, status)
            assert min(float(np.linalg.norm(u[:3])) for u in off) < math.radians(20.0), (time, status)
            assert pose.IsExactlyEqualTo(RigidTransform(belief.X_PO[0]))


def generator_at(time: float) -> np.random.Generator:
    return np.random.default_rng(round(1e4 * time))


def touched(
    X: Callable[[float], RigidTransform], when: Callable[[float], bool] = lambda time: True
) -> dict[str, Signal]:
    """The box's contacts at a pose by the time, noise and all, and whose they are."""

    def contacts(time: float) -> Contacts:
        return touch(X(time).GetAsMatrix34(), generator_at(time)) if when(time) else Contacts.empty()

    return {"contacts": contacts, "fingers_in_contact": lambda time: FINGERS if when(time) else ()}


def still(time: float) -> RigidTransform:
    return X_PO


def seen(X: RigidTransform, time: float, noise: np.random.Generator | None = None) -> PoseMeasurement:
    """A pose of vision; with errors as its covariance says, or without."""
    u = np.zeros(6) if noise is None else 0.3 * noise.multivariate_normal(np.zeros(6), COVARIANCE)
    return PoseMeasurement(time, X @ RigidTransform(RollPitchYaw(*u[:3]), u[3:]), COVARIANCE)


def begun(vision: Signal, since: float = 0.1) -> Signal:
    """Vision that is good until a time, and then what is given."""
    first = seen(X_PO, 0.0, np.random.default_rng(1))
    return lambda time: first if time < since else vision(time)
