import math
import re

import numpy as np
import pytest
import trimesh

import tactopose_drake as tp
from tactopose_drake.core.evidence import Evidence
from tactopose_drake.core.poses import make_poses
from tactopose_drake.core.searches import make_problem
from tactopose_drake.resources import model_path
from tests.examples.scripts import load_script, share_script

study, belief = load_script("false_contact_bound"), share_script("ideal_belief")
SLAB = np.array([0.2, 0.2, 0.02])  # extents, m


@pytest.fixture(scope="module")
def slab() -> tp.ObjectModel:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * SLAB
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return tp.ObjectModel.from_mesh(trimesh.Trimesh(corners, faces))


def test_a_displaced_contact_has_the_density_of_its_displacement(slab: tp.ObjectModel) -> None:
    surface, up = belief.Surface(slab), np.array([[0.0, 0.0, 1.0]])
    top = 0.5 * SLAB[2]
    heights = np.array([0.0, 0.020, 0.040])
    places = np.stack([np.zeros(3), np.zeros(3), top + heights], axis=1)
    density = surface.displaced(places, np.repeat(up, 3, axis=0))
    # Above a plane, the integral of 1 / (4 pi r^2) over it from r = max(h, LEAST) to MOST is log(MOST / r) / 2.
    near = np.log(belief.MOST / np.maximum(heights[:2], belief.LEAST)) / (2.0 * (belief.MOST - belief.LEAST))
    np.testing.assert_allclose(density[:2], math.sqrt(2.0 * np.pi) * belief.SIGMA_POSITION * near, rtol=0.25)
    assert density[2] == 0.0
    assert surface.displaced(places[:1], np.array([[0.6, 0.8, 0.0]]))[0] == 0.0


def test_the_less_a_displaced_contact_is_expected_the_less_a_pose_that_needs_it_is_believed(
    slab: tp.ObjectModel,
) -> None:
    surface, here = belief.Surface(slab), make_poses(np.eye(3)[None], np.zeros((1, 3)))
    places = np.array([[x, y, 0.5 * SLAB[2]] for x in (-0.05, 0.05) for y in (-0.05, 0.05)] + [[0.0, 0.0, 0.03]])
    contacts = tp.Contacts(places, np.repeat([[0.0, 0.0, 1.0]], 5, axis=0))
    problem = make_problem(slab, Evidence(contacts))
    likely, unlikely = (belief.ExactCost(surface, contacts, problem, share)(here)[0] for share in (0.68, 0.23))
    assert unlikely - likely == pytest.approx(math.log(belief.odds(0.68, 5) / belief.odds(0.23, 5)), abs=1e-6)


def test_who_knows_that_a_contact_is_displaced_believes_in_the_truth() -> None:
    surface = belief.Surface(tp.ObjectModel.from_mesh(model_path("objects", "bust.obj")))
    for seed in range(3):
        package, ideal = study.run_trial(surface, seed, True, [1.0], False)
        assert package.of_package > 0.0
        assert ideal.of_truth > 0.01


def test_the_ideal_answers_are_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--trials", "2", "--objects", "cube", "mug", "--probabilities", "1", "0.5"]
    monkeypatch.setattr("sys.argv", ["false_contact_bound.py", *options])
    study.main()
    printed = capsys.readouterr().out
    assert len(re.findall(r"the package +right +[0-9.]+%, sure and wrong +\d of +\d", printed)) == 2
    assert len(re.findall(r"ideal, believes in (100|50)% +right +[0-9.]+%, sure and wrong +\d of +\d", printed)) == 4


def test_where_the_package_is_right_the_ideal_need_not_answer() -> None:
    surface = belief.Surface(tp.ObjectModel.from_mesh(model_path("objects", "cube.obj")))
    answers = study.run_trial(surface, 0, True, [1.0], True)
    assert not answers[0].beyond
    assert len(answers) == 1
