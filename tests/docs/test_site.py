"""The documentation builds without a warning, says all there is to say, and its examples run as written."""

import html
import importlib
import re
import shlex
import shutil
import subprocess
import sys
import typing
from pathlib import Path
from xml.etree import ElementTree

import click
import numpy as np
import pytest
import yaml
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

import tactopose_drake as tp
from tactopose_drake.cli.main import cli
from tactopose_drake.core.evidence.contact_doubt import SCEPTICAL
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tactopose_drake.hand.calibration_file import HandCalibration
from tactopose_drake.hand.hand_config import HandConfig
from tactopose_drake.hand.recorded_grasps import GraspFile
from tactopose_drake.hand.tactile_pads import TactilePadFile
from tactopose_drake.resources import model_path
from tactopose_drake.runs import read_recording, replay, write_mcap
from tactopose_drake.station.scenario import Scenario, load_scenario

ROOT = Path(__file__).parents[2]
PAGES = {str(path.relative_to(ROOT)): path.read_text() for path in sorted((ROOT / "docs").rglob("*.md"))}
FENCE = re.compile(r"^```(python|yaml|xml)\n(.*?)^```$", re.M | re.S)
EXAMPLES = {name: FENCE.findall(text) for name, text in PAGES.items()}
# The gallery's code is run where its pictures are compared (tests/examples/test_draw_gallery.py).
WITH_CODE = [
    name
    for name, blocks in EXAMPLES.items()
    if any(language == "python" for language, _ in blocks) and name != "docs/gallery.md"
]


# What a page of the site says, its name in front.
SAID = {
    # Not taken for a type and what is of it, as Napoleon does with a colon in a property's first line.
    "reference/core": "Contacts and patches as contacts: what poses are proposed from.",
    "reference/scenario": "A recording by tactopose run --record, !RecordedSenses in YAML.",
    "reference/command_line": "Folder for the results; those of an earlier run there are replaced.",
    "start": "examples/estimate_from_contacts.py is this with numbers.",
}


def test_concepts_says_how_often_contacts_are_false() -> None:
    _, table = PAGES["docs/concepts.md"].split("| `outlier_probability` |", 1)
    lines = [line.split("|")[-8:-1] for line in table.split("\n\n")[0].splitlines() if "---" not in line]
    columns = list(zip(*([cell.strip() for cell in line] for line in lines), strict=True))
    assert columns[0] == ("0", "any", *"00000001")
    assert len(columns) == 7
    assert SCEPTICAL.of_one is not None
    for probability, count, *said in columns[1:]:
        p, n = float(probability), int(count)
        each, one = SCEPTICAL.kinds.shares(p), SCEPTICAL.of_one.among(n)
        odds = n * p / (1.0 - p) * each.as_told * np.array([one.lost, one.displaced, one.turned, one.flipped])
        expected = [each.other, each.displaced, each.turned, *odds / (1.0 + odds.sum()), 1.0 / (1.0 + odds.sum())]
        assert [float(number) for number in said] == pytest.approx(expected, rel=5e-3)


