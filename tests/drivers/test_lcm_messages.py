"""Messages in Python against what lcm-gen makes of `tactopose.lcm`, and what damaged ones are."""

import importlib
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

import tactopose_drake
from tactopose_drake.drivers.lcm_messages import HandSensesMessage, ObjectBeliefMessage, ObjectPoseMessage
from tactopose_drake.errors import InvalidInputError, ProtocolError

TYPES = Path(tactopose_drake.__file__).parent / "drivers" / "tactopose.lcm"
LCM_GEN = shutil.which("lcm-gen", path=Path(sys.executable).parent)


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The types as lcm-gen makes them."""
    if LCM_GEN is None:
        pytest.skip("lcm-gen, which comes with the package lcm, is not there")
    folder = tmp_path_factory.mktemp("generated")
    subprocess.run([LCM_GEN, "--python", "--ppath", folder, TYPES], check=True, capture_output=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        return importlib.import_module("tactopose")


def senses() -> HandSensesMessage:
    return HandSensesMessage(
        utime=1_700_000_000_123_456,
        sequence=7,
        joints={"FFJ3": 0.25, "Gelenk ä": np.nan},
        wrenches={"first": np.arange(6.0), "thumb": np.full(6, np.nan)},
        pressures={"palm": np.array([1.0, np.nan, 3.0]), "tip": np.array([4e4])},
    )


def pose() -> ObjectPoseMessage:
    return ObjectPoseMessage(
        utime=-5, position=np.array([0.1, 0.2, 0.3]), quaternion_wxyz=np.eye(4)[2], covariance=np.diag(np.arange(6.0))
    )


def belief() -> ObjectBeliefMessage:
    return ObjectBeliefMessage(
        utime=3,
        sequence=2,
        session=11,
        received=30,
        lost=1,
        passed_over=4,
        status="ok: vision is of 2.0 s ago",
        probability=np.array([0.9, 0.1]),
        position=np.arange(6.0).reshape(2, 3),
        quaternion_wxyz=np.eye(4)[:2],
        covariance=np.arange(72.0).reshape(2, 6, 6),
    )


def plain(value: object) -> object:
    return np.asarray(value).tolist() if isinstance(value, list | tuple | np.ndarray) else value


def test_lcm_gen_reads_what_is_written_here(generated: ModuleType) -> None:
    theirs, ours = generated.lcmt_hand_senses.decode(senses().encode()), senses()
    assert (theirs.utime, theirs.sequence) == (ours.utime, ours.sequence)
    assert theirs.joint_name == list(ours.joints)
    np.testing.assert_array_equal(theirs.joint_position, list(ours.joints.values()))
    assert theirs.finger_name == ["first", "thumb"]
    np.testing.assert_array_equal(theirs.wrench, list(ours.wrenches.values()))
    assert (theirs.pad_name, list(theirs.pad_cells), theirs.num_cells) == (["palm", "tip"], [3, 1], 4)
    np.testing.assert_array_equal(theirs.pressure, [1.0, np.nan, 3.0, 4e4])
    for ours_of_it, kind in ((pose(), "lcmt_object_pose"), (belief(), "lcmt_object_belief")):
        theirs = getattr(generated, kind).decode(ours_of_it.encode())
        for name, value in vars(ours_of_it).items():
            assert plain(getattr(theirs, name)) == plain(value), name


@pytest.mark.parametrize("make", [senses, pose, belief])
def test_what_lcm_gen_writes_is_the_same_to_the_byte(make, generated: ModuleType) -> None:
    data = make().encode()
    kind = {senses: "lcmt_hand_senses", pose: "lcmt_object_pose", belief: "lcmt_object_belief"}[make]
    assert getattr(generated, kind).decode(data).encode() == data
    assert type(make()).decode(data).encode() == data


@pytest.mark.parametrize("make", [senses, pose, belief])
def test_a_message_that_is_cut_off_or_too_long_is_refused(make) -> None:
    data = make().encode()
    for end in range(len(data)):
        with pytest.raises(ProtocolError, match=r"cut off|fingerprint"):
            type(make()).decode(data[:end])
    with pytest.raises(ProtocolError, match=r"must end after .* bytes, not 1 later"):
        type(make()).decode(data + b"\0")


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (
            HandSensesMessage,
            {"wrenches": {"thumb": np.zeros(5)}},
            r"wrenches\[thumb\] must have the shape \(6,\), not \(5,",
        ),
        (HandSensesMessage, {"wrenches": np.zeros(6)}, "wrenches must be a Mapping, not an ndarray"),
        (HandSensesMessage, {"pressures": {"palm": 3.0}}, r"pressures\[palm\] must have the shape \(n,\), not \(\)"),
        (HandSensesMessage, {"joints": {3: 0.1}}, "joints: the name 3 must be a str, not an int"),
        (HandSensesMessage, {"joints": {"FFJ3": "0.1"}}, r"joints\[FFJ3\] must be a number, not"),
        (HandSensesMessage, {"utime": 1.5}, "utime must be an integer .*, not 1.5"),
        (HandSensesMessage, {"sequence": 2**63}, "sequence must be an integer .*, not 9223372036854775808"),
        (ObjectPoseMessage, {"covariance": np.eye(3)}, r"covariance must have the shape \(6, 6\), not \(3, 3\)"),
        (ObjectBeliefMessage, {"status": None}, "status must be a str, not None"),
        (ObjectBeliefMessage, {"probability": [1.0]}, r"position must have the shape \(1, 3\), not \(0, 3\)"),
    ],
)
def test_what_no_message_can_hold_is_refused_when_it_is_made(kind: type, values: dict, message: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{kind.__name__}\.{message}"):
        kind(**values)


def test_another_type_is_refused() -> None:
    with pytest.raises(ProtocolError, match="must be a lcmt_object_belief of this version"):
        ObjectBeliefMessage.decode(senses().encode())


@hypothesis.given(st.integers(8, len(senses().encode()) - 1), st.integers(0, 255))
def test_a_damaged_message_is_a_message_or_a_protocol_error(place: int, byte: int) -> None:
    data = bytearray(senses().encode())
    data[place] = byte
    try:
        message = HandSensesMessage.decode(bytes(data))
    except ProtocolError:
        return
    assert all(wrench.shape == (6,) for wrench in message.wrenches.values())


@pytest.mark.parametrize("twice", ["joints", "wrenches", "pressures"])
def test_a_message_that_names_a_part_twice_is_refused(twice: str) -> None:
    names = {"joints": (b"J1", b"J2"), "wrenches": (b"f1", b"f2"), "pressures": (b"p1", b"p2")}
    made = HandSensesMessage(
        joints={"J1": 0.1, "J2": 0.9},
        wrenches={"f1": np.zeros(6), "f2": np.ones(6)},
        pressures={"p1": np.zeros(2), "p2": np.ones(3)},
    )
    HandSensesMessage.decode(made.encode())
    first, second = names[twice]
    with pytest.raises(ProtocolError, match=f"lcmt_hand_senses must name '{first.decode()}' once, not twice"):
        HandSensesMessage.decode(made.encode().replace(second, first))


def test_an_empty_message_is_one() -> None:
    for kind in (HandSensesMessage, ObjectPoseMessage, ObjectBeliefMessage):
        again = kind.decode(kind().encode())
        assert again.encode() == kind().encode()
