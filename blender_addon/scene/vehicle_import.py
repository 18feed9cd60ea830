"""Any vehicle file into the contract's vehicle: mesh, paint, UV atlas, orientation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, geometry
from . import vehicle_paint
from .images import read_image_blender
from .smart_project import smart_project
from .vehicle_arrays import Soup, read_objects
from .vehicle_files import opened

LENGTH_M = (0.5, 50.0)
OVERLAP_LIMIT = 0.02  # of the covered texels; more than stray slivers, and one texel would paint two places
DEFAULT_ATLAS = 1024
CHECK_ATLAS = 1024


def import_vehicle(path: Path, paint_mask: Path | None = None, paint_material: str | None = None) -> contract.Vehicle:
    """Read a vehicle from an .obj, .glb, .gltf or .blend file, or from a rauca vehicle folder.

    The session's own data is left as it was. What was assumed about axes, paint and UVs is told in ``notes``.

    Args:
        paint_mask: grey PNG in the vehicle's own UVs, white where the camouflage may go.
        paint_material: name of the material to camouflage.

    Raises:
        RaucaError: a missing or damaged file, no faces, NaN vertices, implausible size, or no telling what is paint.
    """
    path = Path(path)
    if path.is_dir():
        if paint_mask or paint_material:
            raise contract.RaucaError(f"{path}: a vehicle folder brings its own paint; drop the paint option")
        return contract.load_vehicle(path, read_image_blender)
    with opened(path) as objects:
        soup = read_objects(objects)
        if len(soup.triangles) == 0:
            raise contract.RaucaError(f"{path}: has no faces; export it with its geometry")
        bad = int((~np.isfinite(soup.positions)).any(axis=1).sum())
        if bad:
            raise contract.RaucaError(f"{path}: {bad} vertices are NaN or infinite; repair the mesh")
        notes: list[str] = []
        _orient(soup, path, notes)
        vehicle = _painted(soup, path, paint_mask, paint_material, notes)
    vehicle.check(str(path))
    return vehicle


def _orient(soup: Soup, path: Path, notes: list[str]) -> None:
    """Turn the vehicle to front +x, up +z and put it on the ground, in place."""
    size = np.ptp(soup.positions, axis=0)
    if path.suffix.lower() == ".obj" and size[1] < size[2]:
        notes.append("axes: y taken as up, because the vehicle is smaller along y than along z")
        _turn(soup, np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    else:
        notes.append("axes: z taken as up")
    size = np.ptp(soup.positions, axis=0)
    if size[1] > size[0]:
        notes.append("axes: turned by 90 degrees, because the vehicle is longer along y; its front is taken at -y")
        _turn(soup, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    low, high = soup.positions.min(axis=0), soup.positions.max(axis=0)
    soup.positions -= [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    length, width, height = high - low
    if not LENGTH_M[0] <= length <= LENGTH_M[1]:
        raise contract.RaucaError(
            f"{path}: is {length:.4g} long, metres are expected; scale it by about {4.5 / max(length, 1e-9):.1g}"
        )
    notes.append(f"size: {length:.2f} x {width:.2f} x {height:.2f} m (length, width, height)")


def _turn(soup: Soup, rotation: NDArray[np.float64]) -> None:
    soup.positions = soup.positions @ rotation.T
    soup.normals = (soup.normals @ rotation.T).astype(np.float32)


def _painted(
    soup: Soup, path: Path, paint_mask: Path | None, paint_material: str | None, notes: list[str]
) -> contract.Vehicle:
    """Decide what is paint and give it usable UVs."""
    painted = vehicle_paint.choose_paint(soup.names, paint_material, paint_mask is not None, path)
    blocks = {name: bpy.data.materials.get(name) for name in soup.names}
    main = blocks[painted[0]]
    base = vehicle_paint.base_image(main, path)
    mask = vehicle_paint.read_mask(paint_mask, base) if paint_mask else None
    paint = np.isin(np.array(soup.names)[soup.material], painted)
    uvs = soup.uvs
    if mask is not None:
        paint &= _under_mask(uvs, mask)
        if not paint.any():
            raise contract.RaucaError(f"--paint-mask {paint_mask}: is white nowhere on the vehicle's UVs; check them")
    elif paint_material is None:
        notes.append(f"paint: material {painted[0]!r}, by its name")
    fault, wrapped = _uv_fault(uvs[paint])
    if fault and mask is not None:
        raise contract.RaucaError(
            f"--paint-mask {paint_mask}: its UVs cannot be used ({fault}); give --paint-material instead"
        )
    uvs = np.nan_to_num(uvs, nan=0.0, posinf=0.0, neginf=0.0)
    uvs[paint] = wrapped
    materials, material = _materials(soup, paint, blocks, path, base if not fault else None)
    size = len(mask) if mask is not None else _atlas_size(base)
    vehicle = contract.Vehicle(
        name=path.stem,
        positions=soup.positions.astype(np.float32),
        triangles=soup.triangles,
        uvs=uvs.astype(np.float32),
        normals=soup.normals,
        material=material,
        materials=materials,
        paint_mask=mask if mask is not None else geometry.chart_mask(wrapped, size),
        base_texture=base if not fault else None,
        source=path.name,
        notes=notes,
    )
    return _unwrapped(vehicle, fault) if fault else vehicle


def _atlas_size(base: NDArray[np.uint8] | None) -> int:
    return len(base) if base is not None and base.shape[0] == base.shape[1] else DEFAULT_ATLAS


def _under_mask(uvs: NDArray[np.float32], mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(F,) True on faces with a texel centre, or their own middle, on the white of the mask."""
    size = len(mask)
    clean = np.nan_to_num(uvs, nan=0.0, posinf=0.0, neginf=0.0)
    clean = clean - np.floor(clean.min(axis=1, keepdims=True) + 1e-4)
    texels, faces = geometry.covered(clean, size, conservative=False)
    found = np.zeros(len(uvs), np.bool_)
    found[faces[mask.ravel()[texels] >= 128]] = True
    column, row = (np.clip(v * size, 0, size - 1).astype(int) for v in (clean.mean(1)[:, 0], 1 - clean.mean(1)[:, 1]))
    return found | (mask[row, column] >= 128)


