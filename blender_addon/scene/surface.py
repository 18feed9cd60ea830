"""The faces of a vehicle in the open scene, next to the contract's faces of the same vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .vehicle_arrays import Piece, Soup, read_objects


@dataclass(frozen=True, eq=False)
class Surface:
    """A vehicle and the triangles of its objects, in the same order.

    Attributes:
        vehicle: the contract's vehicle.
        soup: the objects' triangles, in world space.
        paint: (F,) True on paint.
    """

    vehicle: contract.Vehicle
    soup: Soup
    paint: NDArray[np.bool_]

    @staticmethod
    def of(vehicle: contract.Vehicle, objects: list[bpy.types.Object]) -> Surface:
        """Read ``objects``, which make up ``vehicle``.

        Raises:
            RaucaError: their faces are not the vehicle's.
        """
        soup = read_objects(objects)
        if len(soup.triangles) != len(vehicle.triangles):
            raise contract.RaucaError(
                f"{vehicle.name}: its objects have {len(soup.triangles)} triangles, the vehicle "
                f"{len(vehicle.triangles)}; choose the vehicle again in step 1"
            )
        return Surface(vehicle, soup, vehicle.paint_faces())

    def painted_pieces(self) -> list[tuple[Piece, slice]]:
        """The pieces with paint on them, and the run of triangles that each is."""
        starts = np.cumsum([0] + [len(piece.polygon) for piece in self.soup.pieces])
        spans = [slice(int(i), int(j)) for i, j in pairwise(starts)]
        return [(p, span) for p, span in zip(self.soup.pieces, spans, strict=True) if self.paint[span].any()]

    def materials(self, span: slice) -> list[bpy.types.Material | None]:
        """The scene's materials on the paint of a run of triangles."""
        return [self.soup.blocks[self.soup.names[i]] for i in np.unique(self.soup.material[span][self.paint[span]])]

    def vehicle_to_world(self) -> NDArray[np.float64]:
        """Where the objects stand: the rigid (4, 4) transform that takes the vehicle to them, by least squares."""
        here, there = self.vehicle.positions.astype(np.float64), self.soup.positions
        one, other = here.mean(axis=0), there.mean(axis=0)
        u, _, v = np.linalg.svd((there - other).T @ (here - one))
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, other - turn @ one
        return pose
