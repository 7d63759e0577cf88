"""Simulated devices in a process of their own: `python -m tests.drivers.serve_devices '{"interface": ...}'`.

Says "ready" when they can be asked, and ends with its standard input.
"""

import json
import sys

import can

from tactopose_drake.drivers.simulation.device_server import DeviceServer
from tests.drivers.rigs import make_board, make_hand

if __name__ == "__main__":
    with DeviceServer(can.Bus(**json.loads(sys.argv[1])), [make_board(), make_hand()]):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.read()
