"""Check that a hand's file and its model agree on coupled joints."""

from collections.abc import Iterator
from pathlib import Path

from pydrake.multibody.plant import MultibodyPlant

from tactopose_drake.errors import InvalidInputError
from tactopose_drake.hand.findings import Entry, Finding, fault
from tactopose_drake.hand.finger_chain import joints_towards
from tactopose_drake.hand.hand_config import Coupling, FingerConfig, HandConfig
from tactopose_drake.hand.hand_in_plant import Hand
from tactopose_drake.hand.mimics import Mimic, read_mimics
from tactopose_drake.resources import make_parser

_SAME = 1e-3  # differences of ratios, or of offsets in rad or m, below this are ignored


def check_couplings(plant: MultibodyPlant, hand: Hand) -> Iterator[Finding]:
    """Compares the couplings of a hand's file with the `mimic` entries of its model."""
    told = {c.joint: Mimic(c.joint, c.follows, c.ratio, c.offset) for f in hand.config.fingers for c in f.couplings}
    try:
        of_model = _mimics(hand.config)
    except InvalidInputError as error:
        yield fault("couplings", error)
        return
    if of_model is None:
        name = Path(_model_file(hand.config)).name
        yield Finding("couplings", f"cannot be compared with those of {name}: it is not a URDF or SDF", "note")
        return
    lacking = lacking_couplings(plant, hand)
    for finger, mimics in lacking.items():
        text = ", ".join(f"{mimic.joint!r} follow {mimic.follows!r}" for mimic in mimics)
        text = f"finger {finger!r}: the model lets {text}; the finger's couplings do not say so"
        yield Finding("couplings", text, "fault", _entries(plant, hand, hand.config.finger(finger), of_model))
    unsaid = {mimic.joint for mimics in lacking.values() for mimic in mimics}
    for name in sorted({*told, *of_model} - unsaid):
        ours, theirs = told.get(name), of_model.get(name)
        if ours is None and theirs is not None:
            yield Finding("couplings", f"{_shown(theirs)} by the model, on no finger of the file", "note")
        elif ours is not None and theirs is None:
            yield Finding("couplings", f"{_shown(ours)}, but the model has no mimic for it: it would dangle", "fault")
        elif ours is not None and theirs is not None:
            if ours.follows != theirs.follows or _differ(ours, theirs):
                yield Finding("couplings", f"the file says {_shown(ours)}, the model {_shown(theirs)}", "fault")
            elif not theirs.is_obeyed:
                entry = f'mimic joint="{ours.follows}" multiplier="{ours.ratio}" offset="{ours.offset}"/>'
                text = (
                    f"{_shown(ours)}, but Drake ignores the model's <mimic>: it would dangle; write directly in its "
                    f"<joint> <drake:{entry}, or in a URDF <{entry}"
                )
                yield Finding("couplings", text, "fault")
            else:
                yield Finding("couplings", f"{_shown(ours)}, as the model has it")


def lacking_couplings(plant: MultibodyPlant, hand: Hand) -> dict[str, list[Mimic]]:
    """Mimic entries of joints between palm and sensor that the finger's couplings lack, by finger."""
    try:
        of_model = _mimics(hand.config) or {}
    except InvalidInputError:
        return {}
    lacking: dict[str, list[Mimic]] = {}
    for finger, frame in hand.sensor_frames.items():
        said = {coupling.joint for coupling in hand.config.finger(finger).couplings}
        path = joints_towards(plant, hand, frame)
        mimics = [of_model[name] for name in path if name in of_model and name not in said]
        if mimics:
            lacking[finger] = mimics
    return lacking


def _entries(plant: MultibodyPlant, hand: Hand, finger: FingerConfig, of_model: dict[str, Mimic]) -> tuple[Entry, ...]:
    """The finger's entry `joints`, if it must change with the couplings, and its `couplings` as in the model."""
    path = joints_towards(plant, hand, hand.sensor_frames[finger.name])
    mimics = [of_model[name] for name in path if name in of_model]
    couplings = tuple(Coupling(joint=m.joint, follows=m.follows, ratio=m.ratio, offset=m.offset) for m in mimics)
    leaders = tuple(dict.fromkeys(of_model[name].follows if name in of_model else name for name in path))
    joints = () if set(leaders) == set(finger.joints) else (Entry(finger.name, "joints", leaders),)
    return *joints, Entry(finger.name, "couplings", couplings)


def _differ(a: Mimic, b: Mimic) -> bool:
    return abs(a.ratio - b.ratio) > _SAME or abs(a.offset - b.offset) > _SAME


def _shown(mimic: Mimic) -> str:
    offset = f" {'+' if mimic.offset > 0 else '-'} {abs(mimic.offset):g}" if mimic.offset else ""
    return f"{mimic.joint} = {mimic.ratio:g} {mimic.follows}{offset}"


def _mimics(config: HandConfig) -> dict[str, Mimic] | None:
    """The model's couplings by the joint that follows; None if its file format has none."""
    mimics = read_mimics(Path(_model_file(config)))
    return None if mimics is None else {mimic.joint: mimic for mimic in mimics}


def _model_file(config: HandConfig) -> str:
    if "://" not in config.model:
        return config.model
    package, _, rest = config.model.partition("://")[2].partition("/")
    packages = make_parser(MultibodyPlant(0.001), config.packages).package_map()
    return str(Path(packages.GetPath(package)) / rest)
