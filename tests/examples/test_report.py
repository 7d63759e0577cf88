import re
import threading
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from click.testing import CliRunner

from tests.examples.scripts import load_script, share_script

WRITES = """
import sys
from pathlib import Path
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
out = Path(sys.argv[sys.argv.index("--out") + 1])
out.mkdir(parents=True, exist_ok=True)
(out / "works.md").write_text("# Table 9.9, 3 trials\\n\\n| a |\\n|---|\\n| %s |\\n" % sys.argv[1:-2])
for name in ("figure_9_10", "figures_9_8_to_9_9"):
    FigureCanvasAgg(Figure()).print_png(out / f"{name}.png")
(out / "figure_9_10.html").write_text("a scene")
"""
# What the report is there for.
WANTED = {
    "table": "3.1 5.1 5.2 5.3 6.1",
    "figure": "3.12 3.13 3.14 3.15 3.16 3.17 3.18 3.19 3.24 3.25 3.26 4.5 4.8 4.9 4.10 4.11 4.12 4.13 4.19 4.20 "
    "5.3 5.4 5.5 5.11 5.12 5.14 6.1 6.2 6.3 6.4",
}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    module, sections = load_script("report.py"), share_script("report_sections.py")
    (tmp_path / "works.py").write_text(WRITES)
    (tmp_path / "prints.py").write_text(
        '"""What it says.\n\nMore."""\nprint("trials ━━━━━━━ 100% 0:00:11")\nprint("7 mm at 100% of ━━━")'
    )
    (tmp_path / "breaks.py").write_text("raise SystemExit('the dog ate it')")
    monkeypatch.setattr(sections, "EXAMPLES", tmp_path)
    works = sections.Section(script="works.py", covers=("table 9.9",), quick="--few", full="--many")
    monkeypatch.setattr(
        module,
        "SECTIONS",
        (works, sections.Section(script="prints.py", alone=True), sections.Section(script="breaks.py")),
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
    assert page.count('src="data:image/png;base64,') == 2
    assert text.index("*Figures 9.8 to 9.9*") < text.index("*Figure 9.10*")
    assert "[Figure 9.10](works/figure_9_10.html)" in text
    assert "report.md" not in page


def test_a_script_that_fails_is_told_and_the_others_are_there(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--full", "--out", str(tmp_path / "report")])
    assert result.exit_code == 1
    text = (tmp_path / "report" / "report.md").read_text()
    assert "`python examples/breaks.py` failed:" in text
    assert "the dog ate it" in text
    assert "--many" in text
    assert "\n## What it says\n\n```\n7 mm at 100% of ━━━\n```\n" in text
    # In their order, whichever ended first.
    assert [text.index(f"[{name}](#") for name in ("works", "prints", "breaks")] == sorted(
        text.index(f"[{name}](#") for name in ("works", "prints", "breaks")
    )


def test_nothing_of_an_earlier_run_is_on_the_page(script: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "report" / "works").mkdir(parents=True)
    for name in ("old.png", "old.md", "old.html", "old.npz"):
        (tmp_path / "report" / "works" / name).write_text("from before")
    result = CliRunner().invoke(script.main, ["--only", "works", "--out", str(tmp_path / "report")])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "report" / "report.md").read_text()
    assert "old" not in text
    assert "from before" not in text
    assert (tmp_path / "report" / "works" / "old.npz").exists()  # What a script keeps to be quicker.


def test_what_needs_the_machine_to_itself_gets_it(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs_module = share_script("report_runs.py")
    running: list[str] = []
    beside: dict[str, int] = {}
    both = threading.Barrier(2, timeout=20)

    def run(section: Any, is_full: bool, folder: Path) -> Any:
        running.append(section.name)
        beside[section.name] = len(running)
        if not section.alone:
            both.wait()  # Two at a time, or this never ends.
            beside[section.name] = len(running)
            both.wait()
        running.remove(section.name)
        return runs_module.Run(section, "", 0.0, "", "")

    monkeypatch.setattr(runs_module, "run", run)
    runs = runs_module.run_all(script.SECTIONS, False, tmp_path, 2, lambda section: None)
    assert [made.section.name for made in runs] == ["works", "prints", "breaks"]
    assert beside == {"works": 2, "breaks": 2, "prints": 1}


def test_an_unknown_section_is_an_error_before_any_work(script: ModuleType, tmp_path: Path) -> None:
    result = CliRunner().invoke(script.main, ["--only", "tabel", "--out", str(tmp_path / "report")])
    assert result.exit_code == 2
    assert "must be one of the sections works, prints, breaks" in result.output
    assert not (tmp_path / "report").exists()


def test_all_that_is_wanted_is_covered() -> None:
    covered = {
        (kind, number)
        for section in share_script("report_sections.py").SECTIONS
        for item in section.covers
        for kind, number in numbers(item)
    }
    wanted = {(kind, number) for kind, text in WANTED.items() for number in text.split()}
    assert not wanted - covered


def numbers(item: str) -> list[tuple[str, str]]:
    """Of "figures 3.12 to 3.14": ("figure", "3.12"), ("figure", "3.13"), ("figure", "3.14")."""
    kind, rest = item.split(" ", 1)
    found = re.findall(r"(\d+)\.(\d+)", rest)
    if " to " in rest:
        (chapter, first), (_, last) = found
        found = [(chapter, str(number)) for number in range(int(first), int(last) + 1)]
    return [(kind.removesuffix("s"), f"{chapter}.{number}") for chapter, number in found]


def test_every_section_is_a_script_and_nothing_is_covered_twice() -> None:
    module = share_script("report_sections.py")
    covered = [item for section in module.SECTIONS for item in section.covers] + list(module.NOT_REPRODUCED)
    assert len(set(covered)) == len(covered)
    for section in module.SECTIONS:
        text = section.path.read_text()
        for option in f"{section.quick} {section.full}".split():
            assert not option.startswith("--") or f'"{option}"' in text, f"{section.script}: {option}"
