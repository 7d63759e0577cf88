"""The entry point of `tactopose`, which loads the rest: that takes seconds, in which an interrupt may come too."""

import os
import signal


def start() -> None:
    """Runs the command line; an interrupt is one line and the exit status 1, whenever it comes."""
    signal.signal(signal.SIGINT, _leave)
    from tactopose_drake.cli.main import main

    signal.signal(signal.SIGINT, signal.default_int_handler)
    main()


def _leave(*_: object) -> None:
    """Ends the process at once: nothing is begun yet, and modules would tell at length that they cannot load."""
    os.write(2, b"error: interrupted\n")
    os._exit(1)
