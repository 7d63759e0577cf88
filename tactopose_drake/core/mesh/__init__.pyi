from .bodies import cross_products as cross_products
from .loading import MeshSource as MeshSource
from .loading import RawMesh as RawMesh
from .loading import load_mesh as load_mesh
from .loading import mesh_file as mesh_file
from .loading import mesh_name as mesh_name
from .repair import MeshRepairWarning as MeshRepairWarning
from .repair import repair_mesh as repair_mesh
