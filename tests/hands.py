"""A hand small enough to know every number of: a palm, and a finger with one shape on a joint."""

from pathlib import Path

from tactopose_drake.hand.fingertip_surfaces import SphereSurface
from tactopose_drake.hand.hand_config import FingerConfig, HandConfig

_SDF = """<?xml version="1.0"?>
<sdf version="1.9"><model name="tiny">
  <link name="palm"/>
  <link name="finger"><pose relative_to="palm">{at}</pose>{collision}</link>
  <link name="tip"><pose relative_to="finger">0 0 0.2 0 0 0</pose></link>
  <joint name="slide" type="prismatic"><parent>palm</parent><child>finger</child><axis><xyz>0 0 1</xyz></axis></joint>
  <joint name="tip_weld" type="fixed"><parent>finger</parent><child>tip</child></joint>
</model></sdf>"""


def write_hand(folder: Path, geometry: str, at: str = "0 0 0 0 0 0") -> HandConfig:
    """A hand whose finger has one shape, `at` x y z roll pitch yaw in the palm, that a joint moves along the shape's z.

    Args:
        folder: receives the model.
        geometry: what stands within SDF's <geometry>; none without.
        at: pose of the finger.
    """
    collision = f'<collision name="shape"><geometry>{geometry}</geometry></collision>' if geometry else ""
    path = folder / "tiny.sdf"
    path.write_text(_SDF.format(at=at, collision=collision))
    finger = FingerConfig(
        name="finger", joints=["slide"], sensor_frame="finger", weld="tip_weld", surface=SphereSurface()
    )
    return HandConfig(model=str(path), base_link="palm", palm_frame="palm", fingers=[finger])
