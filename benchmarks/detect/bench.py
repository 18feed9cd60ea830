"""The order of events of ``rauca bench detect``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.page import fill_page
from pipelines.console import progress_bar
from rauca_core.contract import Progress, RaucaError
from rauca_core.contract.files import write_json
from rauca_core.detect.listing import listing
from rauca_core.detect.sources import Family

from . import frameworks, opencv, runtime
from .contender import Contender
from .images import choose_images
from .measure import measure, one_core
from .report import markdown_report, print_report
from .results import Adapter, Results

IMAGES = 20
Maker = Callable[[], AbstractContextManager[Contender]]


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    Attributes:
        timed: images per race; the difference is taken on all twenty.
        framework_images: all is done on so many where a forward pass takes seconds.
        torchvision, transformers: architectures with random weights.
    """

    timed: int
    framework_images: int
    torchvision: tuple[str, ...]
    transformers: tuple[str, ...]


LIGHT = ("fasterrcnn_mobilenet_v3_large_320_fpn", "ssdlite320_mobilenet_v3_large")
FULL = Extent(20, 20, (*LIGHT, "fasterrcnn_resnet50_fpn"), ("Detr", "DeformableDetr", "RTDetr"))
QUICK = Extent(7, 3, LIGHT, ("DeformableDetr",))


def bench_detect(out: Path, quick: bool = False, docs: Path | None = None, dataset: Path | None = None) -> Results:
    """Measure every standard detector that is ready, and the frameworks' with random weights; write ``out`` (JSON).

    Args:
        docs: folder whose `detectors.md` gets the figures anew.
        dataset: whose frames are detected in; the demo's held-out ones, or drawn pictures, by default.
    """
    return run_bench(QUICK if quick else FULL, out, docs, dataset)


def run_bench(extent: Extent, out: Path, docs: Path | None = None, dataset: Path | None = None) -> Results:
    """The same, of any extent."""
    one_core()
    source, images = choose_images(dataset, IMAGES)
    contenders, missing = list(_standard(extent)), []
    adapters: list[Adapter] = []
    with progress_bar("detectors", every_step=True, resumes=False) as move:
        for index, (name, make, of_framework) in enumerate(contenders):
            move(Progress(index, len(contenders), name))
            count = extent.framework_images if of_framework else IMAGES
            try:
                with make() as contender:
                    adapters.append(measure(contender, images[:count], min(extent.timed, count)))
            except RaucaError as error:
                missing.append((name, str(error)))
        move(Progress(len(contenders), len(contenders), ""))
    results = Results(len(images), source, tuple(adapters), (*missing, *_unready()))
    print_report(results)
    write_json(out, results.to_json())
    if docs is not None:
        fill_page(docs / "detectors.md", markdown_report(results), "detect")
    return results


def _standard(extent: Extent) -> Iterator[tuple[str, Maker, bool]]:
    """Name, maker and whether it is a framework's."""
    makers: dict[Family, Callable[..., AbstractContextManager[Contender]]] = {
        "darknet": opencv.darknet,
        "tf-ssd": opencv.tensorflow,
        "caffe-ssd": opencv.caffe,
        "onnx": runtime.yolox,
    }
    for entry in listing():
        if entry.ready and entry.source.standard:
            yield entry.source.name, partial(makers[entry.source.family], entry.source), False
    for architecture in extent.torchvision:
        yield architecture, partial(frameworks.torchvision, architecture), True
    for prefix in extent.transformers:
        yield prefix, partial(frameworks.transformers, prefix), True


def _unready() -> list[tuple[str, str]]:
    return [(e.source.name, "; ".join(e.remedies)) for e in listing() if e.source.standard and not e.ready]
