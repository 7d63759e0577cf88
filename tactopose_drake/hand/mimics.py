"""The couplings of joints in a model's file: the `mimic` entries of a URDF or an SDF."""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from tactopose_drake.errors import InvalidFileError

_LARGEST = 2**26  # bytes


@dataclass(frozen=True)
class Mimic:
    """q_joint = ratio * q_follows + offset, rad or m."""

    joint: str
    follows: str
    ratio: float
    offset: float
    # Whether Drake couples the joints; it ignores SDFormat's own entries, and those that are not directly in a <joint>.
    is_obeyed: bool = True


def read_mimics(path: Path) -> tuple[Mimic, ...] | None:
    """The mimic entries of a model's file; None if it is neither a URDF nor an SDF.

    An entry that names a joint which itself follows another is resolved to the joint at the end of that chain.

    Raises:
        InvalidFileError: if the file cannot be read, an entry has an invalid number, or joints follow each other in a
            circle.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidFileError(f"{path} cannot be read ({error.strerror}).") from None
    if b"<!ENTITY" in content:
        raise InvalidFileError(f"{path} must be of plain elements, and not declare entities.")
    if len(content) > _LARGEST:
        raise InvalidFileError(f"{path} must have at most {_LARGEST} bytes, not {len(content)}.")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise InvalidFileError(f"{path} must be XML ({error}).") from None
    if root.tag not in ("robot", "sdf"):
        return None
    is_sdf = root.tag == "sdf"
    found = [(joint, mimic) for joint in root.iter("joint") for mimic in joint.iterfind(".//{*}mimic")]
    try:
        entries = [
            _by_attributes(joint, mimic, is_obeyed=mimic in list(joint) and mimic.tag.startswith("{") == is_sdf)
            if not is_sdf or mimic.tag.startswith("{")
            else _by_elements(joint, mimic)
            for joint, mimic in found
        ]
    except ValueError as error:
        raise InvalidFileError(f"{path}: a mimic entry must have valid numbers ({error}).") from None
    of_joint = {mimic.joint: mimic for mimic in entries}
    return tuple(_of_leader(path, mimic, of_joint) for mimic in entries)


def _of_leader(path: Path, mimic: Mimic, of_joint: dict[str, Mimic]) -> Mimic:
    """The entry with its chain of mimics resolved to a joint that follows none."""
    passed = [mimic.joint]
    while mimic.follows in of_joint:
        if mimic.follows in passed:
            raise InvalidFileError(
                f"{path}: one of the joints {', '.join(passed)} must follow none, but they follow each other in a "
                "circle."
            )
        passed.append(mimic.follows)
        inner = of_joint[mimic.follows]
        offset = mimic.ratio * inner.offset + mimic.offset
        is_obeyed = mimic.is_obeyed and inner.is_obeyed
        mimic = Mimic(mimic.joint, inner.follows, mimic.ratio * inner.ratio, offset, is_obeyed)
    return mimic


def _by_attributes(joint: ElementTree.Element, mimic: ElementTree.Element, *, is_obeyed: bool) -> Mimic:
    """Reads an entry with attributes, as in a URDF and in Drake's own entries of an SDF."""
    ratio, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
    return Mimic(joint.get("name", ""), mimic.get("joint", ""), ratio, offset, is_obeyed)


def _by_elements(joint: ElementTree.Element, mimic: ElementTree.Element) -> Mimic:
    ratio, offset, reference = (
        float(mimic.findtext(name) or default)
        for name, default in (("multiplier", "1"), ("offset", "0"), ("reference", "0"))
    )
    return Mimic(joint.get("name", ""), mimic.get("joint", ""), ratio, offset - ratio * reference, is_obeyed=False)
