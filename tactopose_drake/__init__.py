"""Touch-based pose estimation of grasped objects, as systems for Drake."""

from tactopose_drake.core.evidence.contacts import Contacts
from tactopose_drake.core.evidence.force_balance import ForceBalance
from tactopose_drake.core.evidence.prior import PosePrior
from tactopose_drake.core.grasping.grasp_quality import GraspQuality, force_closure_probability, grasp_quality
from tactopose_drake.core.sensing.intrinsic_contact import ContactSolution, solve_contact, solve_contacts
from tactopose_drake.core.sensing.patches import Patch, describe_patch
from tactopose_drake.core.shape.objects import ObjectModel
from tactopose_drake.core.surfaces import Capsule, Cylinder, Ellipsoid, Sphere, Superquadric
from tactopose_drake.errors import TactoposeError
from tactopose_drake.estimates import PoseEstimate, PoseHypothesis
from tactopose_drake.estimation import estimate_pose
from tactopose_drake.hand_geometry import HandGeometry
from tactopose_drake.identification import identify
from tactopose_drake.identities import Identification, Identity
from tactopose_drake.object_library import ObjectLibrary

__all__ = [
    "Capsule",
    "ContactSolution",
    "Contacts",
    "Cylinder",
    "Ellipsoid",
    "ForceBalance",
    "GraspQuality",
    "HandGeometry",
    "Identification",
    "Identity",
    "ObjectLibrary",
    "ObjectModel",
    "Patch",
    "PoseEstimate",
    "PoseHypothesis",
    "PosePrior",
    "Sphere",
    "Superquadric",
    "TactoposeError",
    "describe_patch",
    "estimate_pose",
    "force_closure_probability",
    "grasp_quality",
    "identify",
    "solve_contact",
    "solve_contacts",
]
