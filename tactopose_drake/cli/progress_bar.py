"""How far a command's work is, shown on a terminal; what reads the errors otherwise gets no line of it."""

from rich.progress import Progress, ProgressColumn

from tactopose_drake.cli.consoles import ERRORS


def progress_bar(*columns: ProgressColumn) -> Progress:
    """A bar that vanishes at the end; where there is no terminal, none, and no empty line in its place."""
    return Progress(*columns, console=ERRORS, transient=True, disable=not ERRORS.is_interactive)
