from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner

from tests.examples.scripts import EXAMPLES, load_script

WRITES = """
import sys
from pathlib import Path
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
out = Path(sys.argv[sys.argv.index("--out") + 1])
out.mkdir(parents=True)
(out / "works.md").write_text("# Table 9.9, 3 trials\\n\\n| a |\\n|---|\\n| %s |\\n" % sys.argv[1:-2])
FigureCanvasAgg(Figure()).print_png(out / "plot.png")
"""


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    module = load_script("report.py")
    (tmp_path / "works.py").write_text(WRITES)
    (tmp_path / "prints.py").write_text('"""What it says.\n\nMore."""\nprint("7 mm")')
    (tmp_path / "breaks.py").write_text("raise SystemExit('the dog ate it')")
    monkeypatch.setattr(module, "EXAMPLES", tmp_path)
    works = module.Section(script="works.py", covers=("table 9.9",), quick=("--few",), full=("--many",))
    monkeypatch.setattr(
        module, "SECTIONS", (works, module.Section(script="prints.py"), module.Section(script="breaks.py"))
    )
    return module


def test_the_page_holds_what_the_scripts_wrote(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--only", "works", "--out", str(tmp_path / "report")])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "report" / "report.md").read_text()
    page = (tmp_path / "report" / "report.html").read_text()
    assert "| table 9.9 | [works](#works) |" in text
    assert "\n## Table 9.9, 3 trials\n" in text
    assert "--few" in text
    assert "--many" not in text
    assert "<th>a</th>" in page
    assert 'src="data:image/png;base64,' in page
    assert "report.md" not in page


def test_a_script_that_fails_is_told_and_the_others_are_there(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--full", "--out", str(tmp_path / "report")])
    assert result.exit_code == 1
    text = (tmp_path / "report" / "report.md").read_text()
    assert "`python examples/breaks.py` failed:" in text
    assert "the dog ate it" in text
    assert "--many" in text
    assert "\n## What it says\n\n```\n7 mm\n```\n" in text


def test_an_unknown_section_is_an_error_before_any_work(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--only", "tabel", "--out", str(tmp_path / "report")])
    assert result.exit_code == 2
    assert "sections are works, prints, breaks" in result.output
    assert not (tmp_path / "report").exists()


def test_every_section_is_a_script_and_nothing_is_covered_twice() -> None:
    module = load_script("report.py")
    covered = [item for section in module.SECTIONS for item in section.covers] + list(module.NOT_REPRODUCED)
    assert len(set(covered)) == len(covered)
    for section in module.SECTIONS:
        text = (EXAMPLES / section.script).read_text()
        for option in (*section.quick, *section.full):
            assert not option.startswith("--") or f'"{option}"' in text, f"{section.script}: {option}"
