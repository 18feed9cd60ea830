"""The contract between Blender and torch: data sets, vehicles and camouflages on disk.

NumPy and the standard library only, relative imports only: the Blender add-on carries this package as it is.
Nobody else parses or writes these files.
"""

from .camera import Camera
from .camouflage import Camouflage, load_camouflage, save_camouflage
from .dataset import Dataset, Plan, Ring, claim_folder, frame_folder, read_plan
from .errors import RaucaError
from .frame import Frame, FramePasses, load_frame, load_passes, save_frame
from .progress import Progress, parse_progress
from .quality import Quality
from .scenery import Scenery
from .vehicle import Material, Vehicle, load_vehicle
from .weather import Weather, find_preset, load_weathers

__all__ = [
    "Camera",
    "Camouflage",
    "Dataset",
    "Frame",
    "FramePasses",
    "Material",
    "Plan",
    "Progress",
    "Quality",
    "RaucaError",
    "Ring",
    "Scenery",
    "Vehicle",
    "Weather",
    "claim_folder",
    "find_preset",
    "frame_folder",
    "load_camouflage",
    "load_frame",
    "load_passes",
    "load_vehicle",
    "load_weathers",
    "parse_progress",
    "read_plan",
    "save_camouflage",
    "save_frame",
]
