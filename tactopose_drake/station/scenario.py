"""A scenario as data: the hand, the object, their poses, and the parameters of each part."""

import dataclasses
import os
from pathlib import Path

from pydrake.common.schema import Rotation, Transform
from pydrake.multibody.plant import MultibodyPlantConfig

from tactopose_drake.core.grasping.finger_reach import ReachParams
from tactopose_drake.core.grasping.grasp_planner import PlannerParams
from tactopose_drake.core.parameter_checks import check_numbers
from tactopose_drake.core.sensing.force_torque import ForceTorqueModel
from tactopose_drake.core.shape.model_options import NUMBERS
from tactopose_drake.core.shape.object_model import ObjectModel
from tactopose_drake.core.validation import positive_number, told_of
from tactopose_drake.errors import InvalidFileError, InvalidInputError
from tactopose_drake.estimation.simulated_body import read_mass
from tactopose_drake.hand.hand_config import HandConfig, load_hand_config
from tactopose_drake.hand.tactile_pads import load_tactile_pad
from tactopose_drake.resources import (
    drawn_pose,
    fixed_pose,
    load_typed_yaml,
    model_path,
    named_file,
    resource_root,
    shipped_objects,
)
from tactopose_drake.resources.drake_values import WithDrakeValues
from tactopose_drake.station.can_senses import CanSenses, SimulatedDevices
from tactopose_drake.station.message_channels import LcmPublishing, LcmSenses, Ros2Publishing, Ros2Senses, check_apart
from tactopose_drake.station.scenario_limits import check_limits, check_plant
from tactopose_drake.station.scenario_paths import resolve_paths
from tactopose_drake.station.senses import RecordedSenses, SimulatedSenses
from tactopose_drake.station.simulated_errors import SimulatedErrors
from tactopose_drake.systems.depth_tracker import DepthTrackerParams
from tactopose_drake.systems.force_torque_sensor import load_force_torque_model
from tactopose_drake.systems.grasp_controller import GraspControllerParams
from tactopose_drake.systems.grip_controller import GripControllerParams
from tactopose_drake.systems.pose_estimation import PoseEstimationParams
from tactopose_drake.systems.pose_tracking import PoseTrackingParams
from tactopose_drake.systems.simulated_vision import SimulatedVisionParams
from tactopose_drake.systems.touch_exploration import TouchExplorationParams


@dataclasses.dataclass(kw_only=True, slots=True)
class SensorConfig:
    """The force-torque sensors in the fingers."""

    file: str = "nano17"  # their calibrations: one of the package's sensors by name, or a YAML file by its path
    calibration: str = "SI-12-0.12"  # name of a calibration in that file
    period: float = 0.008  # s between two samples

    def model(self) -> ForceTorqueModel:
        """The model of the sensors.

        Raises:
            InvalidInputError: if the file cannot be read, or has no such calibration.
        """
        # Old recordings have no name of a sensor.
        return load_force_torque_model(self.calibration, self.file or "nano17")


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class Grip(WithDrakeValues):
    """A grip without a plan: the object is fixed in the hand while the fingers close until each stalls."""

    # The object's pose by its name; random parts (`!UniformVector`) are drawn with the scenario's seed.
    X_PO: dict[str, Transform] = dataclasses.field(default_factory=dict)
    controller: GripControllerParams = dataclasses.field(default_factory=GripControllerParams)


@dataclasses.dataclass(kw_only=True, slots=True)
class GraspCheck:
    """When a simulated grasp counts as stable."""

    hold_time: float = 0.8  # time from the object's release to the check, s
    least_fingers: int = 3  # fingertips and pads that carry at least `least_force`; all, if the hand has fewer
    least_force: float = 1.0  # N
    most_speed: float = 0.001  # of the object's origin in the palm, m/s
    most_angular_speed: float = 0.02  # rad/s
    most_slip: float = 0.015  # largest motion of the object's origin in the palm since its release, m; rotation is free
    attempts: int = 5  # planned grasps that are tried, best first


def _default_plant() -> MultibodyPlantConfig:
    # The sensors read the reactions of the previous step (use_sampled_output_ports, Drake's default): solving the
    # contact problem again at each sample would double the run time.
    return MultibodyPlantConfig(time_step=0.004, contact_model="hydroelastic")


def _palm_to_the_side() -> Transform:
    # Fingers along x of the world, thumb side up, as one holds a glass.
    return Transform(rotation=Rotation(value=Rotation.Rpy(deg=[180.0, -90.0, 0.0])))


