"""Taps on disk and in memory: every weather, texture and run that shares a camera shares its taps."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..contract import Camera, RaucaError, Vehicle
from .pyramid import Pyramid
from .taps import FORMAT, THINNING, Taps, build_taps


@dataclass(frozen=True)
class TapSettings:
    """What a view's taps depend on beside vehicle and camera; see :func:`taps.build_taps`."""

    size: int
    samples: int = 8
    filter: str = "blackman-harris"
    pattern: str = "lattice"
    thinning: float = THINNING


class TapCache:
    """Taps by what they depend on: geometry, camera, settings and the format's version.

    A missing, damaged or outdated file is built again and replaced by one atomic rename, so any number of processes
    and threads may share the folder. The most recently used taps stay in memory, up to ``memory_bytes``.
    """

    def __init__(self, folder: Path, memory_bytes: int = 2**30) -> None:
        self.folder = Path(folder)
        self._limit = memory_bytes
        self._memory: OrderedDict[str, Taps] = OrderedDict()
        self._held = 0
        self._pyramids: dict[tuple[str, int], Pyramid] = {}
        self._lock = threading.RLock()

    def get(self, vehicle: Vehicle, camera_in_vehicle: Camera, settings: TapSettings) -> Taps:
        """The taps that :func:`taps.build_taps` would return for the same arguments, to the bit."""
        key = tap_key(vehicle, camera_in_vehicle, settings)
        with self._lock:
            taps = self._memory.get(key)
            if taps is not None:
                self._memory.move_to_end(key)
                return taps
        taps = self._read(key) or self._build(key, vehicle, camera_in_vehicle, settings)
        self._remember(key, taps)
        return taps

    def warm(
        self,
        vehicle: Vehicle,
        cameras: Sequence[Camera],
        settings: TapSettings,
        on_view: Callable[[int, int], None] | None = None,
        stop: threading.Event | None = None,
    ) -> None:
        """Put the taps of all cameras on disk; those in place are read, verified and left.

        Args:
            on_view: called with views done and views in all.
            stop: end after the view in work once it is set.
        """
        for done, camera in enumerate(cameras):
            if stop is not None and stop.is_set():
                return
            key = tap_key(vehicle, camera, settings)
            if self._read(key) is None:
                self._build(key, vehicle, camera, settings)
            if on_view is not None:
                on_view(done + 1, len(cameras))

    def pyramid(self, vehicle: Vehicle, size: int) -> Pyramid:
        """The vehicle's pyramid at ``size`` texels, built once."""
        key = (vehicle.geometry_id, size)
        with self._lock:
            if key not in self._pyramids:
                self._pyramids[key] = Pyramid.of(vehicle, size)
            return self._pyramids[key]

    def _build(self, key: str, vehicle: Vehicle, camera: Camera, settings: TapSettings) -> Taps:
        taps = build_taps(vehicle, camera, pyramid=self.pyramid(vehicle, settings.size), **asdict(settings))
        taps.save(self._path(key), key)
        return taps

    def _remember(self, key: str, taps: Taps) -> None:
        with self._lock:
            if key not in self._memory:
                self._memory[key] = taps
                self._held += taps.nbytes
            while self._held > self._limit and len(self._memory) > 1:
                self._held -= self._memory.popitem(last=False)[1].nbytes

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.safetensors"

    def _read(self, key: str) -> Taps | None:
        if not self._path(key).is_file():
            return None
        try:
            return Taps.load(self._path(key), key)
        except RaucaError:
            return None  # a cache may be rebuilt without asking


def tap_cache(folder: Path, memory_bytes: int = 2**30) -> TapCache:
    """Open, and on first use create, a folder of taps."""
    return TapCache(folder, memory_bytes)


def tap_key(vehicle: Vehicle, camera: Camera, settings: TapSettings) -> str:
    """Name of a cache entry. Poses are rounded to a nanometre: frames of one camera differ by float noise only."""
    digest = hashlib.sha256(f"{FORMAT} {vehicle.geometry_id} {asdict(settings)}".encode())
    digest.update(f" {camera.width} {camera.height}".encode())
    for array in (camera.K, camera.R, camera.t):
        digest.update((np.round(array, 9) + 0.0).tobytes())
    return digest.hexdigest()[:24]
