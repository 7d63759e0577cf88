"""Which joints follow others by a model's own account."""

from pathlib import Path

import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant

from tactopose_drake.hand.mimics import Mimic, read_mimics

SDF = """<sdf version="1.11"><model name="m">
  <joint name="first" type="revolute"/>
  <joint name="second" type="revolute"><axis><mimic joint="first">
    <multiplier>2</multiplier><offset>0.1</offset><reference>0.3</reference>
  </mimic></axis></joint>
</model></sdf>"""
DRAKE_SDF = """<sdf version="1.11" xmlns:drake="https://drake.mit.edu"><model name="m">
  <joint name="first" type="revolute"/>
  <joint name="second" type="revolute"><drake:mimic joint="first" multiplier="2"/></joint>
</model></sdf>"""
URDF = """<robot name="m"><joint name="first" type="revolute"/>
  <joint name="second" type="revolute"><mimic joint="first" multiplier="-0.5" offset="0.2"/></joint>
  <joint name="third" type="revolute"><mimic joint="second"/></joint>
</robot>"""

DRAKE_ON_SDF = SDF.replace("<sdf ", '<sdf xmlns:drake="https://drake.mit.edu" ').replace(
    "</model>", '<joint name="third" type="revolute"><drake:mimic joint="second" multiplier="3"/></joint></model>'
)
SDF_ON_DRAKE = DRAKE_SDF.replace(
    "</model>", '<joint name="third" type="revolute"><axis><mimic joint="second"/></axis></joint></model>'
)
LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><axis xyz="0 0 1"/>{}</joint>'


@pytest.mark.parametrize(
    ("text", "mimics"),
    [
        # SDFormat: multiplier (q_first - reference) + offset. Drake ignores its entries.
        (SDF, (Mimic("second", "first", 2.0, pytest.approx(0.1 - 2.0 * 0.3), is_obeyed=False),)),
        # Where an entry says no more than whom to follow: one to one.
        ('<sdf><joint name="b"><axis><mimic joint="a"/></axis></joint></sdf>', (Mimic("b", "a", 1.0, 0.0, False),)),
        # What follows a joint that Drake leaves free is as free, and so is what Drake itself leaves free.
        (
            DRAKE_ON_SDF,
            (
                Mimic("second", "first", 2.0, pytest.approx(-0.5), is_obeyed=False),
                Mimic("third", "first", 6.0, pytest.approx(-1.5), is_obeyed=False),
            ),
        ),
        (DRAKE_SDF, (Mimic("second", "first", 2.0, 0.0),)),
        (
            SDF_ON_DRAKE,
            (Mimic("second", "first", 2.0, 0.0), Mimic("third", "first", 2.0, 0.0, is_obeyed=False)),
        ),
        (URDF, (Mimic("second", "first", -0.5, 0.2), Mimic("third", "first", -0.5, 0.2))),
        ("<mujoco/>", None),
    ],
    ids=["sdf", "bare_sdf", "drake_on_sdf", "drake_sdf", "sdf_on_drake", "urdf", "other"],
)
def test_what_follows_is_read_as_the_format_means_it(
    tmp_path: Path, text: str, mimics: tuple[Mimic, ...] | None
) -> None:
    path = tmp_path / "model"
    path.write_text(text)
    assert read_mimics(path) == mimics


@pytest.mark.parametrize(
    "entry",
    ['<mimic joint="first"/>', '<drake:mimic joint="first"/>', '<drake:axis><mimic joint="first"/></drake:axis>'],
)
def test_of_a_urdf_drake_obeys_what_is_said_to_be_obeyed(tmp_path: Path, entry: str) -> None:
    parts = [*map(LINK.format, "abc"), JOINT.format("first", "a", "b", ""), JOINT.format("second", "b", "c", entry)]
    path = tmp_path / "model.urdf"
    path.write_text(f'<robot name="m" xmlns:drake="https://drake.mit.edu">{"".join(parts)}</robot>')
    plant = MultibodyPlant(0.001)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    Parser(plant).AddModels(str(path))
    (mimic,) = read_mimics(path)
    assert mimic.is_obeyed == (plant.num_constraints() == 1)
