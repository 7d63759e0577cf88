"""The model of an object: all that pose estimation needs of its mesh."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from tactopose_drake.core.compilation import read_only
from tactopose_drake.core.mesh.bodies import face_areas
from tactopose_drake.core.mesh.solid import DENSITY
from tactopose_drake.core.plain_values import ReadOnlyCopies, seal
from tactopose_drake.core.shape import kept_parts
from tactopose_drake.core.shape.coarse_field import CoarseField, over_grid
from tactopose_drake.core.shape.model_cache import Arrays
from tactopose_drake.core.shape.model_from_mesh import MadeFromMesh
from tactopose_drake.core.shape.model_options import ModelOptions
from tactopose_drake.core.shape.model_symmetries import known_symmetries, symmetry_lines
from tactopose_drake.core.shape.pair_features import PairFeatures, build_pair_features
from tactopose_drake.core.shape.signed_distance import DistanceGrid
from tactopose_drake.core.shape.surface_samples import SurfaceSamples
from tactopose_drake.core.shape.surfels import Surfels, make_surfels, surfel_sigmas, surfel_spacing
from tactopose_drake.core.shape.symmetry import RotationalSymmetry, sampled_turns
from tactopose_drake.core.shape.unevenness import Unevenness, find_unevenness
from tactopose_drake.core.validation import FloatArray

# Usual standard deviation of a contact's position, m.
_USUAL_SIGMA = 0.0009
# Those of points in m: of the best fingers, and of one that seems to touch something else.
_SUREST, _LEAST_SURE = 0.0005, 0.02


@dataclass(frozen=True, eq=False)
class ObjectModel(ReadOnlyCopies, MadeFromMesh):
    """A rigid object in its own frame O, made by `from_mesh`; all arrays are read-only.

    Attributes:
        name: the mesh file's name without its ending, unless another was given.
        vertices: of the repaired mesh, shape (v, 3), m.
        faces: vertex indices, anticlockwise seen from outside, shape (f, 3).
        grid: signed distance and outward normal at any point.
        coarse_field: the same in few bytes, to rank thousands of poses.
        samples: points spread evenly over the surface, with normals.
        volume: m^3.
        mass: kg; with the density of water (1000 kg/m^3) if none was given.
        mass_is_known: whether it was given.
        center_of_mass: shape (3,), m; the volume's centroid if none was given.
        inertia: about the centre of mass, axes of O, shape (3, 3), kg m^2: that of a uniform body of this mass about
            its centroid, even if another centre of mass was given.
        symmetries: axes about which the object may be turned without a change.
        symmetry_poses: the poses X_OO' that the finite symmetries generate, the identity first, shape (g, 3, 4);
            continuous symmetries are in `symmetries` alone.
        symmetry_misfits: rms distance of the samples from the surface when moved by each of these, m, shape (g,).
        likenesses: poses X_OO' that are no symmetries but leave the object roughly unchanged, shape (n, 3, 4): a touch
            that fits the object may also fit it there.
        near_symmetries: axes about which every rotation nearly leaves the object unchanged, as with a scan of a can.
        symmetries_are_given: whether they were given rather than detected: then they hold, whatever the surface is.
        size: diagonal of the bounding box, m.
        repairs: what was repaired in the mesh, one sentence each.
        content_hash: of the vertices and faces, 32 hexadecimal digits.
        is_kept: whether parts of the model that are made when first needed are cached on disk, like the model itself.
        surface_sigma: standard deviation of the surface's distance from the mesh, along its normal, m.
        scale_sigma: standard deviation of the object's relative growth about its centre of mass.
    """

    name: str
    vertices: FloatArray
    faces: NDArray[np.int32]
    grid: DistanceGrid
    coarse_field: CoarseField
    samples: SurfaceSamples
    volume: float
    mass: float
    center_of_mass: FloatArray
    inertia: FloatArray
    symmetries: tuple[RotationalSymmetry, ...]
    symmetry_poses: FloatArray
    symmetry_misfits: FloatArray
    likenesses: FloatArray
    size: float
    repairs: tuple[str, ...]
    content_hash: str
    mass_is_known: bool = False
    near_symmetries: tuple[RotationalSymmetry, ...] = ()
    symmetries_are_given: bool = False
    is_kept: bool = False
    surface_sigma: float = 0.0
    scale_sigma: float = 0.0

    def __repr__(self) -> str:
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        extent = " x ".join(f"{1e3 * length:.0f}" for length in high - low)
        axes = [f"{'any' if axis.is_continuous else axis.order}-fold" for axis in self.symmetries]
        axes += ["nearly any-fold"] * bool(self.near_symmetries)
        symmetry = ", ".join(axes) if axes else "none"
        return (
            f"<ObjectModel {self.name!r}: {extent} mm, {1e3 * self.mass:.0f} g, {len(self.faces)} faces, "
            f"symmetry: {symmetry}>"
        )

    @cached_property
    def area(self) -> float:
        """Area of the surface, m^2."""
        return float(face_areas(self.vertices, self.faces).sum())

    @cached_property
    def middle(self) -> FloatArray:
        """Centre of the bounding box, in O, shape (3,), m."""
        middle: FloatArray = read_only(0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0)))
        return middle

    @cached_property
    def hull_vertices(self) -> FloatArray:
        """The vertices of the convex hull, shape (k, 3), m; computed when first needed."""
        vertices: FloatArray = read_only(self.vertices[scipy.spatial.ConvexHull(self.vertices).vertices])
        return vertices

    @cached_property
    def about_middle(self) -> ObjectModel:
        """The same object in a frame with O's axes at the centre of the bounding box."""
        p_OC = self.middle
        symmetry_poses, likenesses = self.symmetry_poses.copy(), self.likenesses.copy()
        for poses in (symmetry_poses, likenesses):
            poses[:, :, 3] += poses[:, :, :3] @ p_OC - p_OC
        grid = DistanceGrid(self.grid.values, self.grid.origin - p_OC, self.grid.spacing)
        moved = replace(
            self,
            vertices=self.vertices - p_OC,
            grid=grid,
            coarse_field=over_grid(grid, self.coarse_field.values),
            samples=SurfaceSamples(self.samples.points - p_OC, self.samples.normals),
            center_of_mass=self.center_of_mass - p_OC,
            symmetries=tuple(symmetry.seen_from(p_OC) for symmetry in self.symmetries),
            near_symmetries=tuple(symmetry.seen_from(p_OC) for symmetry in self.near_symmetries),
            symmetry_poses=symmetry_poses,
            likenesses=likenesses,
        )
        seal(moved)
        return moved

    @cached_property
    def half_turns(self) -> FloatArray:
        """Half turns about the principal axes of inertia through the box's centre, poses X_OO' of shape (3, 3, 4).

        Few objects have these symmetries, but many nearly do: a touch may fit a mug upside down.
        """
        R = 2.0 * np.einsum("ik,jk->kij", *(np.linalg.eigh(self.inertia)[1],) * 2) - np.eye(3)
        turns: FloatArray = read_only(np.concatenate([R, (self.middle - R @ self.middle)[:, :, None]], axis=2))
        return turns

    @cached_property
    def growth(self) -> tuple[float, float]:
        """Rms displacement of the surface along its normal and along each tangent per relative growth by 1, m."""
        arms = self.samples.points - self.center_of_mass
        outward = np.einsum("ij,ij->i", arms, self.samples.normals) ** 2
        along = 0.5 * (np.einsum("ij,ij->i", arms, arms) - outward)
        return float(np.sqrt(outward.mean())), float(np.sqrt(along.mean()))

    @cached_property
    def unevenness(self) -> Unevenness:
        """How much the surface varies over a distance; computed when first needed, in about 0.1 s."""
        return find_unevenness(self.samples)

    @cached_property
    def pair_features(self) -> PairFeatures:
        """Pairs of surface samples, indexed by their features; computed when first needed, in about 0.2 s."""
        make = kept_parts.pair_features if self.is_kept else build_pair_features
        return make(self.samples, self.area, self.symmetry_turns)

    def surfels(self, sigma: float) -> Surfels:
        """The surface as discs, for points of standard deviation sigma, m; made when first needed, in about 0.1 s."""
        spacing = surfel_spacing(sigma, self.area)
        if spacing not in self._surfels:
            make = kept_parts.surfels if self.is_kept else make_surfels
            self._surfels[spacing] = make(self.vertices, self.faces, self.area, spacing)
        return self._surfels[spacing]

    @cached_property
    def _surfels(self) -> dict[float, Surfels]:
        return {}

    def _load_kept_parts(self) -> None:
        """Loads those parts from disk that earlier estimates have left and the next one needs."""
        if kept_parts.has_pair_features(self.samples, self.area, self.symmetry_turns):
            _ = self.pair_features
        if kept_parts.has_surfels(self.vertices, self.faces, self.area, surfel_spacing(_USUAL_SIGMA, self.area)):
            self.surfels(_USUAL_SIGMA)

    def make_ready(self, least_sigma: float = _SUREST, largest_sigma: float = _LEAST_SURE) -> None:
        """Makes or loads all that estimates need, so that none has to wait for it.

        Args:
            least_sigma: least standard deviation of the points that will be touched, m.
            largest_sigma: the largest, m.
        """
        _ = self.pair_features, self.symmetry_turns, self.samples.spread, self.unevenness, self.growth
        for sigma in surfel_sigmas(least_sigma, largest_sigma):
            self.surfels(sigma)

    @cached_property
    def continuous_symmetries(self) -> tuple[RotationalSymmetry, ...]:
        """The symmetries about whose axes every rotation leaves the object unchanged."""
        return tuple(symmetry for symmetry in self.symmetries if symmetry.is_continuous)

    @cached_property
    def symmetry_turns(self) -> FloatArray:
        """The finite symmetries, combined with some rotations about each continuous axis, shape (g, 3, 4)."""
        return sampled_turns(self.symmetry_poses, self.symmetries)

    @classmethod
    def _of(cls, arrays: Arrays, repairs: tuple[str, ...], options: ModelOptions) -> ObjectModel:
        volume = float(arrays["volume"])
        mass = DENSITY * volume if options.mass is None else options.mass
        inertia = arrays["inertia"] * (mass / (DENSITY * volume))
        center = arrays["centroid"] if options.center_of_mass is None else np.asarray(options.center_of_mass)
        grid = DistanceGrid(arrays["distances"], arrays["grid_origin"], float(arrays["grid_spacing"]))
        surface = SurfaceSamples(arrays["sample_points"], arrays["sample_normals"])
        known = known_symmetries(arrays, grid, surface, options.symmetries)
        model = cls(
            name=options.name,
            vertices=arrays["vertices"],
            faces=arrays["faces"],
            grid=grid,
            coarse_field=over_grid(grid, arrays["coarse_values"]),
            samples=surface,
            volume=volume,
            mass=mass,
            center_of_mass=center,
            inertia=inertia,
            symmetries=known.symmetries,
            symmetry_poses=known.poses,
            symmetry_misfits=known.misfits,
            likenesses=known.likenesses,
            size=float(np.linalg.norm(np.ptp(arrays["vertices"], axis=0))),
            repairs=repairs,
            content_hash=arrays["content_hash"].tobytes().decode(),
            mass_is_known=options.mass is not None,
            near_symmetries=known.near,
            symmetries_are_given=options.symmetries is not None,
            is_kept=options.is_kept,
            surface_sigma=options.surface_sigma,
            scale_sigma=options.scale_sigma,
        )
        seal(model)
        if options.is_kept:
            model._load_kept_parts()
        for line in symmetry_lines(known, model.symmetries_are_given, grid, surface, model.size):
            logging.getLogger("tactopose_drake").warning("%s: %s", model.name, line)
        return model
