"""A vehicle on disk: one mesh, one UV atlas for its paint, and the materials that fill the rest.

Both worlds read the same arrays, so the renderer and Blender can never disagree about geometry.

Folder layout::

    vehicle.json      this module's metadata
    mesh.npz          positions, triangles, uvs, normals, material
    paint_mask.png    8-bit grey, the atlas's size; 255 where paint may change
    base.png          optional sRGB texture of the original paint, same atlas
"""

from __future__ import annotations

import hashlib
import io
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .files import atomic_folder, png_bytes, write_bytes, write_json
from .reading import DAMAGED_ARCHIVE, require_file
from .schema import Record, read_json

# And a lone array instead of an archive; a shape beyond memory.
_DAMAGED = (*DAMAGED_ARCHIVE, KeyError, TypeError, MemoryError, OverflowError)
MAX_UNPACKED_BYTES = 2**30
"""Of the arrays in one archive: light maps and distances of the largest frame, 8192 pixels a side, take 0.9 GiB."""
MAX_EXTENT_M = 1e5
"""From the vehicle's origin; float32 is exact to a centimetre there, and no vehicle is longer."""
MAX_UV = 1e4
"""Tiles from the origin: beyond, float32 no longer tells texels apart."""
_ARRAYS = {
    "positions": ("f", (3,)),
    "triangles": ("iu", (3,)),
    "uvs": ("f", (3, 2)),
    "normals": ("f", (3, 3)),
    "material": ("iu", ()),
}
"""Of a mesh: numpy's kinds of number, and the shape of what belongs to one vertex (``positions``) or face."""
NOTHING = 1e-9
"""Parts of a unit normal below this are what rounding left of a zero, and every processor leaves something else."""
NORMAL_STEPS = 2**16
"""Steps of a unit that an identity tells normals apart by; far above what processors round differently."""
_LAST_DIGITS = 1e-5
"""Metres, texture widths, albedo: more than one import of a file differs on another processor."""
KINDS = ("paint", "glass", "trim", "tyre", "rim", "headlamp", "taillamp", "plate", "other")


def target_class(category: str) -> str:
    """The class that a camouflage hides a vehicle from; of a plain shape, which is in no detector's list, a car's."""
    return "car" if category == "shape" else category


@dataclass(frozen=True)
class Material(Record):
    """How a part of the vehicle looks when it is not camouflage.

    Attributes:
        kind: one of :data:`KINDS`; faces of kind ``paint`` take the camouflage where the paint mask allows.
        base_color: linear RGB albedo in [0, 1].
        emission: linear radiance added by a lit lamp, relative to a white surface at noon.
        textured: take the base color from ``base.png`` instead.
    """

    name: str
    kind: Annotated[str, KINDS]
    base_color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    roughness: Annotated[float, (0, 1)] = 0.4
    metallic: Annotated[float, (0, 1)] = 0.0
    coat: Annotated[float, (0, 1)] = 0.0
    emission: Annotated[float, (0, math.inf)] = 0.0
    textured: bool = False

    def looks_like(self, other: Material) -> bool:
        """Whether both are the same material but for last digits."""
        one, two = ((*m.base_color, m.roughness, m.metallic, m.coat, m.emission) for m in (self, other))
        words = (self.name, self.kind, self.textured) == (other.name, other.kind, other.textured)
        return words and bool(np.allclose(one, two, rtol=0, atol=_LAST_DIGITS))


