"""Meshes, UV atlases and paintable regions; NumPy, and xatlas only where a mesh is unwrapped."""

from .atlas import chart_of_faces, covered, density_spread, signed_uv_area
from .mesh import face_normals
from .unwrap import chart_mask, repack, unwrap

__all__ = [
    "chart_mask",
    "chart_of_faces",
    "covered",
    "density_spread",
    "face_normals",
    "repack",
    "signed_uv_area",
    "unwrap",
]
