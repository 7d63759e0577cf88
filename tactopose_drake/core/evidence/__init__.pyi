from .contacts import Contacts as Contacts
from .evidence import Evidence as Evidence
from .force_balance import ForceBalance as ForceBalance
from .gaussian_prior import GaussianPrior as GaussianPrior
from .hand_clearance import HandClearance as HandClearance
from .hand_geometry import HandGeometry as HandGeometry
from .patch_contacts import with_patches as with_patches
from .plane_contact import PlaneContact as PlaneContact
