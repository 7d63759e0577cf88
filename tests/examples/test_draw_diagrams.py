import itertools
import re
import runpy
import sys
from pathlib import Path

import pytest

from tactopose_drake.resources import resource_root

SCRIPT = Path(__file__).parents[2] / "examples" / "draw_diagrams.py"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the script has drawn into."""
    folder = tmp_path_factory.mktemp("drawn") / "pictures"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [str(SCRIPT), str(folder)])
        runpy.run_path(str(SCRIPT), run_name="__main__")
    return folder


def words(picture: Path) -> list[str]:
    return sorted(re.findall(r"<text[^>]*>([^<]*)</text>", picture.read_text()))


def arrows(picture: Path) -> list[str]:
    return sorted(re.findall(r"<title>([^<]*&#45;&gt;[^<]*)</title>", picture.read_text()))


@pytest.mark.parametrize(
    "name", ["pose_estimation", "station", "pose_estimation_barrett", "station_barrett", "control_stack"]
)
def test_the_pictures_in_the_documentation_are_up_to_date(drawn: Path, name: str) -> None:
    committed = resource_root() / "docs" / "pictures" / f"{name}.svg"
    assert words(drawn / f"{name}.svg") == words(committed)
    assert arrows(drawn / f"{name}.svg") == arrows(committed)


def test_the_pictures_show_what_goes_in_and_comes_out(drawn: Path) -> None:
    shown = words(drawn / "pose_estimation.svg")
    # Once as a port of the diagram, and once as a port of each system that it leads to.
    systems = {"wrench_&lt;finger&gt;": 1, "joint_positions": 3, "prior": 1, "object_pose": 1, "hypotheses": 1}
    for port, count in systems.items():
        assert shown.count(port) == 1 + count, port


def test_what_there_is_for_each_pad_is_drawn_once(drawn: Path) -> None:
    shown = words(drawn / "station_barrett.svg")
    # The station's port, the estimation's; the array is a system.
    assert shown.count("pressures_&lt;pad&gt;") == 2
    assert shown.count("tactile_array_&lt;pad&gt;") == 1
    assert not {f"pressures_{pad}" for pad in ("finger_1", "palm")} & set(shown)
    assert "contacts_in_palm" in words(drawn / "pose_estimation_barrett.svg")


def test_the_control_stack_is_one_loop_from_sensing_to_decision(drawn: Path) -> None:
    """Figure 6.5 of the thesis: what is sensed, predicted and believed leads to what hand and arm do, and back."""
    shown = words(drawn / "control_stack.svg")
    assert {"Sensing", "Prediction", "Update", "Decision"} <= set(shown)
    assert "pose_tracking" not in shown, "it is opened up"
    systems = {
        tuple(re.sub(r":.*", "", end) for end in arrow.split("&#45;&gt;"))
        for arrow in arrows(drawn / "control_stack.svg")
    }
    loop = ("plant", "sensor_&lt;finger&gt;", "contact_solver", "contacts_in_palm", "pose_belief", "place_task")
    assert {*itertools.pairwise(loop)} <= systems
    assert {("joint_positions", "fingertip_velocities"), ("fingertip_velocities", "pose_belief")} <= systems
    assert {("vision", "pose_belief"), ("place_task", "arm_controller"), ("arm_controller", "plant")} <= systems


def test_the_pictures_leave_out_noise_and_the_scene_graph(drawn: Path) -> None:
    shown = words(drawn / "station.svg")
    assert "MultibodyPlant" in shown
    assert not {"RandomSource", "SceneGraph", "noise", "query"} & set(shown)


def test_without_pygraphviz_it_says_what_to_install() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "pygraphviz", None)
        patch.setattr(sys, "argv", [str(SCRIPT)])
        with pytest.raises(SystemExit, match="pip install pygraphviz"):
            runpy.run_path(str(SCRIPT), run_name="__main__")
