"""Who may connect to a process: `python -m tests.listening python examples/own_diagram.py` runs a command and tells.

Looks twenty times a second at what Linux says of the sockets of a process and of its children. Exit status 1 where one
could be reached from another machine, 2 where the command failed.
"""

import contextlib
import ipaddress
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import NamedTuple, Self

PROC = Path("/proc")
IS_KNOWN = (PROC / "net" / "tcp").exists()
"""Whether the system tells."""

_PERIOD = 0.05  # s
_LISTENS, _UNCONNECTED = "0A", "07"  # states, of TCP and of UDP


class Door(NamedTuple):
    """A socket that others can send to."""

    protocol: str
    address: str
    port: int
    inode: str

    @property
    def is_local(self) -> bool:
        """Whether only this machine can."""
        address = ipaddress.ip_address(self.address)
        mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
        return (mapped or address).is_loopback


def family(process: int) -> set[int]:
    """A process and all that it has started, by their ids."""
    parents = {}
    for folder in PROC.iterdir() if IS_KNOWN else ():
        if folder.name.isdecimal():
            with contextlib.suppress(OSError, IndexError):  # it has ended meanwhile
                parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
    found, todo = set(), [process]
    while todo:
        found.add(one := todo.pop())
        todo += [child for child, parent in parents.items() if parent == one and child not in found]
    return found


def doors(process: int) -> set[Door]:
    """The open doors of one process."""
    inodes, found = set(), set()
    with contextlib.suppress(OSError):
        for entry in (PROC / str(process) / "fd").iterdir():
            with contextlib.suppress(OSError):
                inodes.add(os.readlink(entry))
        # The tables of TCP take the kernel milliseconds each: they are asked for a process that has sockets.
        has_sockets = any(inode.startswith("socket:") for inode in inodes)
        for protocol in ("tcp", "tcp6", "udp", "udp6") if has_sockets else ():
            for line in (PROC / str(process) / "net" / protocol).read_text().splitlines()[1:]:
                (
                    _,
                    own,
                    _,
                    state,
                    *_,
                ) = fields = line.split()
                if state == (_LISTENS if protocol.startswith("tcp") else _UNCONNECTED):
                    address, port = own.split(":")
                    if f"socket:[{fields[9]}]" in inodes:
                        found.add(Door(protocol, _address(address), int(port, 16), fields[9]))
    return found


def _address(digits: str) -> str:
    """An address as the tables have it: words of 32 bits, each in the machine's order."""
    data = bytes.fromhex(digits)
    words = [data[i : i + 4] for i in range(0, len(data), 4)]
    ordered = b"".join(word[::-1] if sys.byteorder == "little" else word for word in words)
    return str(ipaddress.ip_address(ordered))


class Watch:
    """Notes which doors a process and its children open while it lasts; a context manager."""

    def __init__(self, process: int | None = None) -> None:
        self._process = os.getpid() if process is None else process
        self._before = doors(self._process)
        self._seen: set[Door] = set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, name="watch over doors", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self.look()

    def look(self) -> None:
        """Notes what is open now."""
        for process in family(self._process):
            self._seen |= doors(process) - self._before

    def _work(self) -> None:
        while not self._over.wait(_PERIOD):
            self.look()

    @property
    def opened(self) -> set[Door]:
        return self._seen - self._before

    @property
    def foreign(self) -> set[Door]:
        """Those that other machines could use."""
        return {door for door in self.opened if not door.is_local}


def main() -> int:
    with subprocess.Popen(sys.argv[1:]) as command, Watch(command.pid) as watch:
        failed = command.wait() != 0
    for door in sorted(watch.opened):
        print(f"{door.protocol} {door.address} {door.port} {'' if door.is_local else 'OPEN TO OTHERS'}")
    print(f"{len(watch.opened)} doors, {len(watch.foreign)} open to others")
    return 1 if watch.foreign else 2 * failed


if __name__ == "__main__":
    sys.exit(main())
