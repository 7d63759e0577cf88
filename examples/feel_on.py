"""A hand holds a screwdriver with three fingers, and explores it with the others until its pose is known."""

import numpy as np
from pydrake.systems.analysis import Simulator

from tactopose_drake.station import load_scenario, make_station
from tactopose_drake.systems import TouchExplorationParams

LONGEST = 20.0  # s

scenario = load_scenario("shadow_like").without_errors()
scenario.object, scenario.seed = "screwdriver", 0
scenario.planner.least_fingers, scenario.planner.fingers = 3, ["thumb", "first", "middle"]
scenario.vision.period = LONGEST  # one view, of the open hand
scenario.exploration = TouchExplorationParams()

station = make_station(scenario)
simulator = Simulator(station.diagram)
context = simulator.get_mutable_context()
station.start(context)
simulator.set_monitor(station.release_when_held)
port, phase, status = station.diagram.GetOutputPort, "", ""
while context.get_time() < LONGEST and status != "resolved":
    simulator.AdvanceTo(context.get_time() + 0.05)
    before, phase = phase, port("explored_phase").Eval(context)
    status = port("explored_touch_status").Eval(context)
    if phase == "reach" and before != "reach":
        move = port("explored_next_touch").Eval(context)
        print(f"{context.get_time():.1f} s: {move.finger} moves, for {move.information:.2f} of {move.entropy:.2f} nats")

X_PO, X_PO_hat = station.object_pose(context), port("explored_object_pose").Eval(context)
off = 1e3 * np.linalg.norm(X_PO.translation() - X_PO_hat.translation())
touches, share = port("explored_count").Eval(context)[0], port("explored_resolved").Eval(context)[0]
print(f"{touches:.0f} touches, {share:.0%} of the belief about one pose, {off:.1f} mm from the truth")
