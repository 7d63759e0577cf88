"""That the watch over sockets sees what it is to see, and that nothing in the tree asks for more than this machine."""

import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.listening import IS_KNOWN, Watch

ROOT = Path(__file__).parents[1]
needs_proc = pytest.mark.skipif(not IS_KNOWN, reason="the system does not tell who listens")


@needs_proc
@pytest.mark.parametrize(
    ("kind", "address", "is_local"),
    [
        (socket.SOCK_STREAM, "127.0.0.1", True),
        (socket.SOCK_STREAM, "0.0.0.0", False),
        (socket.SOCK_STREAM, "::1", True),
        (socket.SOCK_STREAM, "::", False),
        (socket.SOCK_DGRAM, "127.0.0.1", True),
        (socket.SOCK_DGRAM, "0.0.0.0", False),
    ],
)
def test_an_open_door_is_seen(kind: int, address: str, is_local: bool) -> None:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with Watch() as watch:
        try:
            door = socket.socket(family, kind)
            door.bind((address, 0))
        except OSError as error:
            pytest.skip(f"there is no such address here ({error})")
        with door:
            port = door.getsockname()[1]
            if kind == socket.SOCK_STREAM:
                watch.look()
                assert port not in {found.port for found in watch.opened}  # it does not listen yet
                door.listen()
            watch.look()
    (found,) = (found for found in watch.opened if found.port == port)
    assert found.address == address
    assert found.is_local == is_local
    assert (found in watch.foreign) != is_local


@needs_proc
def test_a_childs_door_is_seen_too() -> None:
    child = "import socket; s = socket.create_server(('127.0.0.1', 0)); print(s.getsockname()[1], flush=True); input()"
    process = subprocess.Popen([sys.executable, "-c", child], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    port = int(process.stdout.readline())
    with Watch() as watch:
        watch.look()
    process.communicate("\n", timeout=60)
    assert port in {door.port for door in watch.opened}


def test_meshcat_is_asked_to_listen_on_this_machine_alone() -> None:
    """By all code, guides and notebooks: of itself it listens to everybody."""
    files = [
        path for suffix in ("py", "md", "ipynb") for path in ROOT.rglob(f"*.{suffix}") if ".venv" not in path.parts
    ]
    asked = 0
    for path in files:
        for call in re.finditer(r"\b(Meshcat|StartMeshcat)\(([^\n]*)", path.read_text(encoding="utf-8")):
            assert call.group(2).startswith('MeshcatParams(host="localhost"'), (
                f"{path.relative_to(ROOT)}: {call.group()}"
            )
            asked += 1
    assert asked > 5
