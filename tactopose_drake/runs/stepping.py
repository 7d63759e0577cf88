"""The loop that all runs share, and the view of a run for observers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from tactopose_drake.station.can_devices import CanDevices


@dataclass(frozen=True, eq=False)
class RunView:
    """A run at one moment.

    Attributes:
        diagram: the station's diagram.
        context: its root context.
        devices: the devices of a run on CAN devices or their logs; otherwise None.
        lost: sentences on what of a finished run could not be recorded, and why.
        cut: sentences on why a finished replay did not play the whole recording; empty if it did.
        slowness: a sentence on how far a finished run was behind its devices at its slowest; empty if it kept up.
        outcome: the outcome of a finished run's grasp, if it was simulated.
        true_pose: true X_PO, if it is simulated.
        status: replaces the diagram's status for senses by messages: it adds remarks on the messages, or says that none
            arrive. Otherwise empty.
        start: the context's time at the start of the run, s; with messages it is by their sender's clock.
    """

    diagram: Diagram
    context: Context
    devices: CanDevices | None = None
    lost: tuple[str, ...] = ()
    cut: tuple[str, ...] = ()
    slowness: str = ""
    outcome: str = ""
    true_pose: RigidTransform | None = None
    status: str = ""
    start: float = 0.0

    @property
    def time(self) -> float:
        """Time since the start of the run, s."""
        return float(self.context.get_time()) - self.start

    def value(self, port: str, otherwise: Any = None) -> Any:
        """The current value of an output port of the station; `otherwise` if there is no such port."""
        return self.diagram.GetOutputPort(port).Eval(self.context) if self.diagram.HasOutputPort(port) else otherwise

    def believed(self, name: str) -> Any:
        """The current value of an output port of the tracking if there is one, otherwise of the estimation."""
        return self.value(f"tracked_{name}" if self.diagram.HasOutputPort(f"tracked_{name}") else name)


Observer = Callable[[RunView], None]
Progress = Callable[[str], None]


def advance(
    simulator: Simulator,
    devices: CanDevices | None,
    period: float,
    until: float,
    observer: Observer,
    end: Callable[[], bool] = lambda: False,
) -> RunView:
    """Advances a simulator in steps, and calls an observer after each.

    Args:
        simulator: an initialized simulator of a station.
        devices: its devices.
        period: duration of a step, s.
        until: end time, s; may be infinite.
        observer: called with the run after each step.
        end: called after each step; returns whether it was the last.

    Returns:
        The run at its end.
    """
    context = simulator.get_context()
    view = RunView(simulator.get_system(), context, devices)
    step = 0
    while context.get_time() < until:
        step += 1
        simulator.AdvanceTo(min(step * period, until))
        observer(view)
        if end():
            break
    return view
