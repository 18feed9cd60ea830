"""Frames to learn light from: the image, the masks and the exact maps, of one or several data sets."""

from __future__ import annotations

import hashlib
import json
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..contract import Camera, Dataset, Frame, RaucaError, Ring, Vehicle, color, load_vehicle
from ..contract.plan import CPU
from ..contract.seeding import named_rng
from ..render import linear_to_srgb
from ..runtime.images import read_image
from .exact import load_exact, require_light
from .shading import PlainShading, plain_shading

SplitBy = Literal["location", "view"]
NO_RING = Ring((), (), ())


@dataclass(frozen=True, eq=False)
class LightFrame:
    """One frame, small in memory: 17 bytes per pixel.

    Attributes:
        name: the frame's folder, for messages.
        weather, distance_m: of the frame.
        image: (3, H, W) uint8 sRGB, in the reference paint.
        paint, vehicle: (1, H, W) uint8 coverage.
        A, B: (3, H, W) float16 linear, exact.
        reference: (3,) float32 linear albedo of the reference paint.
    """

    name: str
    weather: str
    distance_m: float
    image: Tensor
    paint: Tensor
    vehicle: Tensor
    A: Tensor
    B: Tensor
    reference: Tensor

    @property
    def nbytes(self) -> int:
        return sum(t.nbytes for t in (self.image, self.paint, self.vehicle, self.A, self.B))


class Place(NamedTuple):
    """Where a frame comes from: which data set, and its metadata."""

    dataset: int
    frame: Frame


