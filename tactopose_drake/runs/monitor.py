"""Live display of a run's measurements and estimates in the terminal."""

from collections.abc import Iterator
from typing import Any, Self

import numpy as np
from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table

from tactopose_drake.core.plain_values import counted
from tactopose_drake.drivers.device import Device
from tactopose_drake.estimation.results import PoseEstimate
from tactopose_drake.runs.stepping import RunView

_RATE_WINDOW = 1.0  # s over which rates are counted
_LINE_PERIOD = 1.0  # s of a run between two lines, without a terminal
_REFRESH = 5.0  # updates of the table per second


class Monitor:
    """Shows a run: a live table on a terminal, or otherwise one line per second.

    It is a context manager, for one run after another; pass `show` as the observer to `run_scenario` and `replay`.
    """

    def __init__(self, console: Console) -> None:
        """Keeps the console."""
        self._console = console
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None

    def __enter__(self) -> Self:
        self._rates = _Rates()
        self._next = self._time = 0.0
        self._said = ""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, view: RunView) -> None:
        """Shows the current state if an update is due."""
        self._rates.count(view)
        time, said = view.context.get_time(), view.status.partition(":")[0]
        # The clock may restart, and it stops during a silence.
        is_time = time >= self._next or time < self._time or said != self._said
        self._time, self._said = time, said
        if not is_time:
            return
        rates = self._rates.of(view)
        if self._live is not None:
            self._next = time + 1.0 / _REFRESH
            self._live.update(monitor_table(view, rates), refresh=True)
        else:
            self._next = time + _LINE_PERIOD
            self._console.print(monitor_line(view, rates), soft_wrap=True, highlight=False)


def monitor_table(view: RunView, rates: dict[str, float]) -> Table:
    """A table of the senses' rates, ages, forces, pressures and statuses, with the estimate.

    Args:
        view: the run.
        rates: sampling rates of the devices, Hz, by sense.
    """
    table = Table(title=_title(view), caption=estimate_line(view), box=box.SIMPLE_HEAD, caption_justify="left")
    table.add_column("sense")
    for heading in ("rate, Hz", "age, ms", "measured"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("status")
    for sense, measured in _senses(view):
        rate = rates.get(sense)
        table.add_row(
            sense,
            "" if rate is None else f"{rate:.0f}",
            _age(view, sense),
            measured,
            str(view.value(f"status_{sense}", "")),
        )
    return table


def monitor_line(view: RunView, rates: dict[str, float]) -> str:
    """The same in one line; of the statuses, only problems are shown."""
    senses = [
        f"{sense} {measured}" + (f" {rates[sense]:.0f} Hz" if sense in rates else "")
        for sense, measured in _senses(view)
    ]
    wrong = wrong_senses(view)
    return "; ".join([_title(view), *senses, *([] if wrong == "ok" else [wrong]), estimate_line(view)])


class _Rates:
    """Measures the sampling rates of devices over a second of their buses' clocks."""

    def __init__(self) -> None:
        self._counts: dict[str, list[tuple[float, int]]] = {}

    def count(self, view: RunView) -> None:
        for sense, device in _devices(view):
            counts = self._counts.setdefault(sense, [])
            now = device.bus.clock.time()
            counts.append((now, device.samples))
            while len(counts) > 2 and counts[1][0] <= now - _RATE_WINDOW:
                counts.pop(0)

    def of(self, view: RunView) -> dict[str, float]:
        """Sampling rates, Hz, by sense; a sense is missing until it has two counts."""
        rates = {}
        for sense, counts in self._counts.items():
            (first, before), (last, now) = counts[0], counts[-1]
            if last > first:
                rates[sense] = (now - before) / (last - first)
        return rates


def _devices(view: RunView) -> Iterator[tuple[str, Device[Any]]]:
    if view.devices is not None:
        yield from view.devices.boards.items()
        if view.devices.hand is not None:
            yield "hand", view.devices.hand


def _senses(view: RunView) -> Iterator[tuple[str, str]]:
    """Each sense and its measurement as text."""
    names = [view.diagram.get_output_port(index).get_name() for index in range(view.diagram.num_output_ports())]
    for name in names:
        if name.startswith("wrench_"):
            force = float(np.linalg.norm(view.value(name)[3:]))
            yield name.removeprefix("wrench_"), "no force" if np.isnan(force) else f"{force:.2f} N"
    pads = [name for name in names if name.startswith("pressures_")]
    if pads:
        pressures = {name.removeprefix("pressures_"): view.value(name) for name in pads}
        yield "hand", ", ".join(f"{pad} {_peak(cells)}" for pad, cells in pressures.items())


def _peak(pressures: Any) -> str:
    return "?" if np.isnan(pressures).all() else f"{np.nanmax(pressures) / 1e3:.0f} kPa"


def _age(view: RunView, sense: str) -> str:
    age = view.value(f"age_{sense}")
    return "" if age is None or not np.isfinite(age[0]) else f"{1e3 * age[0]:.0f}"


def _title(view: RunView) -> str:
    return f"{view.time:.2f} s"


def wrong_senses(view: RunView) -> str:
    """Each sense without readings, and why; "ok" if all have readings."""
    return str(view.value("sense_status", "ok"))


def estimate_line(view: RunView) -> str:
    """Status and pose as text; with tracking, those of the belief over time."""
    status, estimate = view.status or view.believed("status"), explained_estimate(view)
    if estimate is None:
        return str(status)
    position = " ".join(f"{1e3 * x:z.1f}" for x in view.believed("object_pose").translation())
    many = counted(len(estimate.hypotheses), "hypothesis", "hypotheses")
    return f"{status}; object at {position} mm; {many}, the best with {estimate.best.probability:.0%}"


def explained_estimate(view: RunView) -> PoseEstimate | None:
    """The last estimate; None before the first, and if no pose explains the touch or the belief is lost."""
    estimate: PoseEstimate | None = view.believed("hypotheses")
    is_none = estimate is None or estimate.status == "no_solution" or view.status.startswith("lost")
    return None if is_none else estimate
