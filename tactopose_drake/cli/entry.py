"""The entry point of `tactopose`, which loads the rest: that takes seconds, in which an interrupt may come too."""

import os
import signal
import threading
from types import FrameType

_AGAIN = 0.05  # s


def start() -> None:
    """Runs the command line; an interrupt is one line and the exit status 1, whenever it comes."""
    signal.signal(signal.SIGINT, _leave)
    from tactopose_drake.cli.main import main

    signal.signal(signal.SIGINT, _interrupt)
    main()


def _leave(*_: object) -> None:
    """Ends the process at once: nothing is begun yet, and modules would tell at length that they cannot load."""
    os.write(2, b"error: interrupted\n")
    os._exit(1)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Interrupts, but not while a module is loaded: compiled ones swallow it. Then it comes again a little later."""
    if _is_loading(frame):
        again = threading.Timer(_AGAIN, signal.raise_signal, (number,))
        again.daemon = True
        again.start()
    else:
        signal.default_int_handler(number, frame)


def _is_loading(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
