"""What a belief is told at one time: its input ports, read with a doubt about each."""

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
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.errors import PortTypeError
from tactopose_drake.estimation.prior import PosePrior
from tactopose_drake.estimation.shape_errors import with_shape_errors
from tactopose_drake.systems.collision_input import CollisionInput
from tactopose_drake.systems.ports import eval_items, eval_optional_input, port_name

# Noise moves a reading that is alive within less than this, s.
_FROZEN = 0.5
_PAUSE = 1.5  # s without a reading, longer than any period: that the next is the same says nothing of the meantime
# No hand is carried as fast, m/s and rad/s, over so many seconds or more: of a palm that is, its frame or the world's
# has jumped.
_FASTEST_PALM, _FASTEST_TURN, _SHORTEST = 10.0, 30.0, 0.02
_ROUNDING = 1e-12  # by which the size of a force differs, relatively, that is turned with its fingertip


def pad_source(pad: str) -> str:
    """What a pad is called among the sources of contacts, where a finger may have its name."""
    return f"pad {pad}"


class PalmPlace(NamedTuple):
    """Where the palm is said to be: X_WP, shape (3, 4), since when, and how long after the place before, s."""

    X_WP: FloatArray
    since: float
    after: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Remembered:
    """What was read before and tells no time of its own, and since when it is so, s.

    Attributes:
        seen: the prior that vision said last; None before the first.
        prior: that which was news, as a measurement of then.
        time: of the last reading, s.
        palm: where the palm was said to be at that reading; None where that was not known.
        felt: what each finger or pad felt, and since when, s, by its name: the size of a force, shape (1,), N, which no
            motion of the joints changes, or where there is none the point, shape (3,), m.
    """

    seen: PosePrior | None = None
    prior: PoseMeasurement | None = None
    time: float = -math.inf
    palm: PalmPlace | None = None
    felt: Mapping[str, tuple[FloatArray, float]] = dataclasses.field(default_factory=dict)

    def __deepcopy__(self, memo: Any) -> Remembered:
        return self


@dataclasses.dataclass(frozen=True, eq=False)
class Reading:
    """All inputs at one time, and what is wrong with them."""

    frame: Frame
    remarks: tuple[str, ...]