@dataclass(eq=False)
class Vehicle:
    """A vehicle in its own frame: front +x, up +z, wheels on z = 0, metres.

    Attributes:
        positions: (V, 3) float32 vertices.
        triangles: (F, 3) int32 vertex indices, counter-clockwise from outside.
        uvs: (F, 3, 2) float32 per corner; u to the right, v up. Texel row 0 is at the top, v = 1.
        normals: (F, 3, 3) float32 unit shading normals per corner.
        material: (F,) int16 index into ``materials``.
        paint_mask: (H, W) uint8, 255 where the camouflage may change the paint.
        base_texture: (H', W', 3) uint8 sRGB, or None.
        padding_texels: empty texels between charts of the atlas, at the mask's size.
    """

    name: str
    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]
    uvs: NDArray[np.float32]
    normals: NDArray[np.float32]
    material: NDArray[np.int16]
    materials: list[Material]
    paint_mask: NDArray[np.uint8]
    base_texture: NDArray[np.uint8] | None = None
    padding_texels: int = 0
    category: str = "car"
    source: str = ""
    licence: str = ""
    notes: list[str] = field(default_factory=list)

    def paint_faces(self) -> NDArray[np.bool_]:
        """(F,) True on faces whose material is paint."""
        is_paint = np.array([m.kind == "paint" for m in self.materials])
        return is_paint[self.material]

    @property
    def atlas_id(self) -> str:
        """Names the UV layout: a camouflage fits a vehicle exactly when this agrees. Hash of paint UVs and mask."""
        paint = self.paint_faces()
        digest = hashlib.sha256()
        digest.update(
            np.ascontiguousarray(np.round(self.uvs[paint].astype(np.float64) * 2**16).astype(np.int64)).tobytes()
        )
        digest.update(str(self.paint_mask.shape).encode() + np.packbits(self.paint_mask >= 128).tobytes())
        return digest.hexdigest()[:16]

    @property
    def geometry_id(self) -> str:
        """Hash of everything the renderer's taps depend on; keys caches. Patterns blend by normals, edges by greys.

        Normals are sums, whose last digits are the processor's own: they count in steps of 1 / :data:`NORMAL_STEPS`.
        """
        digest = hashlib.sha256(self.atlas_id.encode())
        normals = np.round(self.normals.astype(np.float64) * NORMAL_STEPS).astype(np.int32)
        # A zero may have either sign; adding 0 makes all of them positive.
        for array in (self.positions + 0, self.triangles, self.uvs + 0, normals, self.paint_faces(), self.paint_mask):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()[:16]

    def size(self) -> NDArray[np.float64]:
        """Length, width, height in metres."""
        return np.ptp(self.positions, axis=0).astype(np.float64)

    def changed(self, other: Vehicle) -> list[str]:
        """In what another vehicle would render otherwise than this one; last digits are the processor's own."""
        same = {
            name: one.shape == two.shape and np.allclose(one, two, rtol=0, atol=_LAST_DIGITS)
            for name in _ARRAYS
            for one, two in [(getattr(self, name), getattr(other, name))]
        }
        same["category"] = self.category == other.category
        same["paint_mask"] = np.array_equal(self.paint_mask, other.paint_mask)
        same["base_texture"] = _same_texture(self.base_texture, other.base_texture)
        same["materials"] = len(self.materials) == len(other.materials) and all(
            one.looks_like(two) for one, two in zip(self.materials, other.materials, strict=True)
        )
        return [name for name, agrees in same.items() if not agrees]

    def check(self, where: str) -> None:
        """Raise :class:`RaucaError` naming ``where`` unless the vehicle can be rendered and painted."""
        faces = len(self.triangles) if self.triangles.ndim else 0
        if faces == 0:
            raise RaucaError(f"{where}: the mesh has no faces; export it with its geometry")
        for name, (kinds, shape) in _ARRAYS.items():
            array = getattr(self, name)
            if array.dtype.kind not in kinds:
                raise RaucaError(f"{where}: {name} holds values of type {array.dtype}; make it again")
            wanted = (len(array) if name == "positions" and array.ndim else faces, *shape)
            if array.shape != wanted:
                raise RaucaError(f"{where}: {name} has shape {array.shape}, expected {wanted}")
        bad = int((~np.isfinite(self.positions)).any(axis=1).sum())
        if bad:
            raise RaucaError(f"{where}: {bad} of {len(self.positions)} vertices are NaN or infinite; repair the mesh")
        if self.triangles.min() < 0 or self.triangles.max() >= len(self.positions):
            raise RaucaError(f"{where}: a face refers to a vertex that does not exist")
        if not np.isfinite(self.uvs).all() or not np.isfinite(self.normals).all():
            raise RaucaError(f"{where}: UVs or normals are NaN or infinite; repair the mesh")
        if np.abs(self.positions).max() > MAX_EXTENT_M or np.abs(self.uvs).max() > MAX_UV:
            raise RaucaError(
                f"{where}: reaches beyond {MAX_EXTENT_M:g} m, or its UVs beyond {MAX_UV:g}; repair the mesh"
            )
        if self.material.min() < 0 or self.material.max() >= len(self.materials):
            raise RaucaError(f"{where}: a face refers to a material that does not exist")
        if not self.paint_faces().any():
            raise RaucaError(f"{where}: no face has a paint material; name it with --paint-material")
        if self.paint_mask.ndim != 2 or self.paint_mask.shape[0] != self.paint_mask.shape[1]:
            raise RaucaError(f"{where}: the paint mask must be square and grey, not {self.paint_mask.shape}")
        if not (self.paint_mask >= 128).any():
            raise RaucaError(f"{where}: the paint mask is empty; paint white where the camouflage may go")

    def save(self, folder: Path) -> None:
        """Write the vehicle folder atomically; what rounding left of a normal's zeros is written as 0."""
        self.check(str(folder))
        stored = {name: getattr(self, name) for name in _ARRAYS}
        stored["normals"] = np.where(np.abs(self.normals) < NOTHING, np.float32(0), self.normals)
        arrays = io.BytesIO()
        np.savez_compressed(arrays, **stored)
        metadata = _Metadata(
            self.name, self.category, self.source, self.licence, tuple(self.notes), self.atlas_id, self.padding_texels,
            self.base_texture is not None, tuple(self.materials),
        )  # fmt: skip
        with atomic_folder(Path(folder)) as temporary:
            write_bytes(temporary / "mesh.npz", arrays.getvalue())
            write_bytes(temporary / "paint_mask.png", png_bytes(self.paint_mask))
            if self.base_texture is not None:
                write_bytes(temporary / "base.png", png_bytes(self.base_texture))
            write_json(temporary / "vehicle.json", metadata.to_json())


