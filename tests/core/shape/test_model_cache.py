import gc
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from tactopose_drake.core.shape import model_cache
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.errors import InvalidInputError

KEY = "0123456789abcdef"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "cache" / "models"
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(path))
    return path


def some_arrays(seed: int = 0) -> Arrays:
    generator = np.random.default_rng(seed)
    return {
        "scalar": np.array(generator.normal()),
        "empty": np.empty((0, 3)),
        "bytes": generator.integers(0, 256, 5, dtype=np.uint8),
        "faces": generator.integers(0, 100, (7, 3), dtype=np.int32),
        "grid": generator.normal(size=(5, 4, 3, 4)).astype(np.float32),
    }


def assert_same(found: Arrays | None, expected: Arrays) -> None:
    assert found is not None
    assert list(found) == list(expected)
    for name, array in expected.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def the_file(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_arrays_come_back_as_they_were(folder: Path) -> None:
    assert model_cache.load(KEY) is None
    model_cache.store(KEY, some_arrays())
    found = model_cache.load(KEY)
    assert_same(found, some_arrays())
    assert found is not None
    for array in found.values():
        assert type(array) is np.ndarray
        assert array.flags.aligned
        assert array.flags.c_contiguous
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True
    assert model_cache.load("another") is None
    assert the_file(folder).suffix == ".npy"


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="/proc says what a process holds")
def test_a_file_is_mapped_while_an_array_views_it_and_never_kept_open(folder: Path) -> None:
    model_cache.store(KEY, some_arrays())
    path = the_file(folder)

    def holders() -> tuple[bool, bool]:
        """Whether the file is open, and whether it is mapped."""
        descriptors = [link for link in Path("/proc/self/fd").iterdir() if link.exists()]
        return path in (link.resolve() for link in descriptors), str(path) in Path("/proc/self/maps").read_text()

    found = model_cache.load(KEY)
    assert found is not None
    grid = found["grid"][1:]
    assert holders() == (False, True)
    del found
    gc.collect()
    assert holders() == (False, True)
    np.testing.assert_array_equal(grid, some_arrays()["grid"][1:])
    del grid
    gc.collect()
    assert holders() == (False, False)


def test_a_later_store_replaces_an_earlier_one() -> None:
    model_cache.store(KEY, some_arrays(0))
    kept = model_cache.load(KEY)
    model_cache.store(KEY, some_arrays(1))
    assert_same(model_cache.load(KEY), some_arrays(1))
    assert_same(kept, some_arrays(0))  # whoever holds the old arrays keeps them


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_truncated_files_are_as_good_as_missing(folder: Path, share: float) -> None:
    model_cache.store(KEY, some_arrays())
    path = the_file(folder)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert model_cache.load(KEY) is None
    model_cache.store(KEY, some_arrays())
    assert_same(model_cache.load(KEY), some_arrays())


@pytest.mark.parametrize("place", [3, 12, 40, 75, 120, -70, -200, -500])
def test_damaged_files_are_as_good_as_missing(folder: Path, place: int) -> None:
    model_cache.store(KEY, some_arrays())
    path = the_file(folder)
    content = bytearray(path.read_bytes())
    content[place] ^= 0x10
    path.write_bytes(content)
    assert model_cache.load(KEY) is None


def test_blocks_that_changed_places_are_noticed(folder: Path) -> None:
    arrays = {"grid": np.random.default_rng(0).normal(size=(100, 4)).astype(np.float32)}
    model_cache.store(KEY, arrays)
    path = the_file(folder)
    content = path.read_bytes()
    for a, b in [(0, 8), (0, 64), (800, 1592), (64, 1528)]:
        swapped = bytearray(content)
        start = len(content) - 1600
        swapped[start + a : start + a + 8] = content[start + b : start + b + 8]
        swapped[start + b : start + b + 8] = content[start + a : start + a + 8]
        path.write_bytes(swapped)
        assert model_cache.load(KEY) is None
    path.write_bytes(content)
    assert_same(model_cache.load(KEY), arrays)


def test_files_that_changed_places_are_noticed(folder: Path) -> None:
    model_cache.store(KEY, some_arrays())
    the_file(folder).rename(folder / "other.npy")
    assert model_cache.load("other") is None


def test_damaged_headers_do_not_warn(folder: Path) -> None:
    model_cache.store(KEY, some_arrays())
    path = the_file(folder)
    content = path.read_bytes()
    for place in range(10, 128):
        for byte in b"\\0L(":
            damaged = bytearray(content)
            damaged[place] = byte
            path.write_bytes(damaged)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                found = model_cache.load(KEY)
                if found is not None:  # as where "32L", which an old numpy wrote, means 32
                    assert_same(found, some_arrays())


@pytest.mark.parametrize("folder_name", ["~nobody-of-this-name/cache", "/proc/cannot/be/made"])
def test_a_folder_that_cannot_be_is_no_error(folder_name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, folder_name)
    model_cache.store(KEY, some_arrays())
    assert model_cache.load(KEY) is None


