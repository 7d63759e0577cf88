"""The numbers of tables, by their units and their rows."""

import re
from pathlib import Path

import numpy as np
from rich.table import Table

from tactopose_drake.cli.calibration_page import save_calibration_page
from tactopose_drake.cli.calibration_reports import calibration_rows
from tactopose_drake.cli.demo_reports import FingerReport, PadReport, PoseReport
from tactopose_drake.cli.estimate_tables import fingers_table, pads_table, poses_table
from tactopose_drake.hand.calibration_file import FingerCalibration, HandCalibration, MeasuredNumber, MeasuredVector
from tactopose_drake.hand.hand_calibration import CalibrationResult, FingerResiduals


def cells(table: Table) -> list[list[str]]:
    """Row by row."""
    columns = [list(column.cells) for column in table.columns]
    return [[str(cell) for cell in row] for row in zip(*columns, strict=True)]


def test_what_a_calibration_found_is_told_in_the_unit_beside_it() -> None:
    thumb = FingerCalibration(
        moment_bias=MeasuredVector(value=[0.001, -0.002, 0.0], sigma=[0.0005] * 3),
        force_bias=MeasuredVector(value=[0.1, 0.2, -0.3], sigma=[0.01] * 3),
        radius=MeasuredNumber(value=0.0004, sigma=0.0001),
        rotation_deg=MeasuredVector(value=[1.0, -2.0, 3.0], sigma=[0.25] * 3),
        translation=MeasuredVector(value=[0.0003, 0.0, -0.0011], sigma=[0.00005] * 3),
    )
    offsets = {"turns": MeasuredNumber(value=1.5, sigma=0.1), "slides": MeasuredNumber(value=0.002, sigma=0.0004)}
    rows = calibration_rows(HandCalibration(grasps=4, joint_offsets=offsets, fingers={"thumb": thumb}), ["slides"])
    assert rows == [
        ("turns offset", "1.50", "0.10", "deg"),
        ("slides offset", "2.00", "0.40", "mm"),
        ("thumb moment bias", "1.00 -2.00 0.00", "0.50 0.50 0.50", "N mm"),
        ("thumb force bias", "0.10 0.20 -0.30", "0.01 0.01 0.01", "N"),
        ("thumb mounting rotation", "1.00 -2.00 3.00", "0.25 0.25 0.25", "deg"),
        ("thumb mounting translation", "0.30 0.00 -1.10", "0.05 0.05 0.05", "mm"),
        ("thumb radius", "0.40", "0.10", "mm"),
    ]


def test_the_page_of_a_calibration_has_millimetres_and_degrees(tmp_path: Path) -> None:
    before = {"thumb": FingerResiduals(np.array([0.003, -0.001]), np.radians([40.0, 30.0]))}
    after = {"thumb": FingerResiduals(np.array([0.0005, np.nan]), np.radians([2.0, np.nan]))}
    result = CalibrationResult(
        HandCalibration(grasps=2),
        names=(),
        values=np.zeros(0),
        covariance=np.zeros((0, 0)),
        undetermined=(),
        X_PO=np.tile(np.eye(3, 4), (2, 1, 1)),
        pose_probability=np.ones(2),
        grasp_weights=np.ones(2),
        contact_weights={"thumb": np.ones(2)},
        without_contact={},
        before=before,
        after=after,
        converged=True,
        sliding=(),
    )
    save_calibration_page(tmp_path / "page.html", "my.hand.yaml", result, ["a", "b\udcfc"])  # No UTF-8.
    text = (tmp_path / "page.html").read_text()
    assert r"<td>b\udcfc</td>" in text
    assert "<td>thumb</td><td>2.24</td><td>35.4</td><td>0.50</td><td>2.0</td>" in text
    of_distance, of_angle = re.findall(r"<h2>(?:Distance|Angle).*?</svg>", text)
    assert re.findall(r'text-anchor="middle">([^<]*)<', of_distance) == ["-1", "0", "3"]
    assert re.findall(r'text-anchor="middle">([^<]*)<', of_angle) == ["0", "40"]


def test_a_demonstrations_tables_have_each_number_in_its_row_and_unit() -> None:
    angles = np.radians([2.0, 4.0, 6.0, 8.0])
    pose = PoseReport("touch", 0.001, angles[0], 0.003, angles[1], 0.005, angles[2], 0.007, angles[3])
    rows = {row[0]: row[1] for row in cells(poses_table([pose]))}
    assert rows == {
        "position, mm": "1.00",
        "angle, deg": "2.00",
        "position where determined, mm": "3.00",
        "angle where determined, deg": "4.00",
        "contacts to surface (MDTS), mm": "5.00",
        "normals to surface (MATN), deg": "6.00",
        "touched points (RME), mm": "7.00",
        "touched normals (MAE), deg": "8.00",
    }
    fingers = cells(
        fingers_table([FingerReport("thumb", 1.25, 0.0015, angles[0]), FingerReport("ring", 2.5, None, None)])
    )
    assert fingers == [["thumb", "1.25", "1.50", "2.00"], ["ring", "2.50", "no contact there", ""]]
    pads = cells(pads_table([PadReport("palm", "area", 5, 1.5, 2.5, 0.0005, angles[1])]))
    assert pads == [["palm", "area", "5", "1.50", "2.50", "0.50", "4.00"]]
