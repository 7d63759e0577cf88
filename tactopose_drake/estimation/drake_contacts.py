"""Conversion of the contacts that Drake's simulator reports into `Contacts`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from tactopose_drake.core.evidence import contacts as core_contacts
from tactopose_drake.core.validation import FloatArray, instance_of

# Imported only where they are used: an estimate from given contacts needs neither plants nor systems, and importing
# them would take more time and memory than the estimate.
if TYPE_CHECKING:
    from pydrake.geometry import ContactSurface
    from pydrake.multibody.plant import ContactResults, MultibodyPlant
    from pydrake.multibody.tree import Frame, RigidBody
    from pydrake.systems.framework import Context


class ReportedContact(NamedTuple):
    """A contact of an object with one body, in the world.

    Attributes:
        partner: index of the other body.
        p_WC: centre of pressure, shape (3,), m.
        n_W: outward normal of the object, shape (3,).
        f_W: force of the object on the other body, shape (3,), N.
        surface: the contact surface of a hydroelastic contact; None for a point contact.
    """

    partner: int
    p_WC: FloatArray
    n_W: FloatArray
    f_W: FloatArray
    surface: ContactSurface | None


class Contacts(core_contacts.Contacts):
    __doc__ = core_contacts.Contacts.__doc__  # The same class, plus a constructor from a simulation's contacts.

    @classmethod
    def from_contact_results(
        cls,
        results: ContactResults,
        plant: MultibodyPlant,
        context: Context,
        palm_frame: Frame,
        object_body: RigidBody,
        *,
        sigma_position: float = 0.0009,
    ) -> Self:
        """The true contacts of an object with the palm's model instance, as ideal tactile sensors would report them.

        A hydroelastic patch becomes one contact at its centre of pressure; point contacts are taken as they are.

        Args:
            results: value of the plant's port `contact_results`.
            plant: finalized plant in a diagram with a SceneGraph.
            context: the plant's context in that diagram.
            palm_frame: P; contacts with bodies of its model instance count.
            object_body: the object.
            sigma_position: standard deviation that the estimate is to assume, m.

        Raises:
            InvalidInputError: if an argument has a wrong type.
        """
        from pydrake.multibody.plant import ContactResults, MultibodyPlant
        from pydrake.multibody.tree import Frame, RigidBody
        from pydrake.systems.framework import Context

        kinds = {"results": ContactResults, "plant": MultibodyPlant, "context": Context, "palm_frame": Frame}
        for (name, kind), value in zip(kinds.items(), (results, plant, context, palm_frame), strict=True):
            instance_of(name, value, kind)
        instance_of("object_body", object_body, RigidBody)
        hand = {int(index) for index in plant.GetBodyIndices(palm_frame.model_instance())}
        reported = [
            contact
            for contact in reported_contacts(results, plant, context, object_body)
            if contact.partner in hand and np.linalg.norm(contact.n_W) > 0.0
        ]
        if not reported:
            return cls.empty()
        X_PW = palm_frame.CalcPoseInWorld(context).inverse()
        p_W, n_W, f_W = (np.array([getattr(contact, name) for contact in reported]) for name in ("p_WC", "n_W", "f_W"))
        R_PW = X_PW.rotation().matrix()
        return cls(X_PW.multiply(p_W.T).T, n_W @ R_PW.T, f_W @ R_PW.T, sigma_position=sigma_position)


def reported_contacts(
    results: ContactResults, plant: MultibodyPlant, context: Context, object_body: RigidBody
) -> Iterator[ReportedContact]:
    """All contacts of an object with any body; arguments as in `Contacts.from_contact_results`."""
    inspector = plant.get_geometry_query_input_port().Eval(context).inspector()
    own = int(object_body.index())
    for i in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(i)
        surface: ContactSurface = info.contact_surface()
        body_M, body_N = (
            int(plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).index())
            for geometry in (surface.id_M(), surface.id_N())
        )
        if own in (body_M, body_N):
            p_WC, n_W = _center_of_pressure(surface)
            # The patch's normals point out of N into M; its force acts on M.
            side = -1.0 if body_M == own else 1.0
            f_W = side * info.F_Ac_W().translational()
            yield ReportedContact(body_N if body_M == own else body_M, p_WC, side * n_W, f_W, surface)
    for i in range(results.num_point_pair_contacts()):
        point = results.point_pair_contact_info(i)
        body_A, body_B = int(point.bodyA_index()), int(point.bodyB_index())
        if own in (body_A, body_B):
            # The normal points out of B into A; the force acts on B.
            side = -1.0 if body_A == own else 1.0
            n_W = side * np.asarray(point.point_pair().nhat_BA_W)
            f_W = -side * np.asarray(point.contact_force())
            partner = body_B if body_A == own else body_A
            yield ReportedContact(partner, np.asarray(point.contact_point()), n_W, f_W, None)


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
