"""The command line, `tactopose`.

Exit status: 0 if an estimate was made, or a hand is usable; 2 for unusable input, with a line on stderr that says what
and where; 1 for anything else.
"""

import errno
import importlib
import logging
import os
import signal
import sys
from typing import Any, NoReturn

import click

from tactopose_drake.cli.consoles import ERRORS, OnceFilter
from tactopose_drake.errors import InvalidInputError, TactoposeError

_UNUSABLE_INPUT = 2

# The file and the function of each command, and its summary in the list of commands.
_COMMANDS = {
    "cache": ("cache_command.cache_command", "Shows or clears the cache of objects."),
    "calibrate": ("calibrate_command.calibrate", "Estimates a hand's errors from grasps of a known object."),
    "check-hand": ("check_hand_command.check_hand_command", "Checks a hand's YAML file."),
    "demo": ("demo_command.demo", "Closes a simulated hand and corrects the camera's pose by touch."),
    "estimate": ("estimate_command.estimate", "Estimates the pose of an object from what touches it."),
    "export": ("export_command.export", "Writes a recording as one file, for Foxglove and others."),
    "identify": ("identify_command.identify_command", "Identifies the touched object among those of a library."),
    "replay": ("replay_command.replay", "Replays a recording through the drivers, reproducible to the last bit."),
    "run": ("run_command.run", "Runs a scenario, simulated or on CAN devices."),
    "warm-up": ("warm_up_command.warm_up", "Compiles all kernels that are not compiled yet."),
}


class InterruptedRunError(Exception):
    """A keyboard interrupt; click's own handling would print another line."""


class _Commands(click.Group):
    """The commands; each is loaded only when it is used, because some take seconds."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        file, function = _COMMANDS[cmd_name][0].split(".")
        command: click.Command = getattr(importlib.import_module(f"tactopose_drake.cli.{file}"), function)
        logging.getLogger("drake").setLevel(logging.WARNING)  # After loading Drake, which sets the level, too.
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_text) for name, (_, help_text) in _COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise InterruptedRunError from None


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="tactopose_drake")
def cli() -> None:
    """Estimates the pose of a grasped object by touch."""


def main() -> None:
    """The entry point of `tactopose`."""
    for log in ("drake", "tactopose_drake"):
        logging.getLogger(log).addFilter(OnceFilter())
    logging.getLogger("can").setLevel(logging.ERROR)  # Damage of a log is reported once, at its end.
    try:
        # Returns the status of `Context.exit` and `click.exceptions.Exit`; commands return nothing.
        status = cli.main(prog_name="tactopose", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        sys.exit(_UNUSABLE_INPUT)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "tactopose"
        _fail(f"{error.format_message()} `{command} --help` says what is allowed.")
    except InvalidInputError as error:
        _fail(str(error))
    except (TactoposeError, OSError) as error:
        is_full = isinstance(error, OSError) and error.errno == errno.ENOSPC and error.filename is None
        _fail(f"standard output cannot be written ({os.strerror(errno.ENOSPC)})." if is_full else str(error), status=1)
    except (InterruptedRunError, click.Abort):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Cleanup must not be interrupted again.
        _fail("interrupted", status=1)
    sys.exit(status or 0)


def _fail(message: str, status: int = _UNUSABLE_INPUT) -> NoReturn:
    ERRORS.print("error: " + " ".join(message.split()), style="red", markup=False)
    sys.exit(status)
