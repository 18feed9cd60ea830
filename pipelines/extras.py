"""Which extra of rauca brings a package that a command has missed."""

from __future__ import annotations

EXTRAS = {
    "bpy": "dataset",
    "xatlas": "dataset",
    "tensorboard": "optimize",
    "matplotlib": "report",
    "faster_coco_eval": "report",
    "jinja2": "report",
}


def missing(error: ModuleNotFoundError) -> str:
    """What to do about a package that is not installed.

    Raises:
        ModuleNotFoundError: the same, of a module that no extra brings: a fault of ours.
    """
    package = (error.name or "").partition(".")[0]
    if package not in EXTRAS:
        raise error
    return f"{package} is not installed; get it with `pip install 'rauca[{EXTRAS[package]}]'`"
