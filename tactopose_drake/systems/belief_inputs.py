"""The input ports of a belief, read at one time and checked for implausible values."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, InputPort, LeafSystem

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.evidence.hand_geometry import HandGeometry
from tactopose_drake.core.evidence.plane_contact import PlaneContact
from tactopose_drake.core.poses import log_so3
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.tracking.frame import FASTEST, Frame, PoseMeasurement
from tactopose_drake.core.validation import FloatArray, kind_name, number_array
from tactopose_drake.errors import PortTypeError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.shape_errors import with_shape_errors
from tactopose_drake.systems.collectable_system import SharedState
from tactopose_drake.systems.collision_input import CollisionInput
from tactopose_drake.systems.ports import check_names, eval_items, eval_optional_input, eval_touch_remarks, port_name

# The noise of a live sensor changes its reading within this time, s; a reading that stays the same longer is frozen.
_FROZEN = 0.5
_PAUSE = 1.5  # s without a reading, longer than any period, after which an equal reading does not count as frozen
# Velocities that no carried hand reaches, m/s and rad/s, and the shortest time over which they are measured, s. A palm
# that exceeds them has not moved: its frame or the world frame has jumped.
_FASTEST_PALM, _FASTEST_TURN, _SHORTEST = 10.0, 30.0, 0.02
_ROUNDING = 1e-12  # relative rounding error in the norm of a force that is rotated with its fingertip


def pad_source(pad: str) -> str:
    """The name of a pad among the sources of contacts, distinct from that of a finger with the same name."""
    return f"pad {pad}"


class PalmPlace(NamedTuple):
    """A palm pose X_WP, shape (3, 4), the time at which it was first read, and how long after the previous one, s."""

    X_WP: FloatArray
    since: float
    after: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Remembered(SharedState):
    """Earlier readings that carry no time of their own, with the times from which they hold, s.

    Attributes:
        seen: the last `PosePrior` from vision; None before the first.
        prior: the last one that was new, as a measurement with the time at which it was read.
        time: time of the last reading, s.
        palm: the palm's pose at that reading; None if it was unknown.
        felt: what each finger or pad read, by its name, and since when, s: the norm of its force, shape (1,), N, or a
            pad's pressures, Pa, which do not change when the joints move; without a force its point, shape (3,), m.
    """

    seen: PosePrior | None = None
    prior: PoseMeasurement | None = None
    time: float = -math.inf
    palm: PalmPlace | None = None
    felt: Mapping[str, tuple[FloatArray, float]] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, eq=False)
class Reading:
    """All inputs at one time, and remarks on what is wrong with them."""

    frame: Frame
    remarks: tuple[str, ...]


class BeliefInputs:
    """The input ports of a system that keeps a belief; `PoseBeliefEstimator` documents them."""

    def __init__(self, system: LeafSystem, model: ObjectModel, clearance: CollisionInput | None) -> None:
        """Declares the ports; keeps references to the object's model, whose shape errors count, and to `clearance`."""
        self._model, self._clearance = model, clearance
        _ = model.unevenness, model.growth  # Computed now, so that the first touch need not wait for them.

        def declare(name: str, model: Any) -> Any:
            return system.DeclareAbstractInputPort(name, AbstractValue.Make(model))

        self._contacts = declare("contacts", Contacts.empty())
        self._fingers = declare("fingers_in_contact", ())
        self._patches = declare("patches", ())
        self._pads = declare("pads", ())
        self._statuses = [declare(name, "") for name in ("contact_status", "patch_status")]
        self._prior = declare("prior", None)
        self._vision = declare("vision", None)
        self._hand = declare("hand", None)
        self._untouched = declare("untouched", None)
        self._planes = declare("planes", ())
        self._tips = declare("tip_velocities", None)
        self.palm = declare("palm_pose", RigidTransform())

    def read(self, context: Context, before: Remembered) -> tuple[Reading, Remembered]:
        """All inputs at the context's time, and what the next reading needs of them.

        Raises:
            PortTypeError: if an input holds a wrong type, or neither contacts nor patches are connected.
        """
        now = context.get_time()
        if before.time > now:
            before = Remembered()
        contacts, patches, sources = self._read_touch(context)
        untouched = eval_optional_input(self._untouched, context, HandGeometry)
        evidence = Evidence(
            with_shape_errors(self._model, contacts),
            prior=self._read_prior(context),
            hand=eval_optional_input(self._hand, context, HandGeometry),
            untouched=untouched,
            patches=patches,
            planes=eval_items(self._planes, context, PlaneContact),
        )
        remarks: list[str] = []
        last_felt = before.felt if now <= before.time + _PAUSE else {}
        felt = _felt_since(last_felt, dict(zip(sources, _readings(evidence), strict=True)), now)
        before = dataclasses.replace(before, felt=felt)
        if frozen := {name: time for name, (_, time) in felt.items() if now > time + _FROZEN}:
            of = "" if len(frozen) == len(felt) else f" of {', '.join(frozen)}"
            remarks.append(f"the touch{of} has been the same for {now - max(frozen.values()):.1f} s")
        vision, before = self._read_vision(context, before)
        velocities = self._read_velocities(context, remarks)
        X_WP, before = self._read_palm(context, before, remarks)
        if not sources and not patches and untouched is None and self._untouched.HasValue(context):
            # No sensor reports the absence of a touch, so the object is not known to have left the hand.
            X_WP = None
        remarks += eval_touch_remarks(self._statuses, context)
        check = None if self._clearance is None else self._clearance.posed(context)
        depth = None if check is None else check.depth
        reading = Reading(Frame(now, evidence, sources, velocities, vision, X_WP, depth), tuple(remarks))
        return reading, dataclasses.replace(before, time=now)

    def _read_touch(self, context: Context) -> tuple[Contacts, tuple[Patch, ...], tuple[str, ...]]:
        """Contacts, patches, and the names of the fingers and pads that touch."""
        if not (self._contacts.HasValue(context) or self._patches.HasValue(context)):
            raise PortTypeError(f"{port_name(self._contacts)} must hold a Contacts, but is not connected.")
        contacts = eval_optional_input(self._contacts, context, Contacts) or Contacts.empty()
        patches = eval_items(self._patches, context, Patch)
        fingers = self._read_names(self._fingers, context, [f"contact {i}" for i in range(len(contacts))])
        pads = self._read_names(self._pads, context, [str(i) for i in range(len(patches))])
        felt = tuple(pad_source(pad) for pad, patch in zip(pads, patches, strict=True) if patch.is_felt)
        return contacts, patches, (*fingers, *felt)

    def _read_names(self, port: InputPort, context: Context, rows: list[str]) -> tuple[str, ...]:
        """The names that a port gives to the contacts or patches; the rows' own if it is not connected."""
        names = eval_optional_input(port, context, tuple)
        if names is None:
            return tuple(rows)
        check_names(port, names, len(rows), "contacts" if port is self._fingers else "patches")
        return names

    def _read_vision(self, context: Context, before: Remembered) -> tuple[PoseMeasurement | None, Remembered]:
        seen = eval_optional_input(self._vision, context, object)
        if seen is None or isinstance(seen, PoseMeasurement):
            return seen, before
        if not isinstance(seen, PosePrior):
            raise PortTypeError(
                f"{port_name(self._vision)} must hold a PoseMeasurement, a PosePrior or None, not "
                f"{kind_name(type(seen))}."
            )
        now = context.get_time()
        if seen is not before.seen:
            measured = PoseMeasurement.from_prior(seen, now)
            is_news = before.prior is None or measured.is_news_after(before.prior)
            before = dataclasses.replace(before, seen=seen, prior=measured if is_news else before.prior)
        # A prior that does not change is neither a new measurement nor a late one.
        return (before.prior if before.prior is not None and now < before.prior.time + _FROZEN else None), before

    def _read_prior(self, context: Context) -> PosePrior | None:
        """The prior of the pose before it is felt: that of the port `prior`, else a `PosePrior` from vision."""
        prior = eval_optional_input(self._prior, context, PosePrior)
        seen = eval_optional_input(self._vision, context, object)
        return seen if prior is None and isinstance(seen, PosePrior) else prior

    def _read_velocities(self, context: Context, remarks: list[str]) -> dict[str, FloatArray] | None:
        if not self._tips.HasValue(context):
            return None
        told = eval_optional_input(self._tips, context, dict)
        velocities = None if told is None else _six_each(self._tips, told)
        if velocities is None or not all(np.all(np.isfinite(velocity)) for velocity in velocities.values()):
            remarks.append("the fingertips' velocities are not known")
            return None
        if any(np.abs(velocity).max(initial=0.0) > FASTEST for velocity in velocities.values()):
            remarks.append("the fingertips' velocities are beyond all reason")
            return None
        return velocities

    def _read_palm(
        self, context: Context, before: Remembered, remarks: list[str]
    ) -> tuple[FloatArray | None, Remembered]:
        """The palm's pose; None if it is unknown, or differs from the last one by more than a motion allows."""
        palm = eval_optional_input(self.palm, context, RigidTransform)
        if palm is None:
            return None, dataclasses.replace(before, palm=None)
        X_WP: FloatArray = palm.GetAsMatrix34()
        if not np.all(np.isfinite(X_WP)):
            remarks.append("the palm's pose is not finite")
            return None, dataclasses.replace(before, palm=None)
        now, last = context.get_time(), before.palm
        if last is None:
            return X_WP, dataclasses.replace(before, palm=PalmPlace(X_WP, now))
        if np.array_equal(X_WP, last.X_WP):
            return X_WP, before
        # If palm poses arrive less often than beliefs are updated, the motion took the time between two poses.
        after = now - last.since
        jump = _jump(last.X_WP, X_WP, max(now - before.time, min(after, last.after)))
        before = dataclasses.replace(before, palm=PalmPlace(X_WP, now, after))
        if jump:
            remarks.append(f"the palm's pose has jumped by {jump}")
            return None, before
        return X_WP, before


