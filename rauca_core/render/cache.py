"""Taps on disk and in memory: every weather, texture and run that shares a camera shares its taps."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from ..contract import Camera, RaucaError, Vehicle
from .mipmap import Pyramid
from .taps import TAP_FORMAT, Taps


class TapRecipe(Protocol):
    """What a view's taps depend on beside vehicle and camera: a dataclass of plain values."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def pyramid(self, vehicle: Vehicle) -> Pyramid:
        """The colors that the taps read, with their mip levels."""
        ...

    def build(self, vehicle: Vehicle, camera_in_vehicle: Camera, pyramid: Pyramid) -> Taps:
        """The taps of one view."""
        ...


class TapCache:
    """The taps of one vehicle's views.

    A missing, damaged or outdated file is built again and replaced by one atomic rename, so any number of processes,
    threads, vehicles and settings may share the folder. The most recently used taps stay in memory.

    Attributes:
        pyramid: of the colors that the taps read.
    """

    def __init__(self, folder: Path, vehicle: Vehicle, settings: TapRecipe, memory_bytes: int = 2**30) -> None:
        self.folder, self.settings = Path(folder), settings
        self.pyramid = settings.pyramid(vehicle)
        self._vehicle, self._geometry = vehicle, vehicle.geometry_id  # a hash of the whole mesh: once, not per view
        self._limit, self._held = memory_bytes, 0
        self._memory: OrderedDict[str, Taps] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, camera_in_vehicle: Camera) -> Taps:
        """The taps that the settings build for the camera, to the bit."""
        key = tap_key(self._geometry, camera_in_vehicle, self.settings)
        with self._lock:
            if key in self._memory:
                self._memory.move_to_end(key)
                return self._memory[key]
        taps = self._read(key)
        if taps is None:  # not `or`: those of a view without paint have no length
            taps = self._build(key, camera_in_vehicle)
        self._remember(key, taps)
        return taps

    def warm(
        self,
        cameras: Sequence[Camera],
        on_view: Callable[[int, int], None] | None = None,
        stop: threading.Event | None = None,
    ) -> None:
        """Put the taps of all different cameras on disk; those in place are read, verified and left.

        Meant for a thread beside the optimizer: the kernels leave Python's lock alone.

        Args:
            on_view: called with views done and views in all.
            stop: once set, end after the view in work.
        """
        views = {tap_key(self._geometry, camera, self.settings): camera for camera in cameras}
        for done, (key, camera) in enumerate(views.items(), 1):
            if stop is not None and stop.is_set():
                return
            if self._read(key) is None:
                self._build(key, camera)
            if on_view is not None:
                on_view(done, len(views))

    def _build(self, key: str, camera: Camera) -> Taps:
        taps = self.settings.build(self._vehicle, camera, self.pyramid)
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


def tap_key(geometry_id: str, camera: Camera, settings: TapRecipe) -> str:
    """Name of a cache entry. Poses are rounded to a nanometre: frames of one camera differ by float noise only."""
    digest = hashlib.sha256(f"{TAP_FORMAT} {geometry_id} {asdict(settings)}".encode())
    digest.update(f" {camera.width} {camera.height}".encode())
    for array in (camera.K, camera.R, camera.t):
        digest.update((np.round(array, 9) + 0.0).tobytes())
    return digest.hexdigest()[:24]