def _camera() -> Transform:
    # Behind and below the hand, which hides a third of the object or more from there.
    return Transform(translation=[0.1, -0.3, -0.15])


@dataclasses.dataclass(kw_only=True, slots=True, eq=False)
class Scenario(WithDrakeValues):
    """Everything that `make_station` needs; only data. Paths in a file are relative to that file's folder."""

    hand: str = "shadow_like"  # a hand of the package by name, or a *.hand.yaml by its path from this file's folder
    object: str = "wine_glass"  # an object of the package by name, or an SDF by path, with its mesh beside it as OBJ
    surface_sigma: float = 0.0  # standard deviation of the object's surface from its mesh, along the normal, m
    scale_sigma: float = 0.0  # relative standard deviation of the object's scale
    seed: int = 0  # of the grasp and of all noise
    duration: float = 4.0  # longest simulated time, s
    # Source of the estimation's inputs; fields below that concern the hand's motion are for the simulator only.
    senses: SimulatedSenses | CanSenses | LcmSenses | Ros2Senses | RecordedSenses = dataclasses.field(
        default_factory=SimulatedSenses
    )
    publish: LcmPublishing | Ros2Publishing | None = None  # sends the belief to other processes; None: it is not sent
    plant: MultibodyPlantConfig = dataclasses.field(default_factory=_default_plant)  # of the simulator
    X_WBase: Transform = dataclasses.field(default_factory=_palm_to_the_side)  # where the hand's base is welded
    X_WC: Transform = dataclasses.field(default_factory=_camera)  # the vision source's camera; z forward, y down
    grip: Grip | None = None  # a grip without a plan; None: a planned grasp by the next three fields
    reach: ReachParams = dataclasses.field(default_factory=ReachParams)
    planner: PlannerParams = dataclasses.field(default_factory=PlannerParams)
    controller: GraspControllerParams = dataclasses.field(default_factory=GraspControllerParams)
    check: GraspCheck = dataclasses.field(default_factory=GraspCheck)
    sensor: SensorConfig = dataclasses.field(default_factory=SensorConfig)
    errors: SimulatedErrors | None = None  # of the simulated hand, object and camera; None: no errors
    # Source of the prior: the true pose with an error, or a tracker of depth images.
    vision: SimulatedVisionParams | DepthTrackerParams = dataclasses.field(default_factory=SimulatedVisionParams)
    estimation: PoseEstimationParams = dataclasses.field(default_factory=PoseEstimationParams)
    tracking: PoseTrackingParams | None = None  # of the belief over time; None: no tracking
    exploration: TouchExplorationParams | None = None  # by free fingers of a planned grasp, once it holds; None: none

    def hand_config(self) -> HandConfig:
        """The hand's configuration for the estimation.

        A calibration in the hand's file belongs to a real hand, so it is dropped for a simulated one, unless `errors`
        gives the simulated hand errors that the calibration may have found. Sensors that the scenario tares are marked
        as tared.
        """
        config = load_hand_config(self.hand)
        is_told = self.errors is not None and (self.errors.joint_offsets_deg or self.errors.fingers)
        is_simulated = isinstance(self.senses, SimulatedSenses)
        if isinstance(self.senses, CanSenses):
            is_simulated = self.senses.simulated == SimulatedDevices()  # They replay the simulated hand.
            for finger in config.fingers:
                finger.tared |= finger.name in self.senses.fingers and self.senses.tare_samples > 0
        if is_simulated and not is_told:
            config = dataclasses.replace(config, calibration="")
        return config

    def validate(self) -> None:
        """Raises InvalidInputError if a value is out of its range, or a file is missing."""
        check_limits("Scenario", self)
        positive_number("Scenario.duration", self.duration)
        for name in ("surface_sigma", "scale_sigma"):
            NUMBERS[name](f"Scenario.{name}", getattr(self, name))
        check_plant("Scenario.plant", self.plant)
        fixed_pose("Scenario.X_WBase", self.X_WBase)
        fixed_pose("Scenario.X_WC", self.X_WC)
        check_numbers("Scenario.check", self.check)
        parts = (self.reach, self.planner, self.controller, self.vision, self.estimation, self.tracking)
        for part in (*parts, self.exploration):
            if part is not None:
                part.validate()
        if self.grip is not None:
            self.grip.controller.validate()
            for name, X_PO in self.grip.X_PO.items():
                drawn_pose(f"Scenario.grip.X_PO[{name}]", X_PO, self.seed)
        with told_of("Scenario.sensor: "):
            self.sensor.model()
        hand = load_hand_config(self.hand)
        for pad in hand.pads:
            with told_of(f"the hand {self.hand}, pads[{pad.name}].array: "):
                load_tactile_pad(pad.array)
        if self.errors is not None:
            self.errors.validate(hand)
            if self.errors.vision_degrees_of_freedom is not None and isinstance(self.vision, DepthTrackerParams):
                raise InvalidInputError(
                    "SimulatedErrors.vision_degrees_of_freedom must be null with a depth tracker, whose errors are "
                    "those of its images."
                )
        if isinstance(self.senses, CanSenses | Ros2Senses):
            self.senses.validate(hand)
        if isinstance(self.senses, CanSenses):
            # Imported only here, so that a scenario without devices does not need their drivers.
            from tactopose_drake.station.can_devices import check_drivers

            check_drivers(self.senses)
        if isinstance(self.senses, LcmSenses | RecordedSenses):
            self.senses.validate()
        if self.publish is not None:
            self.publish.validate()
            check_apart(self.senses, self.publish)
        self._check_object()
        if self.grip is not None and self.exploration is not None:
            raise InvalidInputError("Scenario.exploration must be None with a grip, as it needs a planned grasp.")
        if self.grip is not None and self.object not in self.grip.X_PO:
            raise InvalidInputError(
                f"Scenario.object must be one that Scenario.grip.X_PO has a pose for in the hand {self.hand!r}, "
                f"{', '.join(sorted(self.grip.X_PO)) or 'none'}, not {self.object!r}."
            )

    def _check_object(self) -> None:
        """Raises InvalidInputError if a file of the object is missing."""
        known = f"one of the package's objects, {', '.join(shipped_objects())}, or an SDF with an OBJ beside it"
        if not Path(self.object).suffix and not self.object_sdf().is_file():
            raise InvalidInputError(f"Scenario.object must be {known}, not {self.object!r}.")
        if Path(self.object).suffix.lower() in (".stl", ".ply", ".glb", ".gltf", ".off", ".dae"):
            raise InvalidInputError(
                f"Scenario.object must be an SDF with an OBJ of the same name beside it, not {self.object}, a mesh "
                f"alone. `tactopose demo --object {self.object}` writes both."
            )
        for path in (self.object_sdf(), self.object_mesh()):
            if not os.path.isfile(path):
                raise InvalidInputError(f"Scenario.object must be {known}, but {path} does not exist.")

    def object_sdf(self) -> Path:
        """Path of the object's model for the simulator."""
        return Path(self.object) if Path(self.object).suffix else model_path("objects", f"{self.object}.sdf")

    def object_mesh(self) -> Path:
        """Path of the object's mesh for the estimator."""
        return self.object_sdf().with_suffix(".obj")

    def without_errors(self) -> "Scenario":
        """The scenario with an exact hand and an estimation that assumes one, as in the thesis' experiments."""
        tracking = None if self.tracking is None else dataclasses.replace(self.tracking, use_uncertainty=False)
        estimation = dataclasses.replace(self.estimation, use_uncertainty=False)
        return dataclasses.replace(self, errors=None, estimation=estimation, tracking=tracking)

    def object_model(self) -> ObjectModel:
        """The object's model for the estimator; with the balance of forces, it has the mass of the simulator's model.

        Raises:
            InvalidInputError: if a file cannot be used.
        """
        mass = read_mass(self.object_sdf())._asdict() if self.estimation.estimator.balance else {}
        return ObjectModel.from_mesh(
            self.object_mesh(), surface_sigma=self.surface_sigma, scale_sigma=self.scale_sigma, **mass
        )


def scenario_file(name_or_path: str | Path) -> Path:
    """Path of a scenario's file: one of the package's diagrams by name, or any file by path.

    Raises:
        InvalidFileError: if there is no such file.
    """
    ending = ".scenario.yaml"
    return named_file(name_or_path, "scenarios", (resource_root() / "diagrams").glob(f"*{ending}"), ending)


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Reads a `*.scenario.yaml`: one of the package's diagrams by name, or any file by path.

    Paths in the file are relative to its folder; those in a `Scenario` made in Python, to the current directory.

    Raises:
        InvalidFileError: if the file cannot be read or does not fit `Scenario`, or a value is out of its range.
    """
    path = scenario_file(name_or_path)
    scenario = load_typed_yaml(Scenario, path)
    resolve_paths(path.parent, scenario)
    with told_of(f"{path}: ", InvalidFileError):
        scenario.validate()
    return scenario
