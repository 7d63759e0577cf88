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
# Numba's compiler, which loads and makes kernels: an interrupt is lost in a callback from it, and leaves objects behind
# that are freed twice.
_COMPILER = f"{os.sep}llvmlite{os.sep}"


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
    """Interrupts; while a module, YAML file or kernel is loaded, which may swallow the interrupt, it is postponed."""
    if _is_loading(frame):
        # To the main thread, which may be waiting by then: a signal to the timer's own thread would not wake it.
        again = threading.Timer(_AGAIN, signal.pthread_kill, (threading.main_thread().ident, number))
        again.daemon = True
        again.start()
    else:
        signal.default_int_handler(number, frame)


def _is_loading(frame: FrameType | None) -> bool:
    while frame is not None:
        file = frame.f_code.co_filename
        if file.startswith("<frozen importlib") or file.endswith(_YAML) or _COMPILER in file:
            return True
        frame = frame.f_back
    return False
