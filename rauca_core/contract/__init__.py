"""The contract between Blender and torch: data sets, vehicles and camouflages on disk.

NumPy and the standard library only, relative imports only: the Blender add-on carries this package as it is.
Nobody else parses or writes these files.
"""

from . import clips, exposure, rain, viewpoints
from .camera import Camera
from .camouflage import Camouflage, load_camouflage, save_camouflage
from .clips import Clips
from .dataset import Dataset, LedgerEntry, append_entry, frame_folder, frame_states, read_ledger
from .errors import RaucaError, StoppedError
from .files import seal_dataset
from .finish import Finish, finish_of
from .frame import Frame, FramePasses, by_place_and_weather, load_frame, load_passes, save_frame
from .job import (
    ApplyCamouflage,
    ImportVehicle,
    Job,
    MakeDataset,
    OptimizeProgress,
    Progress,
    RenderCamouflages,
    RenderFrames,
    UnwrapVehicle,
    VehicleSource,
    format_duration,
    load_job,
    parse_optimize_progress,
    parse_progress,
    save_job,
)
from .plan import MIN_VISIBLE, REFERENCE_SRGB, Plan, PlannedFrame, Quality, Ring, Scenery, claim_folder, read_plan
from .semantics import Box, Instance
from .vehicle import MAX_EXTENT_M, Material, Vehicle, load_vehicle
from .weather import Weather, find_preset, preset_notes, weather_from_carla
from .work import Shard, balanced_frames, cameras_of, chunks, in_rendering_order, planned_frames

__all__ = [
    "MAX_EXTENT_M", "MIN_VISIBLE", "REFERENCE_SRGB", "ApplyCamouflage", "Box", "Camera", "Camouflage", "Clips",
    "Dataset", "Finish", "Frame", "FramePasses", "ImportVehicle", "Instance", "Job", "LedgerEntry", "MakeDataset",
    "Material", "OptimizeProgress", "Plan", "PlannedFrame", "Progress", "Quality", "RaucaError",
    "RenderCamouflages", "RenderFrames", "Ring", "Scenery", "Shard", "StoppedError", "UnwrapVehicle",
    "Vehicle", "VehicleSource", "Weather", "append_entry", "balanced_frames", "by_place_and_weather",
    "cameras_of", "chunks",
    "claim_folder", "clips", "exposure", "find_preset", "finish_of", "format_duration", "frame_folder", "frame_states",
    "in_rendering_order", "load_camouflage", "load_frame", "load_job", "load_passes", "load_vehicle",
    "parse_optimize_progress", "parse_progress", "planned_frames", "preset_notes", "rain",
    "read_ledger", "read_plan", "save_camouflage", "save_frame", "save_job",
    "seal_dataset", "viewpoints", "weather_from_carla",
]  # fmt: skip