def _six_each(port: InputPort, velocities: Mapping[str, Any]) -> dict[str, FloatArray]:
    """The velocities that a port holds by finger, with a check that each has six numbers."""
    where = port_name(port)
    return {tip: number_array(f"velocity of {tip!r} in {where}", value, (6,)) for tip, value in velocities.items()}


def _jump(X_before: FloatArray, X: FloatArray, duration: float) -> str:
    """How far a palm has moved, as text, if no motion within the duration in s can explain it; else empty."""
    moved = float(np.linalg.norm(X[:, 3] - X_before[:, 3]))
    turned = float(np.linalg.norm(log_so3(X_before[:, :3].T @ X[:, :3])))
    duration = max(duration, _SHORTEST)
    if moved <= _FASTEST_PALM * duration and turned <= _FASTEST_TURN * duration:
        return ""
    return f"{moved:.2f} m and {math.degrees(turned):.0f} degrees"


def _readings(evidence: Evidence) -> list[FloatArray]:
    """For each source of the touch a quantity that changes with every sensor reading, as in `Remembered.felt`."""
    contacts = evidence.contacts
    of_contacts = contacts.p_PC if contacts.f_PC is None else np.linalg.norm(contacts.f_PC, axis=1, keepdims=True)
    return [*of_contacts, *(patch.pressure[~patch.dead] for patch in evidence.felt)]


def _felt_since(
    before: Mapping[str, tuple[FloatArray, float]], readings: Mapping[str, FloatArray], now: float
) -> dict[str, tuple[FloatArray, float]]:
    """Each source's reading and the time since which it has not changed at all, s."""
    since = {}
    for name, reading in readings.items():
        last, time = before.get(name, (reading, now))
        since[name] = (reading, time if _is_same(reading.tolist(), last.tolist()) else now)
    return since


def _is_same(reading: list[float], last: list[float]) -> bool:
    """Whether two readings are equal up to rounding; plain Python, as NumPy is slower for so few numbers."""
    pairs = zip(reading, last, strict=False)
    return len(reading) == len(last) and all(abs(a - b) <= _ROUNDING * abs(b) for a, b in pairs)
