"""The loop that all runs share, and what can be seen of one."""

from collections.abc import Callable
from dataclasses import dataclass

from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from tactopose_drake.station.can_devices import CanDevices


@dataclass(frozen=True, eq=False)
class RunView:
    """A run at one moment.

    Attributes:
        diagram: of the station.
        context: its root context.
        devices: of a run on CAN devices or from their logs; None else.
        lost: what of a finished run could not be recorded, and why, in sentences.
        slowness: by how much a finished run on devices fell behind them, in a sentence; empty where it kept up.
        outcome: how the grasp of a finished run went, where a simulator knows the truth.
        true_pose: X_PO, where a simulator knows it.
        status: what is said in place of the diagram's status, of which that is a part: of messages also what is wrong
            with them, or that none comes any more. Empty where the diagram says all.
        start: the context's time when the run began, s: messages have their sender's clock.
    """

    diagram: Diagram
    context: Context
    devices: CanDevices | None = None
    lost: tuple[str, ...] = ()
    slowness: str = ""
    outcome: str = ""
    true_pose: RigidTransform | None = None
    status: str = ""
    start: float = 0.0

    @property
    def time(self) -> float:
        """Since the run began, s."""
        return float(self.context.get_time()) - self.start


def belief_port(view: RunView, name: str) -> str:
    """The port of what is believed: of the tracking where there is one, or else of the estimation."""
    tracked = f"tracked_{name}"
    return tracked if view.diagram.HasOutputPort(tracked) else name


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
    """Advances a simulator in steps, and shows the run after each.

    Args:
        simulator: of a station, initialised.
        devices: its devices.
        period: of the steps, s.
        until: time at which it ends; infinite where something else ends it.
        observer: is shown the run after each step.
        end: asked after each step whether this was the last.

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
