"""What a detector is shown to be hardened: frames whose vehicle wears a camouflage, a share of the time.

The exact light maps turn any UV map into the frame that Cycles would render, in milliseconds: the optimizer's own
renderer looks the texels up, ``A * x + B`` lights them. What is not painted, and vehicles that no camouflage fits, stay
as plain samples show them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..contract import RaucaError, load_camouflage
from ..contract.color import srgb_to_linear
from ..environment.frames import LightFrames
from ..render import MipmappedTexture, Pyramid, TapCache, TapSettings
from ..render.uv_map import read_uv_map
from .adversary import Adversary, vary
from .samples import Samples

BESIDE = 0.6  # share of camouflages that are the adversary's, where there is one
NEWEST = 0.5  # share of the others that are the last one, which the detector has learnt least of


class CamouflagedSamples(Samples):
    """Samples of which a share wears one of the camouflages that fit the frame's vehicle.

    Args:
        camouflages: JSON paths, the newest last; one that fits no data set's vehicle is an error. Of those that fit a
            vehicle the newest is shown more often than any other.
        taps: folder of tap files, made as needed.
        share: of frames that wear one, where one fits.
        recipe: of the neural renderer; UV maps of another size are resampled, in linear light.
        varied: also show camouflages in permuted colors and faded, so that no single palette is learnt by heart.
        memory_mb: of taps kept in memory for each data set, MiB.

    Attributes:
        known: paintable texels (P, 3) linear of the camouflages, by UV atlas.
        adversary: whose camouflages are shown beside the known ones, if any.

    Raises:
        RaucaError: a camouflage that is damaged or fits none of the vehicles.
    """

    def __init__(
        self,
        frames: LightFrames,
        class_names: Sequence[str],
        size: int,
        camouflages: Sequence[Path],
        taps: Path,
        share: float,
        recipe: TapSettings,
        varied: bool = True,
        memory_mb: int = 2048,
    ) -> None:
        # What stands around: the detector as it was says what that is (detect/synth/student_losses.py).
        super().__init__(frames, class_names, size, alone=True)
        self._share, self._recipe, self._folder, self._varied = share, recipe, taps, varied
        self._memory = memory_mb * 2**20
        self._caches: dict[int, TapCache] = {}
        self.known = self._read(camouflages)
        self.adversary: Adversary | None = None

    def painted(self, index: int, rng: np.random.Generator) -> Tensor:
        """The frame in one of the camouflages, or in a plain paint: (3, H, W) float32 linear, not clipped.

        Differentiable in the adversary's texels.
        """
        atlas = self._atlas(index)
        worn = self.known.get(atlas, [])
        if not worn or rng.random() >= self._share:
            return super().painted(index, rng)
        if self.adversary is not None and rng.random() < BESIDE:
            return self._wear(index, self.adversary.draw(atlas, rng))
        texels = worn[-1] if rng.random() < NEWEST else worn[rng.integers(len(worn))]
        return self._wear(index, vary(texels, rng) if self._varied else texels)

    def _wear(self, index: int, texels: Tensor) -> Tensor:
        """The frame with paintable texels (P, 3) linear on its vehicle."""
        frame, cache = self.frames.get(index), self._cache(index)
        taps = cache.get(self.frames.camera(index))
        albedo = MipmappedTexture(cache.pyramid, texels).sample([taps.rows])
        A, B = (light.float().reshape(3, -1) for light in (frame.A, frame.B))
        pixels = torch.from_numpy(taps.pixels.astype(np.int64))
        lit = A[:, pixels] * albedo.T + B[:, pixels]
        return (A * frame.reference[:, None] + B).index_copy(1, pixels, lit).reshape(frame.A.shape)

    def _cache(self, index: int) -> TapCache:
        """Taps of the frame's vehicle; data sets of one vehicle share its files."""
        number = self.frames.places[index].dataset
        if number not in self._caches:
            self._caches[number] = TapCache(self._folder, self.frames.vehicle(index), self._recipe, self._memory)
        return self._caches[number]

    def _atlas(self, index: int) -> str:
        return self.frames.datasets[self.frames.places[index].dataset].plan.atlas_id

    def _read(self, camouflages: Sequence[Path]) -> dict[str, list[Tensor]]:
        """Texels of the camouflages by UV atlas."""
        first: dict[str, int] = {}
        for index in range(len(self.frames)):
            first.setdefault(self._atlas(index), index)
        found: dict[str, list[Tensor]] = {}
        for path in camouflages:
            record, image = load_camouflage(path)
            if record.atlas_id not in first:
                raise RaucaError(
                    f"{path}: made for UV atlas {record.atlas_id} of {record.vehicle_name}, which no data set shows; "
                    "add a data set of that vehicle with --data"
                )
            pyramid = self._cache(first[record.atlas_id]).pyramid
            found.setdefault(record.atlas_id, []).append(read_texels(image, pyramid))
        return found


def read_texels(image: Path, pyramid: Pyramid) -> Tensor:
    """The paintable texels (P, 3) linear of a UV map's PNG, at the pyramid's size."""
    linear = srgb_to_linear(read_uv_map(image, pyramid.size).astype(np.float32) / 255)
    return pyramid.from_map(torch.from_numpy(np.ascontiguousarray(linear.transpose(2, 0, 1))))