@dataclass(frozen=True)
class _Metadata(Record):
    """``vehicle.json``; ``base_texture`` says whether there is one."""

    FORMAT = ("rauca-vehicle", 1)
    name: Annotated[str, "plain_name"]
    category: str
    source: str
    licence: str
    notes: tuple[str, ...]
    atlas_id: str
    padding_texels: int
    base_texture: bool
    materials: tuple[Material, ...]


def _same_texture(one: NDArray[np.uint8] | None, two: NDArray[np.uint8] | None) -> bool:
    """Equal but for what one reader rounds and another cuts off, of a file of 16 bits."""
    if one is None or two is None or one.shape != two.shape:
        return one is two
    return bool((np.maximum(one, two) - np.minimum(one, two) <= 1).all())


def load_vehicle(folder: Path, read_image: Any) -> Vehicle:
    """Read and check a vehicle folder.

    Args:
        read_image: ``path -> (H, W) or (H, W, 3) uint8`` (Pillow outside Blender, Blender's reader inside).
    """
    folder = Path(folder)
    told = _Metadata.from_json(read_json(folder / "vehicle.json"))
    vehicle = Vehicle(
        name=told.name,
        materials=list(told.materials),
        paint_mask=read_image(folder / "paint_mask.png"),
        base_texture=read_image(folder / "base.png") if told.base_texture else None,
        padding_texels=told.padding_texels,
        category=told.category,
        source=told.source,
        licence=told.licence,
        notes=list(told.notes),
        **load_arrays(folder / "mesh.npz", tuple(_ARRAYS)),
    )
    vehicle.check(str(folder))
    if vehicle.atlas_id != told.atlas_id:
        raise RaucaError(f"{folder}: mesh or mask was changed after vehicle.json was written; import the vehicle again")
    return vehicle


def load_arrays(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Read named arrays from an .npz without unpickling; a damaged file is named.

    Raises:
        RaucaError: missing, damaged, or arrays that would unpack to more than :data:`MAX_UNPACKED_BYTES`.
    """
    path = Path(path)
    require_file(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            unpacked = sum(archive.zip.getinfo(f"{name}.npy").file_size for name in names)
            if unpacked > MAX_UNPACKED_BYTES:
                raise ValueError(f"unpacks to {unpacked / 2**20:.0f} MiB; at most {MAX_UNPACKED_BYTES >> 20} are read")
            arrays = {name: archive[name] for name in names}
            if strange := [name for name in names if not isinstance(arrays[name], np.ndarray)]:
                raise ValueError(f"{strange[0]} is no array")  # numpy hands the bytes of such a member out as they are
            return arrays
    except _DAMAGED as error:
        raise RaucaError(f"{path}: damaged or not a rauca file ({error}); make it again") from error
