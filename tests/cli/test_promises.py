"""What the command line promises whatever it is given: exit status, one line, no destroyed file, no open door."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from pydrake.geometry import Meshcat
from rich.table import Table

from tactopose_drake.cli.consoles import PlainConsole, printable, reporting
from tactopose_drake.cli.demo_run import DemoResult, GraspFailedError
from tactopose_drake.cli.replay_command import _written
from tactopose_drake.errors import InvalidFileError
from tactopose_drake.estimation.output_files import check_outputs, written_beside
from tactopose_drake.resources import model_path
from tactopose_drake.runs.manifest import Manifest
from tactopose_drake.runs.scenario_replay import Replay
from tactopose_drake.runs.stepping import RunView
from tactopose_drake.station.scenario import load_scenario
from tests.cli.test_cli import run
from tests.listening import IS_KNOWN, Watch

FULL = Path("/dev/full")  # Linux' own: every write finds no space left
START = "from tactopose_drake.cli.entry import start; print('begin', flush=True); start()"
CONTACTS = "contacts: [{position: [0, 0, 0.02]}, {position: [0.02, 0, 0]}, {position: [0, 0.02, 0]}]"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """An object and contacts."""
    (tmp_path / "cube.obj").write_bytes(model_path("objects", "cube.obj").read_bytes())
    (tmp_path / "contacts.yaml").write_text(CONTACTS)
    return tmp_path


def inputs(files: Path) -> list[object]:
    return ["--object", files / "cube.obj", "--contacts", files / "contacts.yaml"]


def test_an_output_never_destroys_an_input(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.link(files / "contacts.yaml", files / "link.yaml")
    (files / "symlink.yaml").symlink_to(files / "contacts.yaml")
    (files / "circle").symlink_to(files / "circle")
    for options, message in (
        (["--out", files / "contacts.yaml"], "must be another file than an input, and not in one"),
        (["--out", files / "link.yaml"], "must be another file than an input, and not in one"),
        (["--html", files / "symlink.yaml"], "must be another file than an input, and not in one"),
        (["--html", files / "cube.obj"], "must be another file than an input, and not in one"),
        (["--out", files / "x", "--html", files / "x"], "must be given for one output, not for two"),
        (
            ["--out", files / "x", "--html", files / ".." / files.name / "x"],
            "must be given for one output, not for two",
        ),
        (["--out", files], "must be a file, which may be new, not a folder"),
        (["--out", files / "absent" / "x"], "does not exist"),
        (["--out", "/proc/x"], "cannot be written"),
        (["--out", files / ("x" * 300)], "cannot be used (File name too long)"),
        (["--out", files / "circle"], "cannot be used ("),
    ):
        assert run("estimate", *inputs(files), *options) == 2
        errors = capsys.readouterr().err
        assert message in errors
        assert errors.count("\n") == 1
    assert (files / "contacts.yaml").read_text() == CONTACTS
    assert (files / "cube.obj").read_bytes() == model_path("objects", "cube.obj").read_bytes()
    assert sorted(os.listdir(files)) == ["circle", "contacts.yaml", "cube.obj", "link.yaml", "symlink.yaml"]


def test_a_disk_without_room_for_a_result_is_told_before_the_work(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=60_000))
    for option in ("--out", "--html"):
        assert run("estimate", *inputs(files), option, files / "result") == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert "result: its disk must have at least 5 MB left, not 0.1 MB" in " ".join(printed.err.split())
    assert not (files / "result").exists()


def test_a_run_writes_no_page_into_its_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--html", "--picture"):
        assert run("run", "shadow_like", "--record", tmp_path / "rec", option, tmp_path / "rec" / "page") == 2
        told = " ".join(capsys.readouterr().err.split())
        assert "as a recording's folder holds nothing else." in told
        assert "an input" not in told


def test_a_replay_writes_nothing_into_its_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rec").mkdir()
    (tmp_path / "rec" / "signals.jsonl").write_text("precious\n")
    (tmp_path / "own.scenario.yaml").write_text("object: cube\n")
    arguments = ["replay", tmp_path / "rec", "--scenario", tmp_path / "own.scenario.yaml", "--out"]
    for out in (tmp_path / "rec" / "signals.jsonl", tmp_path / "rec" / "new.jsonl", tmp_path / "own.scenario.yaml"):
        assert run(*arguments, out) == 2
        assert "must be another file than an input, and not in one" in capsys.readouterr().err
    assert (tmp_path / "rec" / "signals.jsonl").read_text() == "precious\n"
    assert os.listdir(tmp_path / "rec") == ["signals.jsonl"]


def test_what_was_there_stays_until_all_is_written(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("old")

    def fail() -> None:
        with written_beside(path) as beside:
            beside.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(InvalidFileError, match=r"result.json cannot be written \(No space left on device\)"):
        fail()
    assert path.read_text() == "old"
    with written_beside(path) as beside:
        beside.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["result.json"]
    check_outputs([Path("/dev/null")])
    with written_beside(Path("/dev/null")) as beside:
        beside.write_text("into the void")
    assert Path("/dev/null").is_char_device()


def test_a_pipe_without_a_path_of_its_own_can_be_written() -> None:
    reading, writing = os.pipe()
    path = Path(f"/dev/fd/{writing}")  # as of `--out /dev/stdout | jq .` and `--out >(jq .)`
    check_outputs([path])
    with pytest.raises(InvalidFileError, match=f"{path} must be given for one output, not for two"):
        check_outputs([path, path])
    with written_beside(path) as beside:
        beside.write_text("through it")
    os.close(writing)
    with open(reading) as read:
        assert read.read() == "through it"


def test_threads_write_one_file_each_by_itself(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    both = threading.Barrier(2, timeout=60)

    def write(text: str) -> None:
        with written_beside(path) as beside:
            both.wait()
            beside.write_text(text)
            both.wait()
            assert beside.read_text() == text

    with ThreadPoolExecutor(2) as executor:
        list(executor.map(write, ("one", "two")))
    assert path.read_text() in ("one", "two")
    assert os.listdir(tmp_path) == ["result.json"]


def test_a_long_name_of_wide_characters_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("\u6587" * 83)
    with written_beside(path) as beside:
        beside.write_text("new")
    assert path.read_text() == "new"


@pytest.mark.skipif(not FULL.exists(), reason="the system has no device that is always full")
def test_a_replay_that_cannot_be_written_names_its_file_once() -> None:
    def fail() -> None:
        with _written(FULL) as writer:
            writer.file.write("{}")

    with pytest.raises(InvalidFileError, match=r"^/dev/full cannot be written \(No space left on device\)\.$"):
        fail()


@pytest.mark.skipif(not FULL.exists(), reason="the system has no device that is always full")
def test_a_full_standard_output_is_named_and_results_are_written(files: Path) -> None:
    code = "from tactopose_drake.cli.entry import start; start()"
    call = [sys.executable, "-c", code, "estimate", *map(str, inputs(files)), "--out", str(files / "result.json")]
    with FULL.open("w") as full:
        done = subprocess.run(call, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert "error: standard output cannot be written (No space left on device).\n" in done.stderr
    assert (files / "result.json").is_file()


class Station:
    """All of whose ports give the estimate."""

    def __init__(self, estimate: object) -> None:
        self.estimate = estimate

    def HasOutputPort(self, name: str) -> bool:
        return not name.startswith("tracked_")

    def GetOutputPort(self, name: str) -> "Station":
        return self

    def Eval(self, context: object) -> object:
        return self.estimate

    def get_time(self) -> float:
        return 0.3


def end_with(estimate: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets runs and replays end at once, with an estimate or None."""
    view = RunView(Station(estimate), Station(estimate))
    monkeypatch.setattr("tactopose_drake.cli.run_command.run_scenario", lambda *_, **__: view)
    played = Replay(view, ("fingers.blf ended after 3 frames.",), whole=True, difference="")
    monkeypatch.setattr("tactopose_drake.cli.replay_command.replay_recording", lambda *_, **__: played)
    manifest = Manifest(scenario=load_scenario("shadow_like"))
    monkeypatch.setattr("tactopose_drake.cli.replay_command.load_manifest", lambda _: manifest)
    monkeypatch.setattr("tactopose_drake.cli.run_command.estimate_line", lambda _: "held: 0 contacts")


