"""What an estimate was made from, and how it is shown."""

import dataclasses
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import path_of

# What draws is above: it is found by its name when it is asked for, and nothing here needs it.
_PRESENTATION = "tactopose_drake.visualization.presentation"


@dataclasses.dataclass(frozen=True, eq=False)
class Question:
    """An object and what is known of its pose.

    It is shared, never copied; pickles leave it out, since it is large and whoever asked has it.

    Attributes:
        model: the object.
        evidence: what is known.
    """

    model: ObjectModel
    evidence: Evidence

    def __deepcopy__(self, memo: Any) -> "Question":
        return self

    def __reduce__(self) -> tuple[Callable[[], None], tuple[()]]:
        return _forgotten, ()


class Presentable:
    """An estimate that shows itself, as long as it knows its `question`."""

    question: Question | None

    def show(self) -> Path | None:
        """Shows the estimate as a page that can be turned: in a notebook below the cell, or else in the web browser.

        Returns:
            The page's file, in a temporary folder; None in a notebook.

        Raises:
            InvalidInputError: if the estimate does not know what it was made from.
        """
        return cast("Path | None", _presentation().show(self))

    def save_html(self, path: str | Path) -> None:
        """Writes the page that `show` shows: one file, which works without a network.

        Raises:
            InvalidInputError: if the estimate does not know what it was made from, or of what is no path.
            InvalidFileError: if the file cannot be written.
        """
        _presentation().save_estimate(path_of("path", path), self)

    def _repr_html_(self) -> str:
        return cast("str", _presentation().notebook_html(self))


def _presentation() -> Any:
    return importlib.import_module(_PRESENTATION)


def _forgotten() -> None:
    return None