def test_it_builds_without_a_warning_and_says_what_its_sources_say(tmp_path: Path) -> None:
    # One test of all, for processes that shared them out would each build the site.
    command = [sys.executable, "-m", "sphinx", "-b", "html", "-q", "-W", "--keep-going", ROOT / "docs", tmp_path]
    run = subprocess.run([*command, "-d", tmp_path / ".doctrees"], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert (tmp_path / "index.html").is_file()
    assert {page: said for page, said in SAID.items() if said not in text_of(tmp_path / f"{page}.html")} == {}
    # A blank line within a table makes a paragraph of the rest.
    assert [path.name for path in tmp_path.rglob("*.html") if "<p>| " in path.read_text()] == []


def text_of(page: Path) -> str:
    text = re.sub(r"<[^>]+>", "", page.read_text())
    return " ".join(html.unescape(text).replace("\u2019", "'").replace("\u00b6", "").split())


@pytest.mark.parametrize("page", [*PAGES, "README.md", "CONTRIBUTING.md", "tactopose_drake/drivers/README.md"])
def test_files_that_a_page_names_are_there(page: str) -> None:
    rooms = "|".join(path.name for folder in (ROOT, ROOT / "tactopose_drake") for path in folder.glob("[a-z]*/"))
    named = re.findall(rf"`((?:{rooms})/[\w./*]*)`", (ROOT / page).read_text().replace("out/", ""))
    missing = [name for name in named if not any([*ROOT.glob(name), *(ROOT / "tactopose_drake").glob(name)])]
    assert not missing


@pytest.mark.parametrize("folder", ["systems"])
def test_every_module_of_the_folder_is_in_the_reference(folder: str) -> None:
    modules = {path.stem for path in (ROOT / "tactopose_drake" / folder).glob("[!_]*.py")}
    told = set(re.findall(rf"automodule:: tactopose_drake\.{folder}\.(\w+)", PAGES[f"docs/reference/{folder}.md"]))
    assert told == modules


@pytest.mark.parametrize("folder", ["motion", "objectives", "posterior", "slip"])
def test_every_module_of_cores_folder_is_in_the_reference(folder: str) -> None:
    modules = {path.stem for path in (ROOT / "tactopose_drake" / "core" / folder).glob("[!_]*.py")}
    told = set(re.findall(rf"automodule:: tactopose_drake\.core\.{folder}\.(\w+)", PAGES["docs/reference/core.md"]))
    assert told == {name for name in modules if not name.endswith("_kernels")}


@pytest.mark.parametrize("root", [Scenario, HandConfig, TactilePadFile, GraspFile, HandCalibration])
def test_every_key_of_a_file_is_said_to_mean_something(root: type, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    yaml_schema = importlib.import_module("yaml_schema")
    untold = [
        f"{schema.__name__}.{name}"
        for schema in yaml_schema.schemas(root)
        for name, kind in typing.get_type_hints(schema).items()
        # What another schema holds is told there.
        if name not in yaml_schema.comments(schema) and not yaml_schema.parts(kind)
    ]
    assert not untold


@pytest.mark.parametrize("page", WITH_CODE)
def test_examples_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": page}
    for language, text in EXAMPLES[page]:
        if language == "python":
            exec(compile(text, page, "exec"), namespace)
            continue
        if language == "yaml":
            yaml.compose(text)
        else:
            ElementTree.fromstring(text)
        # A file that the page shows is there under the name that its first line says.
        if named := re.match(r"(?:#|<!--) (\S+\.\w+)", text):
            Path(named[1]).write_text(text)


def test_data_recorded_elsewhere_are_replayed_and_exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _, told = PAGES["docs/guides/run_and_record.md"].split("## Data that were recorded elsewhere", 1)
    (_, code), (_, scenario), *_ = FENCE.findall(told)
    exec(compile(code, "run_and_record.md", "exec"), {"__name__": "run_and_record"})
    Path("own_data.scenario.yaml").write_text(scenario)
    replayed = replay(Path("own_data"), load_scenario("own_data.scenario.yaml"))
    assert replayed.whole
    assert replayed.view.time > 0.5
    assert isinstance(replayed.view.value("tracked_hypotheses"), tp.PoseEstimate)
    write_mcap(read_recording(Path("own_data")), Path("own_data.mcap"))
    assert Path("own_data.mcap").stat().st_size > 1000


def test_the_readmes_code_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(model_path("objects", "mug.obj"), "mug.obj")
    model = tp.ObjectModel.from_mesh("mug.obj")
    contacts = touch_surface(model, np.eye(3, 4), 5, np.random.default_rng(0))
    builder = DiagramBuilder()
    zero = {finger: builder.AddSystem(ConstantVectorSource(np.zeros(6))) for finger in ("thumb", "first", "middle")}
    joints = builder.AddSystem(ConstantVectorSource(np.zeros(24)))
    camera = builder.AddSystem(ConstantValueSource(AbstractValue.Make(tp.PosePrior(RigidTransform()))))
    namespace: dict[str, object] = {
        "p_PC": contacts.p_PC,
        "n_PC": contacts.n_PC,
        "X_PO_camera": RigidTransform(),
        "builder": builder,
        "my_sensors": {finger: source.get_output_port() for finger, source in zero.items()},
        "my_joint_positions": joints.get_output_port(),
        "my_camera": camera.get_output_port(),
    }
    monkeypatch.setattr(tp.PoseEstimate, "show", lambda estimate: None)
    blocks = [text for language, text in FENCE.findall((ROOT / "README.md").read_text()) if language == "python"]
    for text in blocks:
        exec(compile(text, "README.md", "exec"), namespace)
    assert len(blocks) == 2
    assert Path("mug.png").stat().st_size > 0
    diagram = builder.Build()
    estimate = diagram.GetOutputPort("object_pose").Eval(diagram.CreateDefaultContext())
    assert isinstance(estimate, RigidTransform)


def commands_of(text: str) -> list[list[str]]:
    """The calls of `tactopose` in a page's shell blocks, as words."""
    lines = [line for block in re.findall(r"^```sh\n(.*?)^```$", text, re.M | re.S) for line in block.splitlines()]
    whole = re.sub(r"\\\n\s*", "", "\n".join(lines)).splitlines()
    words = [shlex.split(line, comments=True) for line in whole]
    return [line[1:] for line in words if line and Path(line[0]).name == "tactopose"]


COMMANDS = [
    (page, words)
    for page in [*PAGES, "README.md", "CONTRIBUTING.md"]
    for words in commands_of((ROOT / page).read_text())
]


NAMED = sorted(
    {
        (page, " ".join(name.split()))
        for page in [*PAGES, "README.md", "CONTRIBUTING.md", "CHANGELOG.md"]
        for name in re.findall(r"`tactopose\s([^`]+)`", (ROOT / page).read_text())
    }
)


def test_the_pages_name_commands() -> None:
    assert len(COMMANDS) > 5
    assert len(NAMED) > 20


@pytest.mark.parametrize(("page", "name"), NAMED, ids=[f"{page}:{name}" for page, name in NAMED])
def test_options_that_a_page_names_are_the_command_s(page: str, name: str) -> None:
    first, *rest = name.split()
    command = cli.get_command(click.Context(cli), first)
    assert command is not None, page
    known = {option for parameter in command.params for option in parameter.opts}
    assert {word.strip("[],") for word in rest if word.startswith(("-", "[-"))} <= known


@pytest.mark.parametrize(("page", "words"), COMMANDS, ids=[f"{page}:{' '.join(words)}" for page, words in COMMANDS])
def test_commands_that_a_page_names_can_be_typed(page: str, words: list[str]) -> None:
    if words[0].startswith("-"):
        return
    command = cli.get_command(click.Context(cli), words[0])
    assert command is not None, words
    # Its options and arguments are taken; nothing is run, and no file is opened.
    command.make_context(words[0], words[1:])