COMMANDS = {
    "run": ("run", "shadow_like", "--duration", "0.3"),
    "replay": ("replay", "log", "--scenario", "shadow_like"),
}


@pytest.mark.parametrize(
    ("estimate", "status"),
    [(None, 1), (SimpleNamespace(status="no_solution"), 1), (SimpleNamespace(status="ambiguous"), 0)],
)
@pytest.mark.parametrize("command", COMMANDS)
def test_the_exit_status_says_whether_there_is_an_estimate(
    monkeypatch: pytest.MonkeyPatch, command: str, estimate: object, status: int
) -> None:
    end_with(estimate, monkeypatch)
    assert run(*COMMANDS[command]) == status


@pytest.mark.parametrize(("command", "other"), [("run", "--picture"), ("replay", "--out")])
def test_only_what_is_written_is_said_to_replace_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str, other: str
) -> None:
    end_with(None, monkeypatch)
    page, beside = tmp_path / "page.html", tmp_path / "beside"
    page.write_text("old")
    beside.write_text("old")
    assert run(*COMMANDS[command], "--html", page, other, beside) == 1
    printed = capsys.readouterr().out
    assert f"{page} is not written, since there was no estimate." in printed
    assert page.read_text() == "old"
    assert ("Replaced" in printed) == (other == "--out")
    assert printed.count(str(page)) == 1


