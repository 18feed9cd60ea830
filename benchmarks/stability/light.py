"""Frames whose light is hard to split; the precision is that of network and pictures."""

from __future__ import annotations

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import Tensor

from rauca_core.contract import FramePasses, RaucaError, load_frame, save_frame
from rauca_core.environment import load_exact
from rauca_core.environment.estimate import split_light, surroundings
from rauca_core.environment.extractor import LightSplitter, PublishedEfe, fuse_published
from rauca_core.environment.losses import light_loss, weighted_bce
from rauca_core.environment.methods import transfer_light
from rauca_core.render.composite import linear_to_srgb, srgb_to_linear

from . import Checks, expect, wide
from .drawn import make_dataset, painted_box

SIZE = 37  # no multiple of anything
GREY = torch.full((2, 3), 0.26)
KINDS = ("plain", "black", "white", "one pixel", "no vehicle", "faint edge")
NO_QUANTILES = {torch.bfloat16: "frames are never bfloat16, and torch takes no quantiles of it"}
STORED = dict.fromkeys((torch.bfloat16, torch.float64), "files hold light as float16, read as float32")
BACK = 1e-5  # sRGB, of the reference given back: the maps are float32, whatever the network is
CHECKS = Checks("environment")


def frames(kind: str) -> tuple[Tensor, Tensor]:
    """Two frames (2, 3, H, W) and masks (2, 1, H, W) of a kind that happens."""
    image = torch.rand(2, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(0))
    if kind in ("black", "white"):
        image = torch.full_like(image, float(kind == "white"))
    mask = torch.zeros(2, 1, SIZE, SIZE)
    if kind == "one pixel":
        mask[:, :, 20, 20] = 1.0
    elif kind != "no vehicle":
        mask[:, :, 8:30, 5:33] = 1e-3 if kind == "faint edge" else 1.0
    return image, mask


def _network(dtype: torch.dtype) -> LightSplitter:
    """One that has not learnt anything and says all the more."""
    torch.manual_seed(0)
    net = LightSplitter()
    torch.nn.init.normal_(net.head.weight)
    return net.double() if dtype == torch.float64 else net


def _half(dtype: torch.dtype) -> torch.autocast:
    """bfloat16 as in training: the network's layers, not its pictures or weights."""
    return torch.autocast("cpu", torch.bfloat16, enabled=dtype == torch.bfloat16)


def _our_maps(dtype: torch.dtype, kind: str) -> str:
    image, mask = (t.to(wide(dtype)) for t in frames(kind))
    with _half(dtype), torch.no_grad():
        A, B = _network(dtype)(image, mask, GREY)
    expect(torch.isfinite(A).all() and torch.isfinite(B).all(), "maps are not finite")
    expect((A >= 0).all() and (B >= 0).all(), "light below 0")
    expect((A[(mask == 0).expand_as(A)] == 0).all(), "A reaches beyond the paint")
    unclipped = image < 0.98
    again = linear_to_srgb(A * GREY[:, :, None, None] + B)
    off = float((again - image)[unclipped].abs().max()) if unclipped.any() else 0.0
    expect(off <= BACK, f"the reference comes back {off:.1e} off")
    return f"reference off by {off:.0e}" if unclipped.any() else "finite; every pixel clipped"


def _around_the_vehicle(dtype: torch.dtype, kind: str) -> str | None:
    net = _network(dtype)
    image, mask = (t.to(wide(dtype)) for t in frames(kind))
    borders = ((image, 0.4), (mask, 0.0))
    image, mask = (torch.nn.functional.pad(t[0], (60, 60, 70, 30), value=v) for t, v in borders)
    with _half(dtype), torch.no_grad():
        A, B = split_light(net, image, mask, GREY[0])
        expect(torch.isfinite(A).all() and torch.isfinite(B).all(), "maps are not finite")
        expect((A[(mask == 0).expand_as(A)] == 0).all(), "A reaches beyond the paint")
        window = surroundings(mask[0] > 0)
        if window is None:
            expect(kind == "no vehicle", "the vehicle is not found")
            off = float((B - srgb_to_linear(image)).abs().max())
            expect(off < 1e-6, f"B is {off:.1e} from the frame")
            return "A = 0, B the frame"
        inside = (..., *window)
        alone = net(image[inside][None], mask[inside][None], GREY[:1])[0][0]
    expect(torch.equal(A[inside], alone), "differs from the vehicle's surroundings alone")
    expect(abs(float(mask.sum() - mask[inside].sum())) < 1e-6, "paint outside the window")
    corner = srgb_to_linear(image[0, 0, 0]).double()
    expect(torch.allclose(B[0, 0, 0].double(), corner), "the corner is not the frame's")
    return None


