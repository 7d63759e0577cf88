"""The joint status of all of a hand's sensors, in one line."""

from collections.abc import Mapping, Sequence

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

from tactopose_drake.systems.collectable_system import CollectableSystem
from tactopose_drake.systems.ports import eval_input


class SenseStatus(CollectableSystem):
    """Joins the statuses of the sensors.

    .. pydrake_system::

        name: SenseStatus
        input_ports:
        - <sense>
        output_ports:
        - sense_status

    - <sense>: str, one port for each sensor; "ok" if all is well, possibly with a warning in brackets.
    - sense_status: str, "ok", or the name and status of each sensor whose status differs from "ok"; changes with the
      inputs.
    """

    def __init__(self, senses: Sequence[str]) -> None:
        """Declares one input port for each of the named sensors."""
        super().__init__()
        self._statuses = {name: self.DeclareAbstractInputPort(name, AbstractValue.Make("")) for name in senses}
        self.declare_output("sense_status", "", self._joined, {port.ticket() for port in self._statuses.values()})

    def _joined(self, context: Context) -> str:
        statuses = {name: eval_input(port, context, str) for name, port in self._statuses.items()}
        return "; ".join(f"{name}: {status}" for name, status in statuses.items() if status != "ok") or "ok"


def export_sense_statuses(builder: DiagramBuilder, statuses: Mapping[str, OutputPort]) -> None:
    """Exports each sensor's status as `status_<sense>`, and all of them joined as `sense_status`."""
    joined = builder.AddNamedSystem("sense_status", SenseStatus(tuple(statuses)))
    for sense, port in statuses.items():
        builder.Connect(port, joined.GetInputPort(sense))
        builder.ExportOutput(port, f"status_{sense}")
    builder.ExportOutput(joined.get_output_port(), "sense_status")
