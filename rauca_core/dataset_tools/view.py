"""``rauca dataset view``: a data set at a glance."""

from __future__ import annotations

import io
import string
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from PIL import Image

from ..contract import Dataset, Plan, Progress, RaucaError, frame_states
from ..contract.files import write_bytes
from .sheets import contact_sheet, frame_sheet
from .stored import StoredFrame, load_vehicle, targets_of

MOST_COLUMNS = 4
OVERLAYS = 6
GOLDEN = 0.6180339887


def view_dataset(
    folder: Path,
    out: Path,
    frames: Sequence[str] = (),
    views: Sequence[int] = (),
    progress: Callable[[Progress], None] = lambda _: None,
) -> Path:
    """Write ``out/contact-sheet.jpg``, ``out/overlays/<frame>.png`` and ``out/index.html`` that shows them.

    Args:
        frames: whose boxes and masks are shown; a few, spread over weathers and views, by default.
        views: the contact sheet's columns; up to four, spread over the ring, by default.

    Returns:
        the page, which is self-contained.

    Raises:
        RaucaError: no finished frame, or one asked for that there is not.
    """
    dataset = Dataset(folder)
    stored = {found.frame.id: found for found in StoredFrame.all_of(dataset, "show")}
    chosen = _chosen(folder, stored, frames)
    progress(Progress(0, len(chosen) + 1, "contact sheet"))
    sheet = _sheet(dataset, stored, views)
    write_bytes(out / "contact-sheet.jpg", _encoded(sheet, "JPEG", quality=88))
    own, overlays = load_vehicle(dataset.vehicle_folder).category, {}
    for done, found in enumerate(chosen, 1):
        progress(Progress(done, len(chosen) + 1, found.frame.id))
        overlays[found.frame.id] = frame_sheet(found, list(targets_of(found, own)))
        write_bytes(out / "overlays" / f"{found.frame.id}.png", _encoded(overlays[found.frame.id], "PNG"))
    page = _page(dataset, sheet, overlays)
    write_bytes(out / "index.html", page.encode())
    progress(Progress(len(chosen) + 1, len(chosen) + 1, ""))
    return out / "index.html"


def _chosen(folder: Path, stored: dict[str, StoredFrame], frames: Sequence[str]) -> list[StoredFrame]:
    for frame in frames:
        if frame not in stored:
            raise RaucaError(f"{folder}: has no finished frame {frame!r}; one is {next(iter(stored))!r}")
    if frames:
        return [stored[frame] for frame in frames]
    everyone = list(stored.values())
    # Steps of the golden ratio: in a list of weathers by views they meet ever other ones of both.
    places = {int(step * GOLDEN % 1 * len(everyone)) for step in range(OVERLAYS)}
    return [everyone[place] for place in sorted(places)]


def _sheet(dataset: Dataset, stored: dict[str, StoredFrame], views: Sequence[int]) -> Image.Image:
    """Rows of weathers, columns of places and views."""
    plan = dataset.plan
    for view in views:
        if not 0 <= view < plan.views:
            raise RaucaError(f"{dataset.folder}: has views 0 to {plan.views - 1}, not {view}")
    places = columns_of(plan, views)
    by_place = {(s.frame.location, s.frame.view, s.frame.weather.name): s for s in stored.values()}
    rows = {weather.name: [by_place.get((*place, weather.name)) for place in places] for weather in plan.weathers}
    return contact_sheet(plan.name, rows, [_column(plan, *place) for place in places])


def columns_of(plan: Plan, views: Sequence[int] = ()) -> list[tuple[int, int]]:
    """(location, view) of the contact sheet's columns, each in another location as long as there are more."""
    around, count = plan.views, len(views) or MOST_COLUMNS
    evenly = [(2 * i + 1) * around // (2 * MOST_COLUMNS) for i in range(MOST_COLUMNS)]
    chosen = list(views) or (evenly if around > MOST_COLUMNS else list(range(around)))
    return list(dict.fromkeys((i % plan.locations, chosen[i % len(chosen)]) for i in range(count)))


def _column(plan: Plan, location: int, view: int) -> str:
    azimuth, elevation, distance = plan.ring.nominal(view)
    place = f"place {location}, " if plan.locations > 1 else ""
    return f"{place}{azimuth:.0f}°, {elevation:.0f}° up, {distance:g} m"


def _page(dataset: Dataset, sheet: Image.Image, overlays: dict[str, Image.Image]) -> str:
    plan = dataset.plan
    states = Counter(frame_states(dataset.folder).values())
    facts = {
        "vehicle": plan.vehicle_name,
        "frames": f"{states['done']} of {len(plan.frames())}, {plan.size}x{plan.size} pixels",
        "kept out": f"{states['occluded']} with less than {100 * plan.min_visible:.0f} % of their paint visible",
        "weathers": len(plan.weathers),
        "cameras": f"{plan.views} views of {plan.locations} places",
    }
    page = string.Template(Path(__file__).with_name("view.html").read_text(encoding="utf-8"))
    return page.substitute(
        name=escape(plan.name),
        facts="".join(f"<tr><th>{escape(k)}</th><td>{escape(str(v))}</td></tr>" for k, v in facts.items()),
        sheet=_figure(sheet, "contact sheet"),
        frames="".join(_figure(picture, name) for name, picture in overlays.items()),
    )


def _figure(picture: Image.Image, name: str) -> str:
    data = b64encode(_encoded(picture, "JPEG", quality=88)).decode()
    return f'<img src="data:image/jpeg;base64,{data}" alt="{escape(name, quote=True)}">\n'


def _encoded(picture: Image.Image, form: str, **options: int) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, form, optimize=True, **options)
    return stream.getvalue()
