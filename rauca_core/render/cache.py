"""Taps on disk and in memory: every weather, texture and run that shares a camera shares its taps."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from pathlib import Path

import numpy as np

from ..contract import Camera, RaucaError, Vehicle
from .pyramid import Pyramid
from .taps import FORMAT, Taps, build_taps


class TapCache:
    """Taps by what they depend on: geometry, camera, map size, samples, filter and the format's version.

    A missing, damaged or outdated file is built again and replaced by one atomic rename, so any number of processes
    may share the folder. The most recently used taps stay in memory, up to ``memory_bytes``.
    """

    def __init__(self, folder: Path, memory_bytes: int = 2**30) -> None:
        self.folder = Path(folder)
        self._limit = memory_bytes
        self._memory: OrderedDict[str, Taps] = OrderedDict()
        self._pyramids: dict[tuple[str, int], Pyramid] = {}

    def get(
        self, vehicle: Vehicle, camera_in_vehicle: Camera, size: int, samples: int = 4, filter: str = "blackman-harris"
    ) -> Taps:
        """The taps that :func:`taps.build_taps` would return for the same arguments."""
        key = tap_key(vehicle, camera_in_vehicle, size, samples, filter)
        taps = self._memory.pop(key, None) or self._read(key, camera_in_vehicle)
        if taps is None:
            pyramid = self.pyramid(vehicle, size)
            taps = build_taps(vehicle, camera_in_vehicle, size, samples, filter, pyramid)
            taps.save(self._path(key))
        self._memory[key] = taps
        while sum(t.nbytes for t in self._memory.values()) > self._limit and len(self._memory) > 1:
            self._memory.popitem(last=False)
        return taps

    def pyramid(self, vehicle: Vehicle, size: int) -> Pyramid:
        """The vehicle's pyramid at ``size`` texels, built once."""
        key = (vehicle.geometry_id, size)
        if key not in self._pyramids:
            self._pyramids[key] = Pyramid.of(vehicle, size)
        return self._pyramids[key]

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"

    def _read(self, key: str, camera: Camera) -> Taps | None:
        if not self._path(key).is_file():
            return None
        try:
            taps = Taps.load(self._path(key))
        except RaucaError:
            return None  # a cache may be rebuilt without asking
        return taps if (taps.width, taps.height) == (camera.width, camera.height) else None


def tap_cache(folder: Path, memory_bytes: int = 2**30) -> TapCache:
    """Open, and on first use create, a folder of taps."""
    return TapCache(folder, memory_bytes)


def tap_key(vehicle: Vehicle, camera: Camera, size: int, samples: int, filter: str) -> str:
    """Name of a cache entry. Poses are rounded to a nanometre: frames of one camera differ by float noise only."""
    digest = hashlib.sha256(f"{FORMAT} {vehicle.geometry_id} {size} {samples} {filter}".encode())
    digest.update(f" {camera.width} {camera.height}".encode())
    for array in (camera.K, camera.R, camera.t):
        digest.update((np.round(array, 9) + 0.0).tobytes())
    return digest.hexdigest()[:24]