def test_help_and_version_end_well(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    assert run("--version") == 0
    assert run("estimate", "--help") == 0
    assert "Estimates the pose" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["[/x]", "[red]", ":smile:", "a\x1b[31mb", "a\nb", "\udcff"])
def test_names_are_neither_markup_nor_commands(
    files: Path, name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run("estimate", "--object", files / name, "--contacts", files / "contacts.yaml") == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert "\x1b" not in errors
    assert printable(" ".join(name.split())) in errors


def test_a_console_prints_text_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    console = PlainConsole(width=100)
    table = Table(title="[/title] \x1b]0;owned\x07")
    table.add_column("[/x]")
    table.add_row("[/row] :smile:")
    console.print(table)
    console.print("Written: [/x] \x1b[2J")
    with console.status("[/status]") as status:
        status.update("[/update] \x1b[2J")
    printed = capsys.readouterr().out
    assert "\x1b" not in printed
    for text in ("[/title]", "[/x]", "[/row] :smile:", r"Written: [/x] \x1b[2J"):
        assert text in printed


@pytest.mark.skipif(not IS_KNOWN, reason="the system does not tell who listens")
def test_meshcat_listens_on_this_machine_alone(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The others that the tests run are watched as well, by `run`."""
    watches: list[Watch] = []
    html = Meshcat.StaticHtml

    def look(self: Meshcat) -> str:
        watches[-1].look()
        return str(html(self))

    def demonstrate(*_: object, **__: object) -> DemoResult:
        watches[-1].look()
        raise GraspFailedError("of no interest here")

    monkeypatch.setattr(Meshcat, "StaticHtml", look)
    monkeypatch.setattr("tactopose_drake.cli.demo_command.run_demo", demonstrate)
    for status, command in (
        (0, ("estimate", *inputs(files), "--html", files / "scene.html")),
        (1, ("demo", "--out", files / "out")),
    ):
        watches.append(Watch())
        with watches[-1]:
            assert run(*command) == status
        assert watches[-1].opened
        assert not watches[-1].foreign


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("delay", [0.1, 1.0, 6.0])
def test_an_interrupt_is_one_line(files: Path, delay: float) -> None:
    command = [sys.executable, "-c", START, "run", "shadow_like"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "begin\n"
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert errors.count("\n") == 1
    assert "interrupted" in errors


@pytest.mark.parametrize(
    "arguments",
    [
        ("demo", "--out", ""),
        ("demo", "--hand", ""),
        ("estimate", "--object", "cube", "--contacts", ""),
        ("run", "shadow_like", "--record", ""),
        ("export", "", "--format", "csv"),
    ],
)
def test_an_empty_path_is_not_the_current_folder(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    errors = capsys.readouterr().err
    assert "not empty" in errors
    assert errors.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["estimate", "check-hand"])
def test_results_are_written_though_nobody_reads_what_is_printed(command: str, files: Path) -> None:
    out = files / "result"
    arguments = {"estimate": [*inputs(files), "--out", out], "check-hand": ["shadow_like", "--html", out]}[command]
    call = [sys.executable, "-c", START, command, *map(str, arguments)]
    process = subprocess.Popen(call, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"begin\n"
    process.stdout.close()
    assert process.wait(timeout=120) == 1
    assert out.is_file()


def test_characters_that_the_locale_lacks_are_printed_escaped(files: Path) -> None:
    call = [sys.executable, "-c", START, "estimate", *map(str, inputs(files))]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(call, capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert r"\xb1" in done.stdout  # Plus or minus, of the table's head.


def test_what_was_found_is_printed_though_it_cannot_be_written(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        with reporting((), "It is the mug."):
            raise InvalidFileError("result.json cannot be written.")

    with pytest.raises(InvalidFileError):
        fail()
    assert capsys.readouterr().out == "It is the mug.\n"