def test_files_of_other_content_are_as_good_as_missing(folder: Path) -> None:
    folder.mkdir(parents=True)
    path = folder / f"{KEY}.npy"
    np.save(path, np.arange(10.0))
    assert model_cache.load(KEY) is None
    path.write_bytes(b"what is this")
    assert model_cache.load(KEY) is None
    path.unlink()
    path.mkdir()
    assert model_cache.load(KEY) is None
    model_cache.store(KEY, some_arrays())  # cannot replace a folder, and says nothing


class Trap:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path("sprung"),)


def test_nothing_is_unpickled(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder.mkdir(parents=True)
    path = folder / f"{KEY}.npy"
    for content in (pickle.dumps(Trap()), None):
        if content is None:
            np.save(path, np.array([Trap()], dtype=object), allow_pickle=True)
        else:
            path.write_bytes(content)
        assert model_cache.load(KEY) is None
        assert not Path("sprung").exists()
    with pytest.raises(TypeError, match="array of references"):
        model_cache.store(KEY, {"trap": np.array([Trap()], dtype=object)})


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(model_cache.FOLDER_VARIABLE, str(tmp_path / "file" / "below"))
    model_cache.store(KEY, some_arrays())
    assert model_cache.load(KEY) is None


def test_a_full_disk_is_no_error_and_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "save", fail)
    model_cache.store(KEY, some_arrays())
    assert list(folder.iterdir()) == []


def test_without_a_choice_the_user_s_cache_folder_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(model_cache.FOLDER_VARIABLE)
    assert "tactopose_drake" in model_cache.cache_folder().parts


def test_the_least_recently_used_files_go_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model_cache.store("size", some_arrays())
    size = the_file(folder).stat().st_size
    monkeypatch.setenv(model_cache.LIMIT_VARIABLE, str(3 * size / 1e9))
    clock = iter(range(100))
    utime = model_cache.os.utime
    monkeypatch.setattr(model_cache.os, "utime", lambda path: utime(path, (next(clock),) * 2))
    for key in ("a", "b"):
        model_cache.store(key, some_arrays())
        model_cache.load(key)
    model_cache.load("size")
    model_cache.store("c", some_arrays())  # "a" was used longest ago
    assert sorted(path.stem for path in folder.iterdir()) == ["b", "c", "size"]


def test_what_is_larger_than_the_limit_is_not_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model_cache.store("first", some_arrays())
    monkeypatch.setenv(model_cache.LIMIT_VARIABLE, "0")
    model_cache.store(KEY, some_arrays())
    assert model_cache.load(KEY) is None
    assert the_file(folder).stem == "first"


def test_the_limit_is_two_gigabytes_or_what_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(model_cache.LIMIT_VARIABLE, raising=False)
    assert model_cache.cache_limit() == 2e9
    monkeypatch.setenv(model_cache.LIMIT_VARIABLE, "0.5")
    assert model_cache.cache_limit() == 5e8
    for wrong in ("much", "-1", "nan"):
        monkeypatch.setenv(model_cache.LIMIT_VARIABLE, wrong)
        with pytest.raises(InvalidInputError, match=r"TACTOPOSE_CACHE_GB must be a number of gigabytes >= 0, not '.*'"):
            model_cache.cache_limit()


def test_clearing_removes_what_is_kept_and_nothing_else(folder: Path) -> None:
    assert model_cache.cached_files() == []
    assert model_cache.clear() == 0
    for key in ("a", "b"):
        model_cache.store(key, some_arrays())
    (folder / "left.tmp").write_bytes(b"of a process that was killed")
    (folder / "notes.txt").touch()
    (folder / "grasps").mkdir()
    kept = model_cache.load("a")
    size = sum(file.size for file in model_cache.cached_files())
    assert model_cache.clear() == size > 28
    assert sorted(path.name for path in folder.iterdir()) == ["grasps", "notes.txt"]
    assert_same(kept, some_arrays())  # in memory still


def test_keys_differ_by_every_part_and_by_where_parts_end(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = np.arange(3.0), np.arange(4)
    keys = [
        model_cache.content_key(*parts)
        for parts in [(a, b), (b, a), (a, b, "x"), (a, b, "y"), ("ab", "c"), ("a", "bc"), (b"abc",), ()]
    ]
    assert len(set(keys)) == len(keys)
    assert model_cache.content_key(a, b) == keys[0]
    monkeypatch.setattr(model_cache, "FORMAT_VERSION", -1)
    assert model_cache.content_key(a, b) != keys[0]


WRITER = """
import sys
import numpy as np
from tactopose_drake.core.shape import model_cache
value = int(sys.argv[1])
arrays = {"a": np.full(300_000, value), "b": np.full(1000, value)}
print("ready", flush=True)
sys.stdin.readline()
bad = 0
for _ in range(60):
    model_cache.store("shared", arrays)
    found = model_cache.load("shared")
    bad += found is None or found["a"].min() != found["a"].max() or found["b"][0] != found["a"][0]
print(bad)
"""


def test_processes_that_write_at_once_never_see_half_a_file(folder: Path) -> None:
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, str(value)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for value in (1, 2)
    ]
    for writer in writers:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write("go\n")
        writer.stdin.flush()
    assert [writer.communicate(timeout=60)[0].strip() for writer in writers] == ["0", "0"]
    assert the_file(folder).stem == "shared"
    found = model_cache.load("shared")
    assert found is not None
    assert found["a"][0] in (1, 2)