def _uv_fault(uvs: NDArray[np.float32]) -> tuple[str, NDArray[np.float32]]:
    """Why UVs (F, 3, 2) of the paint cannot be used ('' if they can), and the UVs moved into [0, 1]."""
    if not np.isfinite(uvs).all():
        return ("they are missing" if np.isnan(uvs).all() else "some are NaN or missing"), np.nan_to_num(uvs)
    if np.ptp(uvs, axis=(0, 1)).max() < 1e-6:
        return "all are in one point", uvs
    moved = uvs - np.floor(uvs.min(axis=1, keepdims=True) + 1e-4)  # whole tiles: a repeated texture looks the same
    crossing = (moved.max(axis=(1, 2)) > 1 + 1e-3).mean()
    moved = np.clip(moved, 0.0, 1.0)
    if crossing > 0:
        return f"{crossing:.1%} of the painted faces reach beyond the texture", moved
    texels, _ = geometry.covered(moved, CHECK_ATLAS, conservative=False)
    hits = np.bincount(texels, minlength=1)
    if not hits.any():
        return "they cover no texel", moved
    overlap = (hits > 1).sum() / (hits > 0).sum()
    if overlap > OVERLAP_LIMIT:
        return f"{overlap:.0%} of the texels are used twice", moved
    return "", moved


def _unwrapped(vehicle: contract.Vehicle, fault: str) -> contract.Vehicle:
    note = f"UVs: {fault}; unwrapped anew"
    try:
        fresh = geometry.unwrap(vehicle)
    except ImportError:
        fresh = geometry.repack(vehicle, smart_project(vehicle))
        note += " by Blender's Smart UV Project, as xatlas is not installed"
    return replace(fresh, notes=[*vehicle.notes, note])


def _materials(
    soup: Soup,
    paint: NDArray[np.bool_],
    blocks: dict[str, bpy.types.Material | None],
    path: Path,
    kept: NDArray[np.uint8] | None,
) -> tuple[list[contract.Material], NDArray[np.int16]]:
    """Contract materials, and the material of each face: a material with both kinds of face appears twice."""
    materials: list[contract.Material] = []
    index = np.zeros(len(paint), np.int16)
    painted_names = {soup.names[i] for i in np.unique(soup.material[paint])}
    main = blocks[soup.names[soup.material[paint][0]]]
    for number, name in enumerate(soup.names):
        texture = vehicle_paint.base_image(blocks[name], path)
        textured = kept is not None and texture is not None and vehicle_paint.same_image(blocks[name], main)
        for is_paint in (True, False):
            here = (soup.material == number) & (paint == is_paint)
            if here.any():
                index[here] = len(materials)
                spec = vehicle_paint.describe(name, blocks[name], is_paint, texture)
                if not is_paint and name in painted_names:
                    spec = replace(spec, name=f"{spec.name} (unpainted)")
                materials.append(replace(spec, textured=textured))
    return materials, index