class BeliefInputs:
    """The input ports of a system that keeps a belief; `PoseBeliefEstimator` says what they hold."""

    def __init__(self, system: LeafSystem, model: ObjectModel, clearance: CollisionInput | None) -> None:
        """Declares the ports; keeps references to the object's model, whose surface may be off, and to `clearance`."""
        self._model, self._clearance = model, clearance
        _ = model.unevenness, model.growth  # The first touch would wait for them.

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
        """All that the inputs say now, and what is to be remembered of it.

        Raises:
            PortTypeError: if an input holds what it cannot, or neither contacts nor patches are connected.
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
            # No sensor says that nothing is touched: the object is not known to have left the hand.
            X_WP = None
        for port in self._statuses:
            status = eval_optional_input(port, context, str)
            remarks += [] if status in (None, "ok") else [status]
        check = None if self._clearance is None else self._clearance.posed(context)
        depth = None if check is None else check.depth
        reading = Reading(Frame(now, evidence, sources, velocities, vision, X_WP, depth), tuple(remarks))
        return reading, dataclasses.replace(before, time=now)

    def _read_touch(self, context: Context) -> tuple[Contacts, tuple[Patch, ...], tuple[str, ...]]:
        """Contacts, patches, and the names of what touches."""
        if not (self._contacts.HasValue(context) or self._patches.HasValue(context)):
            raise PortTypeError(f"{port_name(self._contacts)}: is not connected; it needs a Contacts.")
        contacts = eval_optional_input(self._contacts, context, Contacts) or Contacts.empty()
        patches = eval_items(self._patches, context, Patch)
        fingers = self._read_names(self._fingers, context, [f"contact {i}" for i in range(len(contacts))])
        pads = self._read_names(self._pads, context, [str(i) for i in range(len(patches))])
        felt = tuple(pad_source(pad) for pad, patch in zip(pads, patches, strict=True) if patch.is_felt)
        return contacts, patches, (*fingers, *felt)

    def _read_names(self, port: InputPort, context: Context, rows: list[str]) -> tuple[str, ...]:
        """The names that a port gives what touches, or where it is not connected the rows' own."""
        names = eval_optional_input(port, context, tuple)
        if names is None:
            return tuple(rows)
        if not all(isinstance(name, str) for name in names) or len(names) != len(rows) or len({*names}) != len(rows):
            touches = "contacts" if port is self._fingers else "patches"
            raise PortTypeError(
                f"{port_name(port)}: holds {names!r}; allowed are as many different names as there are {touches}, "
                f"{len(rows)}."
            )
        return names

    def _read_vision(self, context: Context, before: Remembered) -> tuple[PoseMeasurement | None, Remembered]:
        seen = eval_optional_input(self._vision, context, object)
        if seen is None or isinstance(seen, PoseMeasurement):
            return seen, before
        if not isinstance(seen, PosePrior):
            raise PortTypeError(
                f"{port_name(self._vision)}: holds a {type(seen).__name__}; allowed are PoseMeasurement, PosePrior "
                "and None."
            )
        now = context.get_time()
        if seen is not before.seen:
            measured = PoseMeasurement.from_prior(seen, now)
            is_news = before.prior is None or measured.is_news_after(before.prior)
            before = dataclasses.replace(before, seen=seen, prior=measured if is_news else before.prior)
        # One that stays as it is is no new measurement, nor a late one.
        return (before.prior if before.prior is not None and now < before.prior.time + _FROZEN else None), before

    def _read_prior(self, context: Context) -> PosePrior | None:
        """What is known of the pose before it is felt: the prior, or vision where that gives such a one."""
        prior = eval_optional_input(self._prior, context, PosePrior)
        seen = eval_optional_input(self._vision, context, object)
        return seen if prior is None and isinstance(seen, PosePrior) else prior

    def _read_velocities(self, context: Context, remarks: list[str]) -> dict[str, FloatArray] | None:
        if not self._tips.HasValue(context):
            return None
        velocities = eval_optional_input(self._tips, context, dict)
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
        """The palm's pose, where it is known and has come there by a motion."""
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
        # A pose that is told less often than beliefs are made has moved for as long as between two of them.
        after = now - last.since
        jump = _jump(last.X_WP, X_WP, max(now - before.time, min(after, last.after)))
        before = dataclasses.replace(before, palm=PalmPlace(X_WP, now, after))
        if jump:
            remarks.append(f"the palm's pose has jumped by {jump}")
            return None, before
        return X_WP, before


def _jump(X_before: FloatArray, X: FloatArray, duration: float) -> str:
    """By how much a palm is elsewhere than any motion of so many seconds leads; empty where one may."""
    moved = float(np.linalg.norm(X[:, 3] - X_before[:, 3]))
    turned = float(np.linalg.norm(log_so3(X_before[:, :3].T @ X[:, :3])))
    duration = max(duration, _SHORTEST)
    if moved <= _FASTEST_PALM * duration and turned <= _FASTEST_TURN * duration:
        return ""
    return f"{moved:.2f} m and {math.degrees(turned):.0f} degrees"


def _readings(evidence: Evidence) -> list[FloatArray]:
    """What each source of the touch reads that changes whenever its sensor does, as `Remembered` keeps it."""
    points, forces = list(evidence.touch.p_PC), evidence.contacts.f_PC
    if forces is not None:
        points[: len(forces)] = list(np.linalg.norm(forces, axis=1, keepdims=True))
    return points


def _felt_since(
    before: Mapping[str, tuple[FloatArray, float]], readings: Mapping[str, FloatArray], now: float
) -> dict[str, tuple[FloatArray, float]]:
    """Each source's reading and since when it is so: since before where it has not changed at all, or else now."""
    since = {}
    for name, reading in readings.items():
        last, time = before.get(name, (reading, now))
        since[name] = (reading, time if _is_same(reading.tolist(), last.tolist()) else now)
    return since


def _is_same(reading: list[float], last: list[float]) -> bool:
    """Whether two readings are the same but for rounding; of few numbers, NumPy's calls take long."""
    pairs = zip(reading, last, strict=False)
    return len(reading) == len(last) and all(abs(a - b) <= _ROUNDING * abs(b) for a, b in pairs)
