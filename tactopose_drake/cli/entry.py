"""The entry point of `tactopose`; loading the rest takes seconds, during which an interrupt may arrive."""

import io
import os
import signal
import sys
import threading
from types import FrameType

_AGAIN = 0.05  # s until a postponed interrupt is raised again
# Drake's reader, in which an interrupt becomes an error of the file if it comes in the conversion of an argument.
_YAML = os.path.join("pydrake", "common", "yaml.py")


def start() -> None:
    """Runs the command line; an interrupt at any time gives one line and the exit status 1.

    Characters that the locale's encoding lacks are printed escaped, as on stderr.
    """
    signal.signal(signal.SIGINT, _leave)
    if isinstance(sys.stdout, io.TextIOWrapper):  # It is None if it is closed.
        sys.stdout.reconfigure(errors="backslashreplace")
    from tactopose_drake.cli.main import main

    signal.signal(signal.SIGINT, _interrupt)
    main()


def _leave(*_: object) -> None:
    """Ends the process at once, as no work has started, and modules would report at length that they cannot load."""
    os.write(2, b"error: interrupted\n")
    os._exit(1)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Interrupts; while a module or a YAML file is being loaded, which may swallow the interrupt, it is postponed."""
    if _is_loading(frame):
        again = threading.Timer(_AGAIN, signal.raise_signal, (number,))
        again.daemon = True
        again.start()
    else:
        signal.default_int_handler(number, frame)


def _is_loading(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib") or frame.f_code.co_filename.endswith(_YAML):
            return True
        frame = frame.f_back
    return False
