"""The progress bar of commands, which is shown only on a terminal."""

from rich.progress import Progress, ProgressColumn

from tactopose_drake.cli.consoles import ERRORS


def progress_bar(*columns: ProgressColumn) -> Progress:
    """A progress bar that is removed at the end; without a terminal, nothing is printed."""
    return Progress(*columns, console=ERRORS, transient=True, disable=not ERRORS.is_interactive)
