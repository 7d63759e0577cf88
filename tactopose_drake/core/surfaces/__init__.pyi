from .capsule import Capsule as Capsule
from .cylinder import Cylinder as Cylinder
from .ellipsoid import Ellipsoid as Ellipsoid
from .sphere import Sphere as Sphere
from .superquadric import Superquadric as Superquadric
from .surface import Surface as Surface
