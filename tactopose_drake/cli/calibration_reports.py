"""Rows and sentences on a calibration, for the terminal and the page."""

from collections.abc import Collection

from tactopose_drake.hand.calibration_file import HandCalibration
from tactopose_drake.hand.hand_calibration import CalibrationResult

HEADINGS = ("off by", "found", "standard deviation", "unit")
"""Headings of the rows."""


def calibration_rows(found: HandCalibration, sliding: Collection[str]) -> list[tuple[str, str, str, str]]:
    """One row for each estimated error, or for three of the same kind.

    Args:
        found: the calibration.
        sliding: names of the prismatic joints.
    """
    rows = []
    for joint, offset in found.joint_offsets.items():
        scale, unit = (1e3, "mm") if joint in sliding else (1.0, "deg")
        if offset.sigma:
            rows.append((f"{joint} offset", f"{scale * offset.value:z.2f}", f"{scale * offset.sigma:.2f}", unit))
    for name, finger in found.fingers.items():
        for what, vector, scale, unit in (
            ("moment bias", finger.moment_bias, 1e3, "N mm"),
            ("force bias", finger.force_bias, 1.0, "N"),
            ("mounting rotation", finger.rotation_deg, 1.0, "deg"),
            ("mounting translation", finger.translation, 1e3, "mm"),
        ):
            values, sigmas = ([f"{scale * x:z.2f}" for x in row] for row in (vector.value, vector.sigma))
            if any(vector.sigma):
                rows.append((f"{name} {what}", " ".join(values), " ".join(sigmas), unit))
        value, sigma = 1e3 * finger.radius.value, 1e3 * finger.radius.sigma
        if sigma:
            rows.append((f"{name} radius", f"{value:.2f}", f"{sigma:.2f}", "mm"))
    return rows


def remaining_line(result: CalibrationResult) -> str:
    """A sentence on the remaining error of a contact of the calibrated hand."""
    noise = result.calibration.noise
    return (
        f"Remaining error of a contact: {1e3 * noise.position:.2f} mm along its normal, {noise.normal_deg:.1f} deg of "
        "the normal."
    )
