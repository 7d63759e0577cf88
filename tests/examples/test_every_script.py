import re
from pathlib import Path

import pytest

from tests.examples.scripts import EXAMPLES

SCRIPTS = [file for file in sorted(EXAMPLES.rglob("*.py")) if "__main__" in file.read_text()]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.stem)
def test_some_test_loads_it(script: Path) -> None:
    tests = [file.read_text() for file in Path(__file__).parent.glob("test_*.py")]
    assert any(re.search(rf"\"{script.stem}(\.py)?\"|/{script.stem}\.py\"", text) for text in tests)
