"""Meshes, UV atlases and paintable regions; NumPy, and xatlas only where a mesh is unwrapped."""

from .atlas import chart_of_faces, covered, density_spread
from .unwrap import chart_mask, repack, unwrap

__all__ = [
    "chart_mask",
    "chart_of_faces",
    "covered",
    "density_spread",
    "repack",
    "unwrap",
]