class LightFrames:
    """The frames of data sets that show the vehicle; read on first use and kept while memory lasts.

    Frames larger than the working size are averaged down to it, in linear light: the noise of few samples goes with it.

    Args:
        folders: data sets with light maps.
        memory_mb: of frames kept in memory, MiB.
        size: to work in, pixels; the frames' own size by default, which must then be one.

    Raises:
        RaucaError: a data set made without light, without frames, or of an image size that is no multiple of ``size``.
    """

    def __init__(self, folders: Sequence[Path], memory_mb: int = 2048, size: int | None = None) -> None:
        if not folders:
            raise RaucaError("data sets: none given; make one with `rauca dataset make`")
        self.datasets = [Dataset(folder) for folder in folders]
        self.size = size or self.datasets[0].plan.size
        self.places: list[Place] = []
        for number, dataset in enumerate(self.datasets):
            require_light(dataset)
            self._require_size(dataset, chosen=size is not None)
            found = [Place(number, f) for f in dataset.frames() if f.box_xyxy is not None]
            if not found:
                raise RaucaError(f"{dataset.folder}: no finished frame shows the vehicle; make the data set first")
            self.places += found
        self._budget = memory_mb * 2**20
        self._held = 0
        self._frames: OrderedDict[int, LightFrame] = OrderedDict()
        self._shadings: OrderedDict[tuple[int, bytes], PlainShading] = OrderedDict()
        self._vehicles: dict[int, Vehicle] = {}

    def __len__(self) -> int:
        return len(self.places)

    def _require_size(self, dataset: Dataset, chosen: bool) -> None:
        own = dataset.plan.size
        if chosen and own % self.size:
            raise RaucaError(
                f"{dataset.folder}: frames of {own} pixels, no multiple of --size {self.size}; choose another"
            )
        if not chosen and own != self.size:
            raise RaucaError(
                f"{dataset.folder}: frames of {own} pixels, those of {self.datasets[0].folder} have {self.size}; "
                "give data sets of one size; `rauca efe train` and `finetune` also take a --size that divides both"
            )

    def get(self, index: int) -> LightFrame:
        """The frame at ``index``, from memory or from disk; raises :class:`RaucaError` naming a damaged file."""
        frame = self._frames.get(index)
        if frame is None:
            frame = self._frames[index] = self._read(self.places[index])
            self._held += frame.nbytes
        self._frames.move_to_end(index)
        while self._held > self._budget and len(self._frames) > 1:
            self._held -= self._frames.popitem(last=False)[1].nbytes
        return frame

    def vehicle(self, index: int) -> Vehicle:
        """The vehicle in the frame at ``index``."""
        number = self.places[index].dataset
        if number not in self._vehicles:
            self._vehicles[number] = load_vehicle(self.datasets[number].vehicle_folder, read_image)
        return self._vehicles[number]

    def render_plain(self, index: int) -> PlainShading:
        """Rasterize and shade the frame's view, anew at every call."""
        return plain_shading(self.vehicle(index), self.camera(index))

    def plain(self, index: int) -> PlainShading:
        """The same, kept per camera: weathers and locations share it."""
        place = self.places[index]
        camera = self.camera(index)
        pose = np.round(np.concatenate([camera.R, camera.t.reshape(3, 1)], 1), 9) + 0.0
        key = place.dataset, pose.tobytes() + camera.K.tobytes()
        found = self._shadings.pop(key, None) or self.render_plain(index)
        self._shadings[key] = found
        per_view = 5 * 4 * self.size**2
        while len(self._shadings) * per_view > self._budget and len(self._shadings) > 1:
            self._shadings.popitem(last=False)
        return found

    def split(self, by: SplitBy, share: float = 0.25, seed: int = 0) -> tuple[list[int], list[int]]:
        """Frames to train on and frames to test on, as indices.

        Whole locations, or whole views of the camera ring, are held out of every data set: ``share`` of them, at least
        one, drawn by ``seed`` and the plan's name, which stays when the folder is moved. Weathers are on both sides.
        Composed frames are never tested on, and trained on as :meth:`to_train_beside` says.

        Raises:
            RaucaError: a data set has a single location or view; nothing was rendered; as of ``to_train_beside``.
        """
        train: list[int] = []
        test: list[int] = []
        if all(place.frame.composed for place in self.places):
            raise RaucaError(
                f"{self.datasets[0].folder}: every frame was composed from others, to learn from, and none is left to "
                "test on; give a data set of `rauca dataset make` beside it, such as the one it was composed from"
            )
        for number, dataset in enumerate(self.datasets):
            members = [i for i in self._members(number) if not self.places[i].frame.composed]
            if not members:
                continue
            names = sorted({self._name(i, by) for i in members})
            if len(names) < 2:
                raise RaucaError(f"{dataset.folder}: has one {by}, none can be held out to test; choose another split")
            order = named_rng(seed, "split", by, dataset.plan.name).permutation(len(names))
            held_out = {names[k] for k in order[: max(1, round(share * len(names)))]} - {names[order[-1]]}
            for i in members:
                (test if self._name(i, by) in held_out else train).append(i)
        composed = [i for i, place in enumerate(self.places) if place.frame.composed]
        return train + self.to_train_beside(test, composed), test

    def to_train_beside(self, test: Sequence[int], wanted: Sequence[int]) -> list[int]:
        """Those of the ``wanted`` frames that show nothing of frames to ``test`` on: none composed from one of them.

        Raises:
            RaucaError: of a data set nothing is left.
        """
        sites = self._sites()
        hidden = {(sites[self.places[i].dataset], self.places[i].frame.id) for i in test}

        def shows_hidden(place: Place) -> bool:
            return any((sites[place.dataset], source) in hidden for source in place.frame.composed)

        kept = [i for i in wanted if not shows_hidden(self.places[i])]
        for number in sorted({self.places[i].dataset for i in wanted} - {self.places[i].dataset for i in kept}):
            raise RaucaError(
                f"{self.datasets[number].folder}: every frame was composed from frames that are held out to test on; "
                "hold out whole places: give data sets of several --locations, or other ones to test on"
            )
        return kept

    def has_rendered(self, number: int) -> bool:
        """Whether any frame of a data set was rendered, not composed."""
        return any(not self.places[i].frame.composed for i in self._members(number))

    def _members(self, number: int) -> list[int]:
        return [i for i, place in enumerate(self.places) if place.dataset == number]

    def _sites(self) -> list[int]:
        """A number for each data set: that of the first one of the same places, such as it was composed from."""
        plans = [
            replace(one.plan, name="", blender="", device=CPU, weathers=(), ring=NO_RING, recolor_share=0.0)
            for one in self.datasets
        ]
        return list(map(plans.index, plans))

    @cached_property
    def digest(self) -> str:
        """Names the data: plans and lists of frames."""
        plans = [dataset.plan.to_json() for dataset in self.datasets]
        text = json.dumps([plans, self.size, [(p.dataset, p.frame.id) for p in self.places]], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def _name(self, index: int, by: SplitBy) -> int:
        frame = self.places[index].frame
        return frame.location if by == "location" else frame.view

    def camera(self, index: int) -> Camera:
        """Of a frame in its vehicle's own axes, in pixels of the working size."""
        place = self.places[index]
        camera = place.frame.camera_in_vehicle
        shrunk = self.size / self.datasets[place.dataset].plan.size
        return replace(camera, K=np.diag([shrunk, shrunk, 1.0]) @ camera.K, width=self.size, height=self.size)

    def _read(self, place: Place) -> LightFrame:
        dataset, frame = self.datasets[place.dataset], place.frame
        folder, light, own = dataset.frame_folder(frame.id), load_exact(dataset, frame.id), dataset.plan.size
        image = read_picture(folder / "image.png", own)
        paint, vehicle = (read_picture(folder / f"{name}.png", own, grey=True) for name in ("paint", "vehicle"))
        A, B = (torch.from_numpy(m.transpose(2, 0, 1).copy()) for m in (light.A, light.B))
        reference = torch.from_numpy(color.srgb_to_linear(np.array(dataset.plan.reference_srgb) / 255.0))
        named = str(folder), frame.weather.name, frame.distance_m
        whole = LightFrame(*named, image, paint, vehicle, A.half(), B.half(), reference)
        return whole if own == self.size else shrink(whole, own // self.size)


def shrink(frame: LightFrame, factor: int) -> LightFrame:
    """The frame with squares of ``factor`` pixels averaged, in linear light, and displayed anew."""

    def mean(pixels: Tensor) -> Tensor:
        return functional.avg_pool2d(pixels.float(), factor)

    A, B = mean(frame.A), mean(frame.B)
    image = linear_to_srgb(A * frame.reference[:, None, None] + B)
    paint, vehicle = (mean(mask).round().byte() for mask in (frame.paint, frame.vehicle))
    return replace(frame, image=(image * 255).round().byte(), paint=paint, vehicle=vehicle, A=A.half(), B=B.half())


def read_picture(path: Path, size: int, grey: bool = False) -> Tensor:
    """An image of ``size`` x ``size`` pixels as uint8 (3, H, W), or (1, H, W) if grey."""
    pixels: NDArray[np.uint8] = read_image(path)
    wanted = (size, size) if grey else (size, size, 3)
    if pixels.shape != wanted:
        raise RaucaError(f"{path}: has shape {pixels.shape}, expected {wanted}; remove the frame and render it again")
    planes = pixels[None] if grey else pixels.transpose(2, 0, 1)
    return torch.from_numpy(planes.copy())
