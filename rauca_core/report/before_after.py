"""One view before and after, for the head of a README: the vehicle in its own paint and in the camouflage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..detect import canonical
from ..runtime.images import read_image
from ..study.average_precision import IOU_THRESHOLD, best_score, box_overlaps
from ..study.study import Entry
from .frames import PICTURE_THRESHOLD, image_path, placed_frames, strongest_paint
from .pictures import CORRECT, TRUTH, label, thin
from .table import is_normal

HALF = 320  # pixels across either of the two views
_HEAD, _FOOT = 28, 46  # pixels above the views, for what each shows, and below them, for how to read them
_INK, _QUIET = "#14181d", "#4a525c"


def before_after(entry: Entry, detector: str) -> Image.Image | None:
    """Two views side by side, 640 px wide, from the same camera in the same weather: own paint and camouflage.

    Only the vehicle's box is drawn: the detector's best on it, blue, with its score; where that is below the threshold
    of a report's pictures, the true box, white. The view is the one with the median fall of that score among all of
    the entry's first weather: fog would hide from a reader what it shows.

    Returns:
        None where the vehicle was not seen in its own paint.

    Raises:
        RaucaError: an image or its detections are missing, or have changed since.
    """
    results, after = entry.results, strongest_paint(entry)
    before = next(filter(is_normal, results.paints), None)
    if before is None:
        return None
    weather = results.frames[0].weather
    among = [index for index, frame in enumerate(results.frames) if frame.weather == weather]
    (chosen,) = placed_frames(falls(entry, detector, before, after)[among], ("median",))
    index = among[chosen]
    views = [_view(entry, detector, paint, index) for paint in (before, after)]
    sheet = Image.new("RGB", (2 * HALF, _HEAD + views[0].height + _FOOT), "white")
    pen = ImageDraw.Draw(sheet)
    for place, (view, title) in enumerate(zip(views, ("own paint", f"camouflage ({after})"), strict=True)):
        sheet.paste(view, (place * HALF, _HEAD))
        pen.text((place * HALF + HALF / 2, _HEAD / 2), title, fill=_INK, font=ImageFont.load_default(17), anchor="mm")
    pen.line((HALF, 0, HALF, _HEAD + views[0].height), fill="white", width=2)
    _legend(pen, _HEAD + views[0].height, entry.category, detector)
    frame = results.frames[index]
    camera = f"{weather}, {frame.azimuth_deg:.0f}°, {frame.distance_m:g} m"
    said = f"{camera}:\nthe median fall among {len(among)} such views"
    at = 2 * HALF - 8, _HEAD + views[0].height + _FOOT / 2
    pen.text(at, said, fill=_QUIET, font=ImageFont.load_default(13), anchor="rm", align="right", spacing=5)
    return sheet


def falls(entry: Entry, detector: str, before: str, after: str) -> NDArray[np.float64]:
    """(F,) by how much the score with which a detector finds the vehicle falls in each frame, between two paints."""
    frames = range(len(entry.results.frames))
    scores = [[best_score(entry.recorded.sample(detector, paint, i)) for i in frames] for paint in (before, after)]
    return np.subtract(*np.array(scores, np.float64))


def _view(entry: Entry, detector: str, paint: str, index: int) -> Image.Image:
    """The frame, with the box that tells whether the vehicle was found."""
    pixels = read_image(image_path(entry, paint, index))
    height, width = pixels.shape[:2]
    scale = HALF / width
    picture = Image.fromarray(pixels).convert("RGB").resize((HALF, round(height * scale)), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(picture, "RGBA")
    found = entry.recorded.found(detector, paint, index)
    truth = np.array(entry.results.frames[index].box_xyxy, np.float64)
    name = canonical(entry.results.settings.category)
    named = found.only(name)
    scores = np.where(box_overlaps(named.boxes, truth) >= IOU_THRESHOLD, named.scores, 0.0)
    score = scores.max(initial=0.0)
    if score >= PICTURE_THRESHOLD:
        box, color = named.boxes[int(scores.argmax())], CORRECT
    else:
        box, color = truth, TRUTH
        thin(pen, truth * scale)
    label(pen, box * scale, f"{name} {score:.2f}", color, HALF)
    return picture


def _legend(pen: ImageDraw.ImageDraw, top: int, category: str, detector: str) -> None:
    font = ImageFont.load_default(13)
    lines = (
        (CORRECT, f"{detector} finds the {category}; its score"),
        (TRUTH, f"where the {category} is; {detector} stays below {PICTURE_THRESHOLD:g}"),
    )
    for line, (color, text) in enumerate(lines):
        y = top + 7 + 19 * line
        pen.rectangle((8, y, 24, y + 12), fill=color, outline=_QUIET)
        pen.text((32, y + 6), text, fill=_QUIET, font=font, anchor="lm")
