from pathlib import Path

from click.testing import CliRunner

from tests.examples.scripts import load_script


def test_the_pair_search_finds_what_local_searches_miss(tmp_path: Path) -> None:
    script = load_script("thesis/figures_3_25_and_3_26.py")
    result = CliRunner().invoke(script.main, ["--trials", "8", "--seed", "1", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "figures_3_25_and_3_26.png").read_bytes().startswith(b"\x89PNG")
    rows = [
        line.strip("| ").split(" | ") for line in (tmp_path / "figures_3_25_and_3_26.md").read_text().splitlines()[4:]
    ]
    found = {row[0].split(" (")[0]: int(row[1]) for row in rows}
    assert found["Pair search"] > max(found["Gradient descent"], found["Levenberg-Marquardt"])
