"""Which files are read when one is."""

from pathlib import Path

from tactopose_drake.estimation.input_files import files_behind


def behind(path: Path) -> set[str]:
    return {str(found.resolve().relative_to(path.parent.resolve())) for found in files_behind(path)}


def write(folder: Path, **texts: str) -> None:
    """Files by their names, in which a dot is `_` and a slash `__`."""
    for name, text in texts.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


def test_names_are_followed_from_the_folder_of_who_names_them(tmp_path: Path) -> None:
    write(
        tmp_path,
        scene_yaml="hand: hands/own.yaml\nobject: things/mug.sdf\ngrip: {things/mug.sdf: {}}",
        hands__own_yaml="model: own.urdf\npads: [{array: pad.yaml}]\ncalibration: found.yaml\nname: absent",
        hands__own_urdf="<robot><mesh filename='tip.stl'/><mesh filename='package://other/tip.stl'/></robot>",
        hands__pad_yaml="period: 0.02",
        hands__found_yaml="hand: own.yaml",
        hands__tip_stl="solid",
        things__mug_sdf='<sdf><uri> parts.gltf </uri><mesh meshdir="deep" file="cup.obj"/></sdf>',
        things__mug_obj="v 0 0 0",
        things__parts_gltf='{"buffers": [{"uri": "parts.bin"}]}',
        things__parts_bin="0",
        things__other_obj="v 0 0 0",
    )
    (tmp_path / "things" / "deep").mkdir()
    (tmp_path / "things" / "deep" / "cup.obj").write_text("v 0 0 0")
    hand = {f"hands/{name}" for name in ("own.yaml", "own.urdf", "pad.yaml", "found.yaml", "tip.stl")}
    things = {f"things/{name}" for name in ("mug.sdf", "mug.obj", "parts.gltf", "parts.bin", "deep/cup.obj")}
    assert behind(tmp_path / "scene.yaml") == {"scene.yaml"} | hand | things


def test_of_a_folder_a_recording_is_all_of_it_and_others_are_their_tables(tmp_path: Path) -> None:
    write(
        tmp_path,
        played_yaml="senses: {folder: recording}",
        wired_yaml="senses: {simulated: {folder: .}, palm: arm.csv}",
        packed_yaml="packages: [{name: x, distribution: y, folder: .}]",
        recording__manifest_yaml="scenario: {hand: ../own.yaml}",
        own_yaml="model: none",
        arm_csv="time",
        thumb_csv="time",
        page_html="<html>",
    )
    assert behind(tmp_path / "played.yaml") == {"played.yaml", "recording", "recording/manifest.yaml", "own.yaml"}
    assert behind(tmp_path / "wired.yaml") == {"wired.yaml", "arm.csv", "thumb.csv"}
    assert behind(tmp_path / "packed.yaml") == {"packed.yaml"}


def test_what_cannot_be_read_names_nothing(tmp_path: Path) -> None:
    (tmp_path / "raw.yaml").write_bytes(b"\xff\xfe")
    (tmp_path / "open.yaml").write_text("[raw.yaml")
    for name in ("raw.yaml", "open.yaml", "absent.yaml", "x" * 300):
        assert list(files_behind(tmp_path / name)) == [tmp_path / name]
