"""What every public name says of itself: what goes in, in which shape and unit, and which errors come out."""

import dataclasses
import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

import tactopose_drake as tp

# What carries a shape: an array or a pose; and what carries a unit: a number that measures something.
ARRAY = re.compile(r"ndarray|FloatArray|ArrayLike|NDArray")
SHAPE = re.compile(r"\([^()]*[\w]\s*,[^()]*\)|shape|number or")
UNIT = re.compile(
    r"\b(m|rad|N|Pa|kg|s|deg|m\^[23])\b|unit|ratio|coefficient|share|weight|probab|index|cost|likelihood|log|poses X_"
)


def callables() -> Iterator[tuple[str, Any]]:
    """Every public function, class and public method or property of a class, by its full name."""
    for name in tp.__all__:
        thing = getattr(tp, name)
        yield name, thing
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for member, value in vars(thing).items():
                if not member.startswith("_") and (
                    inspect.isfunction(value) or isinstance(value, (property, classmethod, staticmethod))
                ):
                    yield f"{name}.{member}", value


PUBLIC = dict(callables())
DATACLASSES = [name for name, thing in PUBLIC.items() if inspect.isclass(thing) and dataclasses.is_dataclass(thing)]
FUNCTIONS = [
    name
    for name, thing in PUBLIC.items()
    if inspect.isfunction(thing) or isinstance(thing, (classmethod, staticmethod))
]


def entries(documentation: str, section: str) -> dict[str, str]:
    """The entries under a section of a docstring, by name."""
    match = re.search(rf"^{section}:\n((?:    .*\n|\n)+)", inspect.cleandoc(documentation) + "\n", re.M)
    found: dict[str, str] = {}
    for names, text in re.findall(r"^    ([\w, ]+?): (.*?)(?=^    \w|\Z)", match[1] if match else "", re.M | re.S):
        found.update(dict.fromkeys(names.split(", "), " ".join(text.split())))
    return found


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_says_what_it_is(name: str) -> None:
    documentation = inspect.getdoc(PUBLIC[name]) or ""
    assert re.match(r".+[.:]", documentation.partition("\n\n")[0], re.S), f"{name}: {documentation!r}"


@pytest.mark.parametrize("name", DATACLASSES)
def test_every_field_has_a_meaning_and_arrays_a_shape(name: str) -> None:
    told = entries(PUBLIC[name].__doc__, "Attributes")
    for field in dataclasses.fields(PUBLIC[name]):
        if field.name.startswith("_") or not (field.init or field.repr):  # the latter is its author's affair
            continue
        assert field.name in told, f"{name}.{field.name} is not told"
        if ARRAY.search(str(field.type)):
            assert SHAPE.search(told[field.name]), f"{name}.{field.name}: no shape in {told[field.name]!r}"
        if re.search(r"ndarray|FloatArray|float", str(field.type)):
            assert UNIT.search(told[field.name]), f"{name}.{field.name}: no unit in {told[field.name]!r}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_has_a_meaning_and_arrays_a_shape(name: str) -> None:
    function = inspect.unwrap(getattr(PUBLIC[name], "__func__", PUBLIC[name]))
    told = entries(function.__doc__, "Args")
    parameters = {p: v for p, v in inspect.signature(function).parameters.items() if p not in ("self", "cls")}
    if len(parameters) == 1 and not told:
        return  # One argument may be told in the first sentence.
    for parameter, value in parameters.items():
        assert parameter in told, f"{name}({parameter}) is not told"
        if ARRAY.search(str(value.annotation)):
            assert SHAPE.search(told[parameter]), f"{name}({parameter}): no shape in {told[parameter]!r}"


@pytest.mark.parametrize("name", [*DATACLASSES, *FUNCTIONS])
def test_what_checks_its_input_says_which_errors_come(name: str) -> None:
    thing = PUBLIC[name]
    checked = getattr(thing, "__post_init__", None) if inspect.isclass(thing) else getattr(thing, "__func__", thing)
    source = inspect.getsource(checked) if checked else ""
    if re.search(r"\braise \w+Error|finite_array\(|positive_number\(|unit_vectors\(|pose_matrix\(", source):
        assert "Raises:" in thing.__doc__, f"{name} checks its input, and does not say what it raises"


@pytest.mark.parametrize("name", ["solve_contact", "describe_patch"])
def test_what_the_thesis_defines_names_its_equation(name: str) -> None:
    assert re.search(r"eqs?\. \d+\.\d+|section \d+\.\d+|algorithm \d+\.\d+", PUBLIC[name].__doc__)
