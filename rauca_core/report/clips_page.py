"""A study of clips as one HTML file: warning lost, a strip and a short animation of plain against camouflage."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ..contract.files import write_bytes
from ..motion.metrics import SAME, overlap
from ..motion.tracks import Boxes
from ..motion.warning import BRAKING_M_S2, REACTION_S
from ..runtime.images import read_image
from ..study.candidates import NORMAL
from ..study.driven import FILE_NAME, Clip, Driven, Drives, Mean, by_detector, clips_of, most_lost, tracked
from ..study.study import Entry, Study
from .frames import Grid, Picture
from .page import write_study_page
from .pictures import CORRECT, TRUTH, WRONG, as_jpeg, label, thin
from .table import Cell, Column, Row, Source, Table, listing

COLUMNS = (
    Column("AP@0.5"), Column("warning lost, m", kind="number"), Column("warning lost, s", kind="loss"),
    Column("longest gap, s", kind="loss"), Column("blind while braking", kind="share"), Column("breaks", kind="count"),
    Column("other track", kind="count"), Column("HOTA"),
)  # fmt: skip
SIDE = 320  # pixels of a picture
STRIP = 6  # frames of a strip
SLOWED = 2  # times that the animation is slower than the drive
_LIMITS = (
    "Warning is counted from the vehicle's first appearance in a clip to its first confirmed track; clips are short: "
    "a vehicle that is never tracked costs no more than the clip.",
    f"Braking distance is that of {BRAKING_M_S2:g} m/s2 after {REACTION_S:g} s, of the closing speed.",
    "A real stack knows more than one camera tells it, and another tracker forgets and joins otherwise.",
)


def write_clips(study: Study, drives: Drives, out: Path) -> list[Path]:
    """Write the page to ``out`` (.html), its numbers (.csv, .json) and the animation (.webp) beside it.

    Raises:
        RaucaError: images or detections that are missing.
    """
    tables = clip_tables(drives, Source(out.parent / FILE_NAME, ("rows",)))
    shown, grid, film = most_lost(drives), None, None
    if shown is not None:
        (entry,) = study.of(vehicle=shown.vehicle, weathers=shown.weathers, defence=shown.defence)
        clip, pictures = _pictures(entry, shown, drives.tracker)
        grid = _strip(clip, pictures, shown)
        film = out.with_suffix(".webp")
        write_bytes(film, _animation(clip, pictures))
    told = {
        "title": "Clips: warning lost",
        "lead": [_sentence(shown)] if shown else [],
        "tables": tables,
        "grid": grid,
        "shown": shown,
        "film": film.name if film else "",
        "film_bytes": film.read_bytes() if film else b"",
        "tracker": drives.tracker,
    }
    settings = {"tracker": drives.tracker}
    pages = write_study_page(study, out, "clips.html", told, tables, {}, settings, limits=_LIMITS, latex=False)
    return [*pages, *([film] if film else [])]


def _sentence(row: Driven) -> str:
    return (
        f"{row.detector} loses most in {row.paint}: {row.lost_m.value:.1f} m and {row.lost_s.value:.2f} s of warning "
        f"against the plain vehicle, mean over {row.clips} clips; the longest gap lasts {row.gap_s:.2f} s."
    )


def clip_tables(drives: Drives, source: Source) -> list[Table]:
    """What clips say, a table for each vehicle, set of weathers, defence and detector."""
    return [_table(key, rows, source) for key, rows in by_detector(drives).items()]


def _table(key: tuple[str, str, str, str], rows: Sequence[Driven], source: Source) -> Table:
    def mean(of: Mean) -> Cell:
        return Cell(of.value, of.low, of.high, source)

    lines = [
        Row(
            row.paint,
            (
                Cell(row.ap, source=source), mean(row.lost_m), mean(row.lost_s), Cell(row.gap_s, source=source),
                None if row.blind is None else Cell(row.blind, source=source), Cell(row.breaks, source=source),
                Cell(row.switches, source=source), Cell(row.hota, source=source),
            ),
        )
        for row in rows
    ]  # fmt: skip
    vehicle, weathers, defence, detector = key
    title = f"{detector}, {vehicle}, {weathers}" + ("" if defence == "none" else f", behind {defence}")
    return listing(f"clips-{vehicle}-{weathers}-{defence}-{detector}", "paint", COLUMNS, tuple(lines), title)


def _pictures(entry: Entry, shown: Driven, tracker: str) -> tuple[Clip, dict[str, list[Image.Image]]]:
    """A clip, an approach where there is one, with its tracks in plain and in a camouflage."""
    clips = clips_of(entry)
    clip = next((one for one in clips if "approach" in one.name), clips[0])
    return clip, {
        paint: [
            _picture(entry, paint, clip, number, boxes)
            for number, boxes in enumerate(tracked(entry, clip, shown.detector, paint, tracker))
        ]
        for paint in (NORMAL, shown.paint)
    }


def _picture(entry: Entry, paint: str, clip: Clip, number: int, tracks: Boxes) -> Image.Image:
    """A frame with the true box (thin, white) and its tracks: blue has the vehicle, red does not."""
    place, frame = clip.places[number], clip.frames[number]
    if place is None:  # nothing of the vehicle is in it, so it is the same in every paint
        assert entry.views is not None
        path = entry.views / "frames" / frame.id / "image.png"
    else:
        path = entry.folder / entry.results.images[paint][place].path
    scale = SIDE / frame.camera.width
    picture = Image.fromarray(read_image(path)).convert("RGB").resize((SIDE, SIDE), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(picture, "RGBA")
    truth: NDArray[np.float64] = np.array([frame.box_xyxy] if frame.box_xyxy else []).reshape(-1, 4)
    for box in truth:
        thin(pen, box * scale)
    for box, number_of in zip(tracks.xyxy, tracks.values.tolist(), strict=True):
        right = bool((overlap(box[None], truth) >= SAME).any())
        label(pen, box * scale, f"{number_of}", CORRECT if right else WRONG, SIDE)
    words = f"{paint}  {frame.time_s:.2f} s  {frame.distance_m:.1f} m"
    pen.rectangle((0, 0, SIDE, 15), fill="#10141890")
    pen.text((4, 2), words, fill=TRUTH)
    return picture


def _strip(clip: Clip, pictures: dict[str, list[Image.Image]], shown: Driven) -> Grid:
    chosen = np.unique(np.linspace(0, len(clip.frames) - 1, STRIP).round().astype(int)).tolist()
    titles = [f"{clip.frames[i].time_s:.2f} s\n{clip.frames[i].distance_m:.1f} m" for i in chosen]
    rows = {
        paint: [Picture(as_jpeg(some[i]), f"{paint}, {titles[n]}, {shown.detector}") for n, i in enumerate(chosen)]
        for paint, some in pictures.items()
    }
    return Grid(titles, rows)


def _animation(clip: Clip, pictures: dict[str, list[Image.Image]]) -> bytes:
    """All frames, the paints beside each other, as an animated WebP."""
    films = []
    for some in zip(*pictures.values(), strict=True):
        film = Image.new("RGB", (SIDE * len(some), SIDE))
        for column, picture in enumerate(some):
            film.paste(picture, (SIDE * column, 0))
        films.append(film)
    step_ms = round(1000 * SLOWED * clip.drive.frame_s)
    stream = io.BytesIO()
    films[0].save(
        stream, "WEBP", save_all=True, append_images=films[1:], duration=step_ms, loop=0, quality=70, method=4
    )
    return stream.getvalue()
