"""The inputs of an estimate, and methods that show the estimate with them."""

import dataclasses
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from tactopose_drake.core.evidence.evidence import Evidence
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import path_of

# Drawing is in a higher layer, which must not be imported here; it is looked up by name when it is needed.
_PRESENTATION = "tactopose_drake.visualization.presentation"


@dataclasses.dataclass(frozen=True, eq=False)
class Question:
    """An object and the evidence of its pose.

    It is shared and never copied. Pickles leave it out, since it is large and the caller has it.

    Attributes:
        model: the object.
        evidence: the evidence of its pose.
    """

    model: ObjectModel
    evidence: Evidence

    def __deepcopy__(self, memo: Any) -> "Question":
        return self

    def __reduce__(self) -> tuple[Callable[[], None], tuple[()]]:
        return _forgotten, ()


class Presentable:
    """An estimate that can be shown if its `question` is known."""

    question: Question | None

    def show(self) -> Path | None:
        """Shows the estimate as an interactive page: below the cell in a notebook, otherwise in the web browser.

        Returns:
            The page's file, in a temporary folder; None in a notebook.

        Raises:
            InvalidInputError: if the estimate's `question` is None.
        """
        return cast("Path | None", _presentation().show(self))

    def save_html(self, path: str | Path) -> None:
        """Writes the page that `show` opens as one file, which works without a network.

        Raises:
            InvalidInputError: if the estimate's `question` is None, or `path` is not a path.
            InvalidFileError: if the file cannot be written.
        """
        _presentation().save_estimate(path_of("path", path), self)

    def _repr_html_(self) -> str:
        return cast("str", _presentation().notebook_html(self))


def _presentation() -> Any:
    return importlib.import_module(_PRESENTATION)


def _forgotten() -> None:
    return None
