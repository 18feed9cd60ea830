"""``rauca bench views-agreement``: do detectors see in a composed frame what they see in the rendered one?

Every rendered frame of a data set is composed from the others of its place and weather, so that its own light and
surroundings are unknown, and both are shown to detectors in the same paints. A frame's nearest source is missing then:
that is harder than composing a view between all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from scipy.stats import spearmanr
from torch import Tensor

from rauca_core.attack import load_paint, make_settings
from rauca_core.attack.frames import FrameStore, ReadyFrame, render_batch
from rauca_core.contract import Camouflage, Dataset, Frame, RaucaError, by_place_and_weather, load_camouflage
from rauca_core.contract.color import linear_to_srgb, srgb_to_linear, to_bytes
from rauca_core.contract.seeding import named_seed
from rauca_core.detect import class_index
from rauca_core.environment.views import Place, View, compose
from rauca_core.render import MipmappedTexture
from rauca_core.render import srgb_to_linear as tensor_to_linear
from rauca_core.study.average_precision import Sample, average_precision, best_score
from rauca_core.study.detectors import ALL, detectors_for
from rauca_core.study.job import Machine
from rauca_core.study.plain_cars import Look

from .harness import Results, Settings, counted

Samples = dict[tuple[str, str, str], list[Sample]]
"""Of every frame, by paint, detector and way."""
OWN, RANDOM = "own", "random"
AP_WITHIN, RANKS_AGREE = 0.03, 0.9
WORST = 6  # frames on the picture
WAYS = ("rendered", "composed")


def bench(
    out: Path,
    dataset: Path,
    camouflages: Sequence[Path] = (),
    detectors: Sequence[str] = (ALL,),
    frames: int = 200,
    device: str = "cpu",
) -> Results:
    """Measure AP@0.5 of both ways, and Spearman's correlation of each frame's best score that finds the vehicle.

    Args:
        dataset: rendered, with light maps, and at least two frames of some place and weather.
        camouflages: JSON files, of this vehicle and of one map size.
        frames: how many at most.

    Raises:
        RaucaError: no frame has another of its place and weather; composed frames; camouflages of other sizes or of
            another vehicle; no detector.
    """
    opened, records = Dataset(dataset), {path: load_camouflage(path)[0] for path in camouflages}
    opened.require_rendered("composed frames are compared with")
    sizes = {record.size for record in records.values()} or {1024}
    if len(sizes) > 1:
        raise RaucaError(f"--camouflage: the maps are {sorted(sizes)} texels wide; give those of one size")
    store = FrameStore(opened, make_settings(map_size=sizes.pop()), device)
    category = store.vehicle.category
    judges = [one for _, one in detectors_for(detectors, [category], Machine(device=device))[category]]
    chosen = _left_out(store.frames, frames)
    if not chosen:
        raise RaucaError(f"{dataset}: no two frames stand in one place and weather; make it with more views of each")
    textures, samples = _textures(store, records), Samples({})
    with counted("composing and detecting", len(chosen)) as moved:
        for frame, others in chosen:
            both = _both_ways(opened, store, frame, others)
            truths = np.array([frame.box_xyxy] * len(both), np.float64)
            for paint, texture in textures.items():
                images = torch.stack([_shown(ready, texture) for ready in both]).to(device)
                for judge in judges:
                    found = Look.at(judge, images, truths).samples(class_index(judge, category))
                    for way, sample in zip(WAYS, found, strict=True):
                        samples.setdefault((paint, judge.name, way), []).append(sample)
            moved(frame.id)
    results = Results("views-agreement", Settings(dataset=str(dataset), frames=len(chosen), paints=list(textures)))
    _tabulate(results, samples, [frame.weather.name for frame, _ in chosen])
    worst = _worst(samples)
    pairs = [(_both_ways(opened, store, *chosen[index]), textures[paint]) for paint, index, _ in worst]
    sheet = [[_shown(ready, texture) for ready in both] for both, texture in pairs]
    results.figures["worst"] = [
        {"paint": paint, "frame": chosen[index][0].id, "mean_difference": gap} for paint, index, gap in worst
    ]
    results.picture(lambda path: _save_sheet(path, sheet), ".png", "views-agreement.png")
    results.publish(out)
    return results


def _textures(store: FrameStore, records: dict[Path, Camouflage]) -> dict[str, MipmappedTexture | None]:
    """By paint; None is the reference paint that the frames were rendered in."""
    side, pyramid = store.layout.taps.pyramid.size, store.pyramid
    maps = {RANDOM: torch.rand((3, side, side), generator=torch.Generator().manual_seed(named_seed(0, "texture")))}
    for path, record in records.items():
        if record.atlas_id != store.vehicle.atlas_id:
            raise RaucaError(f"{path}: is of {record.vehicle_name}, with other UVs than this data set's vehicle")
        name = path.parent.name if path.stem == "camouflage" else path.stem
        maps[name] = torch.from_numpy(np.ascontiguousarray(load_paint(path).texture.transpose(2, 0, 1))).float() / 255
    return {OWN: None} | {
        name: MipmappedTexture(pyramid, tensor_to_linear(pyramid.from_map(one))) for name, one in maps.items()
    }


def _left_out(frames: Sequence[Frame], number: int) -> list[tuple[Frame, list[Frame]]]:
    """Frames spread over all places and weathers, each with the others of its own."""
    groups = by_place_and_weather(frames).values()
    pairs = [(frame, [f for f in some if f is not frame]) for some in groups if len(some) > 1 for frame in some]
    if len(pairs) <= number:
        return pairs
    return [pairs[int(place)] for place in np.linspace(0, len(pairs) - 1, number)]


def _both_ways(dataset: Dataset, store: FrameStore, frame: Frame, others: list[Frame]) -> tuple[ReadyFrame, ReadyFrame]:
    """A frame as it was rendered, and composed from the others."""
    reference = srgb_to_linear(np.array(dataset.plan.reference_srgb) / 255)
    ready = store.ready(next(place for place, one in enumerate(store.frames) if one.id == frame.id))
    passes = compose(Place.of(dataset, others), View.of(frame), store.vehicle, reference, dataset.plan.seed).passes
    assert passes.A is not None
    assert passes.B is not None
    A, B = (torch.from_numpy(m.reshape(-1, 3)[ready.taps.pixels]) for m in (passes.A, passes.B))
    picture = to_bytes(linear_to_srgb(passes.image_linear)).reshape(-1, 3)
    return ready, replace(ready, A=A, B=B, background=picture)


def _shown(ready: ReadyFrame, texture: MipmappedTexture | None) -> Tensor:
    """The frame (3, H, W) sRGB in [0, 1], in 8 bits as a picture file has it."""
    if texture is None:
        picture = ready.background.reshape(ready.taps.height, ready.taps.width, 3)
        return torch.from_numpy(picture).permute(2, 0, 1).float() / 255
    with torch.no_grad():
        return (render_batch([ready], texture)[0] * 255).round() / 255


def _tabulate(results: Results, samples: Samples, weathers: Sequence[str]) -> None:
    """A row per paint and detector, and one per weather, the mean of these rows over its frames alone."""
    pairs = list(dict.fromkeys((paint, judge) for paint, judge, _ in samples))
    for paint, judge in pairs:
        results.add("judges", paint=paint, detector=judge, **_agreement(*(samples[paint, judge, way] for way in WAYS)))
    for weather in dict.fromkeys(weathers):
        some = [index for index, name in enumerate(weathers) if name == weather]
        rows = [_agreement(*([samples[paint, judge, way][i] for i in some] for way in WAYS)) for paint, judge in pairs]
        means = {name: float(np.nanmean([row[name] for row in rows])) for name in rows[0]}
        results.add("weathers", weather=weather, frames=len(some), **means)
    rows = results.rows["judges"]
    gaps, ranks = [row["gap"] for row in rows], [row["spearman"] for row in rows]
    results.target("AP, farthest apart", AP_WITHIN, max(gaps), most=True)
    results.target("AP, apart on average", AP_WITHIN, float(np.mean(gaps)), most=True)
    results.target("Spearman's correlation of best scores, lowest", RANKS_AGREE, float(np.nanmin(ranks)))
    figures = {
        "AP rendered": "{rendered_ap:.3f}", "AP composed": "{composed_ap:.3f}", "apart": "{gap:.3f}",
        "Spearman": "{spearman:.3f}",
    }  # fmt: skip
    who = {"paint": "{paint}", "detector": "{detector}"}
    results.table("Detectors on composed frames and on rendered ones", {**who, **figures}, rows)
    where = {"weather": "{weather}", "frames": "{frames}"}
    results.table("By weather, means of all of these", {**where, **figures}, results.rows["weathers"])
    results.target_table()


def _agreement(rendered: list[Sample], composed: list[Sample]) -> dict[str, float]:
    """AP@0.5 of both, how far they are apart, and the correlation of the frames' best scores, NaN if all are alike."""
    scores = [[best_score(sample) for sample in some] for some in (rendered, composed)]
    varied = all(len(set(some)) > 1 for some in scores)
    ap = [average_precision(some) for some in (rendered, composed)]
    rank = float(spearmanr(*scores).statistic) if varied else float("nan")
    return {"rendered_ap": ap[0], "composed_ap": ap[1], "gap": abs(ap[0] - ap[1]), "spearman": rank}


def _worst(samples: Samples) -> list[tuple[str, int, float]]:
    """Paint, index of the frame, and mean difference over all judges, where best scores differ most."""
    rendered, composed = WAYS
    found: list[tuple[str, int, float]] = []
    for paint in dict.fromkeys(paint for paint, _, _ in samples):
        names = dict.fromkeys(judge for one, judge, _ in samples if one == paint)
        scores = {
            way: np.array([[best_score(sample) for sample in samples[paint, judge, way]] for judge in names])
            for way in WAYS
        }
        gaps = np.abs(scores[rendered] - scores[composed]).mean(0)
        found += [(paint, index, float(gap)) for index, gap in enumerate(gaps)]
    return sorted(found, key=lambda row: -row[2])[:WORST]


def _save_sheet(path: Path, pairs: Sequence[Sequence[Tensor]]) -> None:
    """Rendered above composed, a column per picture."""
    columns = [torch.cat(list(both), 1) for both in pairs]
    pixels = (torch.cat(columns, 2) * 255).byte().permute(1, 2, 0).numpy()
    Image.fromarray(pixels).save(path)
