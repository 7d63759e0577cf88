"""The file of a hand's volume at one instant: a list of spheres, or a hand and its joint positions."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactopose_drake.core.validation import FloatArray, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.data_checks import (
    check_list,
    check_mapping,
    check_number,
    check_vector,
    fault_in,
    read_data,
)
from tactopose_drake.hand.geometry import BodySpheres, HandGeometry
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.hand_in_plant import Hand, make_hand_plant
from tactopose_drake.hand.joint_matrices import reading_offsets
from tactopose_drake.hand.kinematics import HandKinematics
from tactopose_drake.hand.named_joints import NamedJoints, check_near_limits
from tactopose_drake.resources.yaml_files import shown


class HandVolumes(NamedTuple):
    """A hand's volume, and the parts of it that feel nothing; None if there are none.

    Attributes:
        hand: all links whose pose is known.
        untouched: fingertips, or other parts, that feel no contact.
    """

    hand: HandGeometry | None
    untouched: HandGeometry | None


def load_hand_volume(path: Path, config: HandConfig | None = None) -> HandVolumes:
    """Reads a hand's volume in the palm frame, m and rad, as a hand with joint positions or as spheres.

    As a hand: `hand`, one of the package by name or a *.hand.yaml by its path relative to this file's folder; `joints`,
    encoder readings by the joints' names; and optionally `untouched`, the fingers that feel nothing. Coupled joints
    follow; links behind a joint that is left out are unknown. A coupled joint that is given must not contradict its
    coupling, unless a clutch on its finger may have decoupled it. The offsets found by the hand's calibration are
    subtracted.

    As spheres: `spheres`, a list of `center` and `radius`; `untouched`, such a list; and `sigma`, the standard
    deviation of their surface. One of the lists is needed; all else is optional.

    Args:
        path: path of the file.
        config: the hand, in place of the one that the file names.

    Raises:
        InvalidFileError: if the file, or the hand's, cannot be read or does not fit the format.
    """
    if path.name.endswith(".hand.yaml"):
        raise InvalidFileError(f"{path} must name a hand's file by its key `hand`, not be one.")
    data = read_data(path)
    is_of_hand = isinstance(data, dict) and bool({"hand", "joints"} & data.keys())
    return _of_hand(path, data, config) if is_of_hand else _of_spheres(path, data)


def _of_spheres(path: Path, data: Any) -> HandVolumes:
    given = check_mapping(path, "", data, (), ("spheres", "untouched", "sigma"))
    if not {"spheres", "untouched"} & given.keys():
        raise InvalidFileError(f"{path} must have at least one of hand, spheres and untouched, but has none.")
    sigma = {"sigma": check_number(path, "sigma", given["sigma"])} if "sigma" in given else {}

    def volume(key: str) -> HandGeometry | None:
        if key not in given:
            return None
        entries = check_list(path, key, given[key], "sphere")
        spheres = [check_mapping(path, f"{key}[{i}]", entry, ("center", "radius")) for i, entry in enumerate(entries)]
        centers = [check_vector(path, f"{key}[{i}].center", sphere["center"], 3) for i, sphere in enumerate(spheres)]
        radii = [check_number(path, f"{key}[{i}].radius", sphere["radius"]) for i, sphere in enumerate(spheres)]
        try:
            return HandGeometry(np.array(centers), np.array(radii), **sigma)
        except InvalidInputError as error:
            raise fault_in(path, "", error, {"p_PH": f"{key}[{{}}].center", "radius": f"{key}[{{}}].radius"}) from None

    return HandVolumes(volume("spheres"), volume("untouched"))


def _of_hand(path: Path, data: dict[str, Any], config: HandConfig | None) -> HandVolumes:
    needed, optional = (("hand", "joints"), ("untouched",)) if config is None else (("joints",), ("hand", "untouched"))
    given = check_mapping(path, "", data, needed, optional)
    joints, untouched = given["joints"], given.get("untouched", [])
    config = _named_hand(path, given["hand"]) if config is None else config
    plant, hand = make_hand_plant(config)
    told = _positions(path, joints)
    with told_of(f"{path}: ", InvalidFileError):
        named = NamedJoints(plant, hand)
        q = named.positions("joints", told)
        check_near_limits("joints", told, plant, hand)
        named.check_couplings("joints", told, clutches=True)
        tips = _tips(hand, untouched)
    spheres = BodySpheres.of_hand(config)
    kinematics = HandKinematics(plant, hand.palm_frame)
    kinematics.move(q - reading_offsets(plant, hand))
    p_PH, known = kinematics.positions(spheres), kinematics.is_known(spheres.body)
    return HandVolumes(*(_chosen(p_PH, spheres, known & part) for part in (known, np.isin(spheres.body, tips))))


def _named_hand(path: Path, name: Any) -> HandConfig:
    if not isinstance(name, str):
        raise InvalidFileError(f"{path}: hand must be a name or a path, not {shown(name)}.")
    with told_of(f"{path}: hand: ", InvalidFileError):
        return load_hand_config(path.parent / name if Path(name).suffix else name)


def _positions(path: Path, joints: Any) -> dict[str, float]:
    """Positions by the joints' names, rad and m."""
    if not isinstance(joints, dict):
        raise InvalidFileError(f"{path}: joints must be a mapping of names to positions, not {shown(joints)}.")
    return {name: check_number(path, f"joints.{name}", position) for name, position in joints.items()}


def _tips(hand: Hand, untouched: Any) -> list[int]:
    """Body indices of the fingertips that feel nothing."""
    tips = {finger: int(weld.child_body().index()) for finger, weld in hand.welds.items()}
    if not isinstance(untouched, list) or not all(isinstance(name, str) and name in tips for name in untouched):
        raise InvalidInputError(
            f"untouched must be a list of fingers with a sensor, {', '.join(tips)}, not {shown(untouched)}."
        )
    return [tips[name] for name in untouched]


def _chosen(p_PH: FloatArray, spheres: BodySpheres, chosen: np.ndarray) -> HandGeometry | None:
    return HandGeometry(p_PH[chosen], spheres.radius[chosen]) if chosen.any() else None
