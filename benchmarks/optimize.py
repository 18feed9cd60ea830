"""``rauca bench optimize``: where the milliseconds of a step go, and with Algorithm 2 in place of taps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import torch
from torch import Tensor

from rauca_core.attack import DetectorEnsemble, StepReport, make_settings
from rauca_core.attack.frames import ReadyFrame, shade
from rauca_core.attack.history import STAGES, Stopwatch
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset
from rauca_core.contract.towns import TRAINING
from rauca_core.detect import fetch, load_detector
from rauca_core.render import Sampler, SparseOperator, srgb_to_linear
from rauca_core.runtime.devices import keep_large_blocks, threads

from .algorithm2 import Facets, fill, pixels_from_cells
from .harness import Results, Settings, counted
from .in_blender import Wanted, make_dataset, weathers_of

FULL = Settings(
    size=320,  # of the frames, pixels; the default of ``rauca dataset make``
    detector="yolov3-tiny",  # the white box
    detector_size=416,  # its square input, pixels
    map_size=1024,  # of the UV map, texels
    batch=4,  # frames per step
    views=6,  # cameras of the data set, each in all weathers
    weathers=("sun90-fog0", "sun30-fog50"),  # of the preset ``base``
    warm_up=6,  # steps of every contender, not counted; then ``rounds`` times ``steps`` of them, by turns
    rounds=5,
    steps=12,
)
QUICK = FULL.but(views=2, weathers=("sun90-fog0",), warm_up=2, rounds=2, steps=4)


def bench(out: Path, settings: Settings, docs: Path | None = None) -> Results:
    """Time the steps of an optimization by stage, on one thread: three renderers by turns.

    Raises:
        RaucaError: Blender or the detector's weights are missing.
    """
    fetch(settings.detector)
    keep_large_blocks()
    options = (
        f"--size {settings.size} --locations 1 --azimuths {settings.views} --elevations 12 --distances 7 "
        f"--jitter-azimuth 20 --jitter-distance 0.3 --min-visible 0.4 --seed {TRAINING['bench optimize']}"
    )
    wanted = Wanted("optimize", "sedan", weathers_of(settings.weathers), options)
    dataset = make_dataset(wanted, out.parent / "optimize")
    results = Results("optimize", settings)
    with threads(1):
        for name, reports in _measure(dataset, settings).items():
            step_ms = 1e3 * median(report.seconds for report in reports)
            results.add(
                "contenders",
                name=name,
                **{f"{stage}_ms": 1e3 * median(report.stages[stage] for report in reports) for stage in STAGES},
                step_ms=step_ms,
                non_detector_share=median(1 - report.stages["detector"] / report.seconds for report in reports),
                images_per_second=settings.batch * 1e3 / step_ms,
            )
    columns = {
        "renderer": "{name}", **{stage: f"{{{stage}_ms:.1f}}" for stage in STAGES}, "step": "{step_ms:.0f}",
        "not detector": "{non_detector_share:.1%}", "images/s": "{images_per_second:.1f}",
    }  # fmt: skip
    title = (
        f"Milliseconds of a step by stage: {settings.batch} frames of {settings.size} px, {settings.detector} at "
        f"{settings.detector_size}, UV map of {settings.map_size}, one thread"
    )
    results.table(title, columns, results.rows["contenders"])
    share = 100 * results.rows["contenders"][0]["non_detector_share"]
    results.target("share of a step outside the detector", 15, share, "%", most=True)
    results.target_table()
    results.publish(out, docs, "optimizer.md", width=140)
    return results


def _measure(dataset: Dataset, settings: Settings) -> dict[str, list[StepReport]]:
    ensemble = DetectorEnsemble([load_detector(settings.detector, settings.detector_size)], "car")
    chosen = {"batch": settings.batch, "map_size": settings.map_size, "lr": 0.01, "threads": 1, "start": "plain"}
    as_taps = {"sampler": Sampler.UV_TRAVERSAL, "samples": 2, "pixel_filter": "box"}
    runs = {
        "taps": Run(dataset, ensemble, make_settings(**chosen)),
        "algorithm 2, as taps": Run(dataset, ensemble, make_settings(**chosen, **as_taps)),
        "algorithm 2": Algorithm2Run(dataset, ensemble, make_settings(**chosen)),
    }
    reports: dict[str, list[StepReport]] = {name: [] for name in runs}
    with counted("optimizing", len(runs) * (settings.warm_up + settings.rounds * settings.steps)) as moved:
        for number in range(-1, settings.rounds):  # round -1 builds taps, compiles and is not counted
            for name, run in runs.items():
                for _ in range(settings.warm_up if number < 0 else settings.steps):
                    report = run.advance()
                    reports[name] += [report] if number >= 0 else []
                    moved(name)
    for run in runs.values():
        run.close()
    return reports


class Algorithm2Run(Run):
    """A run whose frames read the facet texture tensor; everything else is shared with :class:`Run`."""

    def __init__(self, dataset: Dataset, *given: Any) -> None:
        super().__init__(dataset, *given)
        self._facets = Facets.of(self.store.vehicle, self.settings.map_size)
        self._views: dict[str, ReadyFrame] = {}
        for i in range(len(self.store)):  # what depends on geometry alone is no part of the steps that are timed
            self._view(self.store.ready(i))

    def _render(self, batch: list[ReadyFrame], watch: Stopwatch) -> Tensor:
        with watch.time("taps"):
            frames = [self._view(frame) for frame in batch]
            size, texels = self.settings.map_size, srgb_to_linear(self.texture.texels())
            flat = texels.new_zeros(size**2, 3)
            uv_map = flat.index_copy(0, torch.from_numpy(self.store.pyramid.texels), texels).reshape(size, size, 3)
            cells = fill(uv_map, self._facets)
            albedo = torch.cat([frame.taps.rows(cells) for frame in frames])
        with watch.time("environment"):
            return shade(frames, albedo)

    def _view(self, frame: ReadyFrame) -> ReadyFrame:
        """The frame, its light at the pixels that Algorithm 2 covers."""
        if frame.frame.id not in self._views:
            pixels, rows = pixels_from_cells(self.store.vehicle, frame.frame.camera_in_vehicle)
            light, _ = self.store.light.of(frame.frame)
            A, B = (torch.from_numpy(m.reshape(-1, 3)[pixels]) for m in (light.A, light.B))
            taps = _Cells(rows, pixels, frame.taps.width, frame.taps.height)
            self._views[frame.frame.id] = replace(frame, taps=taps, A=A, B=B)  # type: ignore[arg-type]
        return self._views[frame.frame.id]


class _Cells(NamedTuple):
    """Stands where taps do: rows read cells, not texels."""

    rows: SparseOperator
    pixels: Any
    width: int
    height: int
