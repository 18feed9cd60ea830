"""Our extractor beside what needs no training, per weather, against exact maps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ..contract import Progress
from ..contract.color import Color
from .extractor import LightSplitter
from .frames import LightFrame, LightFrames
from .methods import Render, exact_render, plain_render, splitter_render, transfer_render
from .metrics import Error, albedos, total

ALL = "all"


def compare(
    folders: Sequence[Path], net: LightSplitter, colors: Sequence[Color], progress: Callable[[Progress], None]
) -> dict[str, dict[str, dict[str, float]]]:
    """Errors in solid colors.

    Returns:
        Per weather and for ``all``, per method (none, transfer, ours): ``psnr_db, mse, mae, bce``, and ``ms`` per
        image: from the image to its light maps, before any color.
    """
    frames = LightFrames(folders)
    methods: dict[str, Callable[[int, LightFrame], Render]] = {
        "none": lambda i, frame: plain_render(frame, frames.render_plain(i)),
        "transfer": lambda i, frame: transfer_render(frame),
        "ours": lambda i, frame: splitter_render(net, frame),
    }
    errors: dict[tuple[str, str], Error] = {}
    seconds: dict[tuple[str, str], list[float]] = {}
    paints = albedos(colors)
    for index in range(len(frames)):
        frame = frames.get(index)
        truth = exact_render(frame)(paints)
        for name, method in methods.items():
            started = time.process_time()
            render = method(index, frame)
            spent = time.process_time() - started
            key = frame.weather, name
            errors[key] = errors.get(key, Error()) + Error.between(render(paints), truth, frame.paint)
            seconds.setdefault(key, []).append(spent)
        progress(Progress(index + 1, len(frames), frame.weather))
    weathers = sorted({weather for weather, _ in errors})
    return {
        weather: {name: _row(errors, seconds, weathers if weather == ALL else [weather], name) for name in methods}
        for weather in [*weathers, ALL]
    }


def _row(
    errors: dict[tuple[str, str], Error], seconds: dict[tuple[str, str], list[float]], weathers: list[str], name: str
) -> dict[str, float]:
    spent = [s for weather in weathers for s in seconds[weather, name]]
    found = total(errors[weather, name] for weather in weathers)
    return {**found.to_json(), "ms": round(1e3 * sum(spent) / len(spent), 3)}
