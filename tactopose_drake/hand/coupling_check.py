"""Whether a hand's file and its model say the same of the joints that follow others."""

from collections.abc import Iterator
from pathlib import Path

from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.findings import Finding, Verdict, fault
from tactopose_drake.hand.finger_chain import joints_towards
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.mimics import Mimic, read_mimics
from tactopose_drake.resources import make_parser

_SAME = 1e-3  # difference of ratios, or of offsets in rad or m, that is none


def check_couplings(plant: MultibodyPlant, hand: Hand) -> Iterator[Finding]:
    """Compares the couplings of a hand's file with the `mimic` entries of its model."""
    told = {c.joint: Mimic(c.joint, c.follows, c.ratio, c.offset) for f in hand.config.fingers for c in f.couplings}
    path = Path(_model_file(hand.config))
    try:
        mimics = read_mimics(path)
    except InvalidInputError as error:
        yield fault("couplings", error)
        return
    if mimics is None:
        yield Finding("couplings", f"cannot be compared with those of {path.name}: it is no URDF or SDF", "note")
        return
    of_model = {mimic.joint: mimic for mimic in mimics}
    for name in sorted({*told, *of_model}):
        ours, theirs = told.get(name), of_model.get(name)
        if ours is None:
            verdict: Verdict = "fault" if name in _of_fingers(plant, hand) else "note"
            text = (
                f"the model lets {name!r} follow {theirs.follows!r}; the hand's file does not say so" if theirs else ""
            )
            yield Finding("couplings", text, verdict, _entry(theirs) if theirs else "")
        elif theirs is None:
            yield Finding("couplings", f"{_shown(ours)}, but the model has no mimic for it: it would dangle", "fault")
        elif ours.follows != theirs.follows or _differ(ours, theirs):
            yield Finding("couplings", f"the file says {_shown(ours)}, the model {_shown(theirs)}", "fault")
        else:
            yield Finding("couplings", f"{_shown(ours)}, as the model has it")


def _differ(a: Mimic, b: Mimic) -> bool:
    return abs(a.ratio - b.ratio) > _SAME or abs(a.offset - b.offset) > _SAME


def _entry(mimic: Mimic) -> str:
    """A coupling as a hand's file has it."""
    offset = f", offset: {mimic.offset:g}" if mimic.offset else ""
    return f"{{joint: {mimic.joint}, follows: {mimic.follows}, ratio: {mimic.ratio:g}{offset}}}"


def _shown(mimic: Mimic) -> str:
    offset = f" {'+' if mimic.offset > 0 else '-'} {abs(mimic.offset):g}" if mimic.offset else ""
    return f"{mimic.joint} = {mimic.ratio:g} {mimic.follows}{offset}"


def _model_file(config: HandConfig) -> str:
    if "://" not in config.model:
        return config.model
    package, _, rest = config.model.partition("://")[2].partition("/")
    packages = make_parser(MultibodyPlant(0.001), config.packages).package_map()
    return str(Path(packages.GetPath(package)) / rest)


def _of_fingers(plant: MultibodyPlant, hand: Hand) -> set[str]:
    return {name for frame in hand.sensor_frames.values() for name in joints_towards(plant, hand, frame)}
