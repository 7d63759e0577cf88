import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import PassThrough

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.errors import InvalidInputError, PortTypeError
from tactopose_drake.systems.ports import (
    check_name_is_free,
    eval_input,
    eval_items,
    eval_named,
    eval_optional_input,
)


class Reader(LeafSystem):
    def __init__(self) -> None:
        super().__init__()
        self.set_name("reader")
        self.contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(Contacts.empty()))


def test_a_value_of_the_right_kind_is_returned() -> None:
    reader = Reader()
    context = reader.CreateDefaultContext()
    reader.contacts.FixValue(context, AbstractValue.Make(Contacts([[1, 2, 3]])))
    assert len(eval_input(reader.contacts, context, Contacts)) == 1
    assert len(eval_optional_input(reader.contacts, context, Contacts)) == 1


def test_another_kind_is_refused_by_the_name_of_the_port() -> None:
    reader = Reader()
    context = reader.CreateDefaultContext()
    reader.contacts.FixValue(context, AbstractValue.Make({"not": "contacts"}))
    with pytest.raises(
        PortTypeError, match="input port 'contacts' of system 'reader' must hold a Contacts, not a dict"
    ):
        eval_input(reader.contacts, context, Contacts)
    with pytest.raises(PortTypeError, match="'contacts'"):
        eval_optional_input(reader.contacts, context, Contacts)


def test_a_port_that_is_not_connected_is_named_unless_optional() -> None:
    reader = Reader()
    context = reader.CreateDefaultContext()
    with pytest.raises(
        PortTypeError, match="input port 'contacts' of system 'reader' must hold a Contacts, but is not connected"
    ):
        eval_input(reader.contacts, context, Contacts)
    assert eval_optional_input(reader.contacts, context, Contacts) is None


def test_an_optional_port_that_holds_none_gives_none() -> None:
    reader = Reader()
    context = reader.CreateDefaultContext()
    reader.contacts.FixValue(context, AbstractValue.Make(None))
    assert eval_optional_input(reader.contacts, context, Contacts) is None


def test_a_name_is_free_until_a_system_has_it() -> None:
    builder = DiagramBuilder()
    check_name_is_free(builder, "touch")
    builder.AddNamedSystem("touch", PassThrough(1))
    check_name_is_free(builder, "touch_2")
    for name, message in (
        ("touch", r"^name must be one that no other .* has, such as 'touch_2', not 'touch'\.$"),
        ("", "^name must not be empty"),
        (None, "^name must be a str, not None"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            check_name_is_free(builder, name)


def test_the_names_of_what_is_added_with_a_system_are_free_too() -> None:
    builder = DiagramBuilder()
    builder.AddNamedSystem("touch_noise", PassThrough(1))
    check_name_is_free(builder, "touch")
    check_name_is_free(builder, "touch_2", ["noise"])
    with pytest.raises(
        InvalidInputError, match=r"^name must be .*, not 'touch', as another .* is called 'touch_noise', as one "
    ):
        check_name_is_free(builder, "touch", ["sensor", "noise"])


def test_items_of_another_kind_are_refused_by_the_name_of_the_port() -> None:
    reader = Reader()
    anything = reader.DeclareAbstractInputPort("anything", AbstractValue.Make(None))
    context, message = (
        reader.CreateDefaultContext(),
        "input port 'anything' of system 'reader' must hold a {0} of str, not one with an int",
    )
    assert eval_items(anything, context, str) == ()
    anything.FixValue(context, AbstractValue.Make(("a", "b")))
    assert eval_items(anything, context, str) == ("a", "b")
    anything.FixValue(context, AbstractValue.Make(("a", 3)))
    with pytest.raises(PortTypeError, match=message.format("tuple")):
        eval_items(anything, context, str)
    anything.FixValue(context, AbstractValue.Make({"first": "a"}))
    assert eval_named(anything, context, str) == {"first": "a"}
    anything.FixValue(context, AbstractValue.Make({"first": "a", "second": 3}))
    with pytest.raises(PortTypeError, match=message.format("dict")):
        eval_named(anything, context, str)