def _training(dtype: torch.dtype, kind: str) -> str:
    torch.manual_seed(1)
    net, published = LightSplitter().to(wide(dtype)), PublishedEfe((4, 6, 8)).to(wide(dtype))
    image, mask = (t.to(wide(dtype)) for t in frames(kind))
    A, B = srgb_to_linear(image) * mask, srgb_to_linear(image)
    with _half(dtype):
        predicted, latent = net(image, mask, GREY), published(image * mask)
    losses = []
    for texture in (0.0, 1.0, 0.4):
        albedo = torch.full((3, 2, 3, 1, 1), texture, dtype=wide(dtype))
        losses.append(light_loss(predicted, (A * 0, B * 1e4), albedo, mask))  # dense fog, a mirrored sun
        losses.append(light_loss(predicted, (A, B), albedo, mask))
        shown = fuse_published(torch.full_like(image, texture), *(m.to(image) for m in latent))
        losses.append(weighted_bce(shown, image * mask, mask))
    torch.stack(losses).sum().backward()
    gradients = [p.grad for p in (*net.parameters(), *published.parameters())]
    expect(all(torch.isfinite(loss) for loss in losses), f"losses {[float(x.detach()) for x in losses]}")
    expect(all(g is not None and torch.isfinite(g).all() for g in gradients), "gradients are not finite")
    return f"largest loss {max(float(x.detach()) for x in losses):.2g}"


for way, expected, body in (
    ("our extractor", "finite, at least 0, the reference given back", _our_maps),
    ("our extractor in a large frame", "as around its vehicle alone", _around_the_vehicle),
    ("training both extractors", "losses and gradients finite", _training),
):
    for frame in KINDS:
        CHECKS.case(f"{way}: {frame}", expected, kind=frame)(body)


@CHECKS.case("color transfer: flat frames", "finite, A at least 0", NO_QUANTILES)
def _color_transfer(dtype: torch.dtype) -> None:
    for value in (0.0, 1.0, 100.0):
        image = torch.full((3, SIZE, SIZE), value, dtype=dtype)
        for cover in (0.0, 1.0, 0.3):
            for albedo in (torch.zeros(3), torch.ones(3)):
                A, B = transfer_light(image, torch.full((1, SIZE, SIZE), cover, dtype=dtype), albedo.to(dtype))
                where = f"light {value:g}, coverage {cover:g}, albedo {albedo[0]:g}"
                expect(torch.isfinite(A).all() and torch.isfinite(B).all(), f"maps are not finite: {where}")
                expect((A >= 0).all(), f"A below 0: {where}")


@CHECKS.case("Eq. 5 at a wrong 0", "finite, with a gradient that leads away")
def _wrong_end(dtype: torch.dtype) -> str:
    x = torch.zeros(1, 3, 4, 4, dtype=dtype, requires_grad=True)
    ones = torch.ones(1, 3, 4, 4, dtype=dtype)
    loss = weighted_bce(x, ones, ones[:, :1])
    (gradient,) = torch.autograd.grad(loss, x)
    expect(torch.isfinite(loss), "the loss is not finite")
    expect(torch.isfinite(gradient).all() and (gradient < 0).all(), "the gradient does not lead away")
    return f"loss {float(loss.detach()):.1f}, gradient {float(gradient.sum()):.0f}"


@CHECKS.case("exact maps beyond float16", "held at its largest, 65504", STORED, value=1e6, wanted="read, up to 65504")
@CHECKS.case("exact maps with NaN", "refused by name", STORED, value=np.nan, wanted="refused, the file named")
def _stored_maps(dtype: torch.dtype, value: float, wanted: str) -> str:
    with TemporaryDirectory() as folder:
        dataset = make_dataset(Path(folder) / "data", painted_box(), 16, (40.0,))
        frame_id = next(iter(dataset.plan.frames()))[0]
        where = dataset.frame_folder(frame_id)
        stored = np.load(where / "passes.npz")
        A, B = stored["A"].astype(np.float32), stored["B"].astype(np.float32)
        B[3, 3] = value
        flat = np.zeros(A.shape[:2], np.float32)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "overflow encountered in cast", RuntimeWarning)
            save_frame(where, load_frame(where), FramePasses(np.zeros_like(A), flat, flat, flat, A, B))
        try:
            told = f"read, up to {load_exact(dataset, frame_id).B.max():.0f}"
        except RaucaError as error:
            expect("passes.npz: B holds NaN or infinity" in str(error), f"the file is not named: {error}")
            told = "refused, the file named"
    expect(told == wanted, told)
    return told
