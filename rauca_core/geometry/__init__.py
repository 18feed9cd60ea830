"""Meshes, UV atlases and paintable regions; NumPy, and xatlas only where a mesh is unwrapped."""

from .atlas import chart_of_faces, density_spread
from .car import build_car
from .raster import covered
from .report import AtlasReport, atlas_report
from .unwrap import chart_mask, repack, unwrap

__all__ = [
    "AtlasReport",
    "atlas_report",
    "build_car",
    "chart_mask",
    "chart_of_faces",
    "covered",
    "density_spread",
    "repack",
    "unwrap",
]
