"""rauca: measure and harden vehicle detectors against adversarial camouflage.

The public face: what the guide, the notebook and the command line use. A name is imported when it is first used, so
that ``import rauca_core as rauca`` costs nothing::

    import rauca_core as rauca

    data = rauca.make_dataset("runs/town", vehicle="sedan", weathers="demo")
    paint = rauca.optimize(data, [rauca.load_detector("yolov3-tiny")], method="ours", steps=600)
    study = rauca.evaluate(paint, ["yolov3-tiny", "yolov4-tiny"], weathers="unseen", frames=48)
    study.report("report.html")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .version import __version__

if TYPE_CHECKING:
    from .attack import Paint, Renderer, optimize
    from .attack import load_paint as load_camouflage
    from .contract import RaucaError
    from .dataset_tools import load_vehicle
    from .detect import load_detector
    from .report import Study, assess, evaluate
    from .study.datasets import Dataset, make_dataset
    from .study.harden import harden

_HOMES = {
    "Dataset": "study.datasets",
    "Paint": "attack",
    "RaucaError": "contract",
    "Renderer": "attack",
    "Study": "report",
    "assess": "report",
    "evaluate": "report",
    "harden": "study.harden",
    "load_camouflage": "attack:load_paint",
    "load_detector": "detect",
    "load_vehicle": "dataset_tools",
    "make_dataset": "study.datasets",
    "optimize": "attack",
}
"""Of each public name: the room that it comes from, and what it is called there if that is another name."""

__all__ = [
    "Dataset",
    "Paint",
    "RaucaError",
    "Renderer",
    "Study",
    "__version__",
    "assess",
    "evaluate",
    "harden",
    "load_camouflage",
    "load_detector",
    "load_vehicle",
    "make_dataset",
    "optimize",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room, _, there = _HOMES[name].partition(":")
    found = getattr(importlib.import_module(f".{room}", __name__), there or name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
