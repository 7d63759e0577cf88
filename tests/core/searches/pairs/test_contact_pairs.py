import numpy as np
import trimesh

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.poses import make_poses, random_rotations
from tactopose_drake.core.searches.pairs.contact_pairs import PairChoice, spread_out
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.synthetic.synthetic_touch import touch_surface
from tests.core.models import brick


def choose(model: ObjectModel, touch: Contacts, /, **choice: int) -> list[tuple[int, int, int, int]]:
    pairs = PairChoice(**choice).choose(model.pair_features, touch, np.random.default_rng(0))
    counts = np.diff(pairs.begins)
    return [
        (int(first), int(second), int(count), int(spins))
        for (first, second), count, spins in zip(pairs.ends, counts, pairs.spins, strict=True)
    ]


def test_the_true_samples_are_among_the_matches(blob: ObjectModel) -> None:
    missed = 0
    for seed in range(30):
        generator = np.random.default_rng(seed)
        X_PO = make_poses(random_rotations(generator, 1), generator.normal(size=(1, 3)))[0]
        contacts = touch_surface(blob, X_PO, 2, generator)
        features = blob.pair_features
        p_OC = (contacts.p_PC - X_PO[:, 3]) @ X_PO[:, :3]
        pairs = PairChoice().choose(features, contacts, generator)
        assert len(pairs.ends) == 1
        samples = features.points[features.pairs[pairs.matches[: pairs.begins[1]]]]
        off = np.linalg.norm(samples - p_OC[pairs.ends[0]], axis=2).max(axis=1)
        missed += off.min() > 2 * features.spacing
    assert missed <= 1


def test_those_with_few_matches_come_first_and_no_more_than_there_is_room_for(blob: ObjectModel) -> None:
    contacts = touch_surface(blob, np.eye(3, 4), 6, np.random.default_rng(1))
    pairs = choose(blob, contacts, contacts=6, poses=10**7, pairs=15)
    counts = [count for _, _, count, _ in pairs]
    assert len(pairs) == 15
    assert len({(first, second) for first, second, *_ in pairs}) == 15
    # By a guess, so about in order.
    assert np.corrcoef(counts, np.argsort(np.argsort(counts)))[0, 1] > 0.5
    assert max(counts[:4]) < max(counts[-4:])
    few = choose(blob, contacts, poses=2000)
    assert sum(count * spins for *_, count, spins in few) <= 2000
    assert max(count for *_, count, _ in few) <= 500
    assert choose(blob, contacts, pairs=3) == choose(blob, contacts)[:3]


def test_contacts_that_coincide_or_lie_metres_apart_say_nothing(blob: ObjectModel) -> None:
    n_PC = np.eye(3)[:2]
    assert choose(blob, Contacts([[0, 0, 0], [1e-4, 0, 0]], n_PC)) == []
    assert choose(blob, Contacts([[0, 0, 0], [3.0, 0, 0]], n_PC)) == []
    assert choose(blob, Contacts([[0, 0, 0]], n_PC[:1])) == []


def test_two_contacts_have_a_direction_from_three_standard_deviations_of_their_distance_on() -> None:
    box, sigma = brick(0.06, 0.09, 0.13), np.array([0.0009, 0.0012])
    least = 3.0 * np.hypot(*sigma)
    for factor, is_asked in ((0.98, False), (1.02, True)):
        contacts = Contacts([[0, 0, 0], [factor * least, 0, 0]], [[0, 0, 1.0], [0, 0, 1.0]], sigma_position=sigma)
        assert bool(choose(box, contacts)) == is_asked


def test_of_more_matches_than_there_is_room_for_some_of_all_are_taken(blob: ObjectModel) -> None:
    """They come by their features, so the first would be alike."""
    features = blob.pair_features
    for seed in range(4):
        contacts = touch_surface(blob, np.eye(3, 4), 2, np.random.default_rng(seed))
        every = PairChoice(poses=10**7).choose(features, contacts, np.random.default_rng(0))
        count = int(every.begins[-1])
        for room in (int(0.55 * count), count // 5):
            few = PairChoice(poses=4 * room).choose(features, contacts, np.random.default_rng(0))
            taken = np.searchsorted(every.matches[:count], few.matches[: few.begins[-1]])
            assert np.all(np.diff(every.matches[:count]) > 0)
            assert 0.5 * room < len(taken) <= room
            assert taken.min() < 0.1 * count
            assert taken.max() > 0.9 * count
            assert np.all(np.diff(taken) > 0)


def test_opposite_normals_leave_the_spin_open(blob: ObjectModel) -> None:
    box = ObjectModel.from_mesh(trimesh.creation.box((0.06, 0.09, 0.14)).subdivide().subdivide())
    ((*_, spins),) = choose(box, Contacts([[0.03, 0, 0], [-0.03, 0, 0]], [[1, 0, 0], [-1, 0, 0]]))
    assert spins > 1
    ((*_, spins),) = choose(box, Contacts([[0.03, 0, 0.01], [-0.02, 0.045, 0]], [[1, 0, 0], [0, 1, 0]]))
    assert spins == 1
    ((*_, spins),) = choose(blob, Contacts([[0.03, 0, 0], [-0.01, 0, 0]]))
    assert spins > 1


def test_far_points_are_one_of_each_heap() -> None:
    generator = np.random.default_rng(0)
    heaps = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.08, 0.0], [0.0, 0.0, 0.06], [0.05, 0.05, 0.05]])
    points = np.concatenate([heap + 0.002 * generator.normal(size=(20, 3)) for heap in heaps])
    assert sorted(spread_out(points, 5) // 20) == [0, 1, 2, 3, 4]
    assert sorted(spread_out(points[:4], 30)) == [0, 1, 2, 3]


def test_contacts_are_taken_far_apart() -> None:
    points = np.array([[0, 0, 0], [0.1, 0, 0], [5, 0, 0], [5, 0.1, 0], [0, 3, 0]])
    assert set(spread_out(points, 3).tolist()) in ({0, 3, 4}, {1, 3, 4}, {0, 2, 4}, {1, 2, 4})
    assert sorted(spread_out(points, 9).tolist()) == [0, 1, 2, 3, 4]
    assert sorted(spread_out(np.zeros((4, 3)), 3).tolist()) != []
