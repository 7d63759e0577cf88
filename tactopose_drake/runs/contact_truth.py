"""Where the simulator itself says that fingertips and pads touch, to judge what was estimated from the senses."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import ContactSurface, GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Body
from pydrake.systems.framework import Context

from tactopose_drake.core.validation import FloatArray
from tactopose_drake.hand.hand_config import Hand


@dataclass(frozen=True, eq=False)
class PartContact:
    """The contact patch between one fingertip or pad and the object.

    Attributes:
        p_PC: centre of pressure in the palm, shape (3,), m.
        n_PC: the patch's mean normal, weighted by pressure, out of the object, shape (3,).
        f_PC: force of the object on the fingertip or pad, shape (3,), N.
        area: of the patch, m^2.
    """

    p_PC: FloatArray
    n_PC: FloatArray
    f_PC: FloatArray
    area: float


@dataclass(frozen=True, eq=False)
class ContactTruth:
    """All contacts between hand and object at one instant.

    Attributes:
        tips: by finger, the fingertips with a force-torque sensor that touch.
        pads: by pad, the tactile pads that touch.
        other_contacts: names of other links that touch the object.
    """

    tips: dict[str, PartContact]
    pads: dict[str, PartContact]
    other_contacts: tuple[str, ...]


def contact_truth(plant: MultibodyPlant, plant_context: Context, hand: Hand, object_body: Body) -> ContactTruth:
    """Reads the contact results of a hydroelastic simulation.

    Args:
        plant: finalized plant in a diagram, `use_sampled_output_ports` False or at least one step taken.
        plant_context: its context in that diagram's.
        hand: the hand in the plant.
        object_body: the object.
    """
    inspector = plant.get_geometry_query_input_port().Eval(plant_context).inspector()
    finger_of_tip = {weld.child_body().index(): finger for finger, weld in hand.welds.items()}
    pad_of_body = {frame.body().index(): pad for pad, frame in hand.pad_frames.items()}
    results = plant.get_contact_results_output_port().Eval(plant_context)
    X_PW = hand.palm_frame.CalcPoseInWorld(plant_context).inverse()

    def body_of(geometry: GeometryId) -> Body:
        return plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))

    tips: dict[str, PartContact] = {}
    pads: dict[str, PartContact] = {}
    others: list[str] = []
    for i in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(i)
        surface: ContactSurface = info.contact_surface()
        body_M, body_N = body_of(surface.id_M()), body_of(surface.id_N())
        if object_body.index() not in (body_M.index(), body_N.index()):
            continue
        object_is_M = body_M.index() == object_body.index()
        partner = body_N if object_is_M else body_M
        finger, pad = finger_of_tip.get(partner.index()), pad_of_body.get(partner.index())
        if finger is None and pad is None:
            others.append(partner.name())
            continue
        p_WC, n_W = _center_of_pressure(surface)
        # The patch's normals point out of N into M; its force acts on M.
        side = -1.0 if object_is_M else 1.0
        f_W = side * info.F_Ac_W().translational()
        rotate = X_PW.rotation()
        contact = PartContact(X_PW @ p_WC, rotate @ (side * n_W), rotate @ f_W, float(surface.total_area()))
        if finger is not None:
            tips[finger] = contact
        if pad is not None:
            pads[pad] = contact
    for i in range(results.num_point_pair_contacts()):
        point = results.point_pair_contact_info(i)
        pair = (point.bodyA_index(), point.bodyB_index())
        if object_body.index() in pair:
            partner_index = pair[0] if pair[1] == object_body.index() else pair[1]
            others.append(plant.get_body(partner_index).name())
    return ContactTruth(tips, pads, tuple(others))


def _center_of_pressure(surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
    """Centre of pressure and mean normal of a patch, both weighted by pressure times area."""
    if surface.is_triangle():
        mesh, field = surface.tri_mesh_W(), surface.tri_e_MN()
    else:
        mesh, field = surface.poly_mesh_W(), surface.poly_e_MN()
    faces = range(surface.num_faces())
    centroids = np.array([mesh.element_centroid(face) for face in faces])
    pressure = np.array([field.EvaluateCartesian(face, centroids[face]) for face in faces])
    weight = pressure * np.array([surface.area(face) for face in faces])
    normal = weight @ np.array([surface.face_normal(face) for face in faces])
    return weight @ centroids / weight.sum(), normal / np.linalg.norm(normal)
