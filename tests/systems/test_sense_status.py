"""The statuses of all sensors in one line."""

import pytest
from pydrake.common.value import AbstractValue

from tactopose_drake.systems.sense_status import SenseStatus


@pytest.mark.parametrize(
    ("statuses", "joined"),
    [
        ({}, "ok"),
        ({"thumb": "ok", "first": "ok"}, "ok"),
        ({"thumb": "ok", "first": "stale: 0.2 s old"}, "first: stale: 0.2 s old"),
        ({"thumb": "ok (saturated: f_x)", "first": "no reply"}, "thumb: ok (saturated: f_x); first: no reply"),
    ],
)
def test_each_sensor_that_is_not_simply_ok_is_named_in_the_order_of_the_sensors(
    statuses: dict[str, str], joined: str
) -> None:
    system = SenseStatus(tuple(statuses))
    context = system.CreateDefaultContext()
    output = system.GetOutputPort("sense_status")
    for name in statuses:
        system.GetInputPort(name).FixValue(context, AbstractValue.Make("ok"))
    assert output.Eval(context) == "ok"
    for name, status in statuses.items():
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(status))
    assert output.Eval(context) == joined
