"""Descriptions of estimates in words: status, free directions, standard deviations, and false contacts."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactopose_drake.core.posterior.modes import determined_part, determined_rows
from tactopose_drake.core.posterior.posterior_params import DEFAULT_PARAMS
from tactopose_drake.core.sensing.patches import Patch
from tactopose_drake.core.validation import FloatArray
from tactopose_drake.estimation.pose_hypothesis import PoseHypothesis
from tactopose_drake.estimation.results import PoseEstimate

# Least determined part of a direction for which a standard deviation of rotation or translation is given.
_LEAST_DETERMINED = 0.5
_ANSWER_SHARE = DEFAULT_PARAMS.modes.answer_share
_MEANINGS = {
    "ok": "the most probable pose carries most of the probability",
    "ambiguous": "several poses explain the touch; none carries most of the probability",
    "unsure": "one pose carries most of the probability, but is not certain",
    "undetermined": "the touch does not determine a pose; whole families of poses explain it",
    "no_solution": "no pose explains the touch within its noise; the best one found is shown",
}


def meaning(estimate: PoseEstimate) -> str:
    """The meaning of the status, and whether the time limit ended the search."""
    key: str = estimate.status
    if estimate.status == "ambiguous" and estimate.undetermined:
        key = "undetermined"
    elif estimate.status == "ambiguous" and estimate.best.probability * estimate.kept_share >= _ANSWER_SHARE:
        key = "unsure"
    said = _MEANINGS[key]
    return said if estimate.finished else f"{said}; the time limit ended the search, which may have missed others"


def status_line(estimate: PoseEstimate) -> str:
    """The status and what it means, in a sentence."""
    return f"{estimate.status}: {meaning(estimate)} ({1e3 * estimate.duration:.1f} ms)"


def touch_names(contacts: int, patches: Sequence[Patch]) -> tuple[str, ...]:
    """Names of contacts (empty strings) and of the felt patches after them; no names at all if no patch is felt."""
    felt = [f"patch {number}" for number, patch in enumerate(patches, 1) if patch.is_felt]
    return (*[""] * contacts, *felt) if felt else ()


def false_contacts_line(is_false: NDArray[np.bool_], names: Sequence[str] = ()) -> str:
    """A sentence that lists the contacts that are probably not on the object; empty if there are none.

    Args:
        is_false: which contacts these are, shape (k,); the sentence counts from 1.
        names: names of the fingers and pads that feel the contacts, "" where unknown; empty if all are unknown.
    """
    rows = np.flatnonzero(is_false).tolist()
    numbers = [f"{row + 1} ({names[row]})" if names and names[row] else str(row + 1) for row in rows]
    if not numbers:
        return ""
    which = f"contact {numbers[0]}" if len(numbers) == 1 else f"contacts {', '.join(numbers[:-1])} and {numbers[-1]}"
    return f"Probably not of this object: {which}."


def free_line(hypothesis: PoseHypothesis) -> str:
    """A sentence that lists the directions of a hypothesis that the touch does not determine."""
    names = direction_names(hypothesis)
    return "Not determined by the touch: " + ("; ".join(names) if names else "nothing") + "."


def sigma_line(hypothesis: PoseHypothesis, size: float) -> str:
    """A sentence with a hypothesis' standard deviations in its determined directions; empty if there are none.

    `size` is the object's, m.
    """
    rotation, translation = determined_sigmas(hypothesis, size)
    known = [(1e3 * translation, "mm"), (math.degrees(rotation), "deg")]
    sigmas = ", ".join(f"\u00b1 {value:.1f} {unit}" for value, unit in known if not math.isnan(value))
    return f"Where determined, by its own account: {sigmas}." if sigmas else ""


def sigma_cells(hypothesis: PoseHypothesis, size: float) -> tuple[str, str]:
    """Table cells of the standard deviations of translation (mm) and rotation (deg) where determined, or a dash."""
    rotation, translation = determined_sigmas(hypothesis, size)
    millimetres, degrees = (
        "\u2013" if math.isnan(value) else f"{value:.1f}" for value in (1e3 * translation, math.degrees(rotation))
    )
    return millimetres, degrees


def determined_sigmas(hypothesis: PoseHypothesis, size: float) -> tuple[float, float]:
    """Standard deviations of rotation (rad) and translation (m), over all determined directions together.

    NaN for a part of which the touch determines little or nothing. `size` is the object's, m.
    """
    free = hypothesis.free_directions
    determined, share = determined_rows(hypothesis.covariance, free, size), determined_part(np.eye(6), free, size)
    parts = slice(0, 3), slice(3, 6)
    rotation, translation = (
        float(np.linalg.norm(determined[:, part])) if np.trace(share[part, part]) >= _LEAST_DETERMINED else math.nan
        for part in parts
    )
    return rotation, translation


def direction_names(hypothesis: PoseHypothesis) -> list[str]:
    """The free directions in words: a turn about an axis of the object, a slide along one, or both (a screw)."""
    R_PO = hypothesis.X_PO.rotation().matrix()
    return [direction_name(direction, R_PO) for direction in hypothesis.free_directions]


def direction_name(direction: FloatArray, R_PO: FloatArray) -> str:
    """A pose increment, shape (6,), in words; R_PO is the pose's rotation, shape (3, 3)."""
    w_O, v_O = direction[:3], R_PO.T @ direction[3:]
    turn, slide = np.linalg.norm(w_O), np.linalg.norm(v_O)
    # With rad and m: less than 0.1 rad of turn goes with 10 cm of slide.
    if turn < slide:
        return f"slide along {_axis(v_O)}"
    if slide < 0.2 * turn:
        return f"turn about {_axis(w_O)}"
    return f"turn about {_axis(w_O)} with a slide of {1e3 * slide / turn:.0f} mm/rad along {_axis(v_O)}"


def _axis(vector: FloatArray) -> str:
    """The name of the object's axis that is parallel to a vector; the vector itself if none is."""
    unit = vector / np.linalg.norm(vector)
    main = int(np.argmax(np.abs(unit)))
    if abs(unit[main]) > np.cos(np.radians(10.0)):
        return "the object's " + "xyz"[main]
    unit = np.round(unit * np.sign(unit[main]), 2) + 0.0  # no -0.00
    return "the object's (" + ", ".join(f"{x:.2f}" for x in unit) + ")"
