"""Views and textures that are hard to look up: the precision is that of the texels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from rauca_core.contract import Camera, RaucaError, Vehicle, color
from rauca_core.render import MipmappedTexture, Pyramid, build_taps, linear_to_srgb, rasterize, srgb_to_linear
from rauca_core.render.sampler import Sampler, look_up

from ..render_agreement import to_image
from . import Checks, expect
from .drawn import painted_box

MAP = 64
ASIDE = Camera.look_at(np.array([5.0, 3.5, 2.0]), np.array([0.0, 0.0, 0.7]), 50, 72, 64)
AHEAD = Camera.look_at(np.array([0.0, -6.0, 0.7]), np.array([0.0, 0.0, 0.7]), 40, 32, 32)
FAR = Camera.look_at(np.array([30.0, 20.0, 8.0]), np.zeros(3), 50, 64, 64)  # coarse mip levels
GRAZING = Camera.look_at(np.array([6.0, 1.25, 0.8]), np.array([0.0, 1.0, 0.7]), 50, 48, 48)
TOUCHING = Camera.look_at(np.array([1.9, 0.2, 0.7]), np.array([2.0, -1.0, 0.7]), 120, 40, 32)
AWAY = Camera.look_at(np.array([5.0, 0.0, 1.0]), np.array([9.0, 0.0, 1.0]), 50, 32, 32)
NO_TEXELS = dict.fromkeys((torch.bfloat16, torch.float64), "no texel is read")
ROUNDING = {torch.float32: 1e-5, torch.bfloat16: 4e-3, torch.float64: 1e-6}  # of a color; weights are float32
CHECKS = Checks("renderer")


def _box() -> tuple[Vehicle, Pyramid]:
    return painted_box(), Pyramid.of(painted_box(), MAP)


def _random_texels(pyramid: Pyramid, dtype: torch.dtype) -> Tensor:
    return torch.rand(len(pyramid.texels), 3, generator=torch.Generator().manual_seed(0)).to(dtype)


@CHECKS.case("no paint in view", "no taps, no gradient")
def _nothing_in_view(dtype: torch.dtype) -> None:
    pyramid = Pyramid.of(painted_box(), MAP)
    taps = build_taps(painted_box(), AWAY, MAP, pyramid=pyramid)
    texels = _random_texels(pyramid, dtype).requires_grad_()
    (gradient,) = torch.autograd.grad(MipmappedTexture(pyramid, texels).sample([taps.rows]).sum(), texels)
    expect(len(taps) == 0, f"{len(taps)} pixels have taps")
    expect(not gradient.any(), "texels have a gradient")


@CHECKS.case("no paint in view, all samplers", "no fragments", NO_TEXELS)
def _no_fragments(dtype: torch.dtype) -> None:
    box = painted_box()
    raster, pyramid = rasterize(box.positions, box.triangles, AWAY), Pyramid.of(box, MAP)
    for sampler in Sampler:
        found = look_up(box, raster, pyramid, sampler)
        expect(len(found.paint) == 0, f"{sampler}: {len(found.paint)} fragments")
        expect((found.index < 0).all(), f"{sampler}: samples point at fragments")


@CHECKS.case("empty paint mask", "refused by name", NO_TEXELS)
def _empty_mask(dtype: torch.dtype) -> str:
    box = painted_box()
    try:
        build_taps(replace(box, paint_mask=np.zeros_like(box.paint_mask)), AHEAD, MAP)
    except RaucaError as error:
        expect("paint" in str(error), f"the message does not say what is missing: {error}")
        return "refused by one line"
    expect(False, "taps without paint")
    return ""


@CHECKS.case("UV outside the map", "reads the map's border")
def _uv_outside_the_map(dtype: torch.dtype) -> str:
    box = painted_box()
    box.paint_mask[:] = 255
    pyramid = Pyramid.of(box, MAP)
    box.uvs[:2, :, 0] += 7.0  # the wall that the camera faces
    uv_map = torch.zeros(3, MAP, MAP, dtype=dtype)
    uv_map[:, :, -8:] = 1.0
    taps = build_taps(box, AHEAD, MAP, pyramid=pyramid)
    inside = torch.from_numpy(taps.alpha > 0.99)
    expect(int(inside.sum()) > 100, "the wall is not in the picture")
    off = float((taps.rows(pyramid(pyramid.from_map(uv_map)))[inside] - 1).abs().max())
    expect(off <= ROUNDING[dtype], f"{off:.1e} from the border's color")
    return f"the border's color, off by {off:.0e}"


@CHECKS.case("face without UV area", "reads one constant")
def _no_uv_area(dtype: torch.dtype) -> None:
    box, pyramid = _box()
    box.uvs[:2] = 0.25
    taps = build_taps(box, AHEAD, MAP, pyramid=pyramid)
    seen = taps.rows(pyramid(_random_texels(pyramid, dtype)))
    expect(len(seen) > 100, "the wall is not in the picture")
    spread = float((seen - seen[:1]).abs().max())
    expect(spread <= 1e-5, f"colors differ by {spread:.1e}")


@CHECKS.case("hard UVs, camera at the paint", "finite, in [0, 1], with every sampler")
def _hard_uvs_near_the_camera(dtype: torch.dtype) -> None:
    box = painted_box()
    box.uvs[:2] += 3.0
    box.uvs[2:4] = 0.2
    pyramid = Pyramid.of(box, MAP)
    levels = pyramid(_random_texels(pyramid, dtype))
    for sampler in Sampler:
        for camera in (ASIDE, TOUCHING):
            found = look_up(box, rasterize(box.positions, box.triangles, camera), pyramid, sampler)
            listed = found.inner(levels) if found.inner else levels
            weights = torch.from_numpy(found.weights).to(listed)
            read = (weights[..., None] * listed[torch.from_numpy(found.texels.astype(np.int64))]).sum(1)
            expect(len(read) > 100, f"{sampler}: nothing in the picture")
            expect(torch.isfinite(read).all(), f"{sampler}: colors are not finite")
            expect(np.isfinite(found.paint).all(), f"{sampler}: coverage is not finite")
            expect(float(read.min()) >= 0 and float(read.max()) <= 1 + 1e-5, f"{sampler}: colors outside [0, 1]")


@CHECKS.case("seams at coarse levels", "no color of the gutters")
def _gutters(dtype: torch.dtype) -> str:
    box, pyramid = _box()
    uv_map = torch.ones(3, MAP, MAP, dtype=dtype)
    uv_map.view(3, -1)[:, torch.from_numpy(pyramid.texels)] = 0.25
    seen = build_taps(box, FAR, MAP, pyramid=pyramid).rows(pyramid(pyramid.from_map(uv_map)))
    off = float((seen - 0.25).abs().max())
    expect(off <= ROUNDING[dtype], f"{off:.1e} of the gutters' color")
    return f"the paint's color, off by {off:.0e}"


@CHECKS.case("grazing angle", "the error falls with the samples")
def _grazing(dtype: torch.dtype) -> str:
    box = painted_box()
    pyramid = Pyramid.of(box, 2 * MAP)
    texels = _random_texels(pyramid, dtype)

    def image(samples: int) -> Tensor:
        taps = build_taps(box, GRAZING, 2 * MAP, samples, pyramid=pyramid)
        paint = taps.rows(pyramid(texels)) * torch.from_numpy(taps.alpha)[:, None]
        return to_image(taps, paint)

    best = image(16)
    errors = [float((image(s) - best).square().mean()) for s in (1, 2, 4)]
    expect(errors[0] > 2 * errors[1] > 4 * errors[2], f"squared errors {errors}")
    return "RMS error at 1, 2, 4 samples: " + ", ".join(f"{error**0.5:.3f}" for error in errors)


@CHECKS.case("constant texture", "its color, to rounding")
def _constant(dtype: torch.dtype) -> str:
    box, pyramid = _box()
    taps = build_taps(box, ASIDE, MAP, pyramid=pyramid)
    hue = torch.tensor([0.25, 0.5, 0.875], dtype=dtype)
    seen = taps.rows(pyramid(hue.expand(len(pyramid.texels), 3).contiguous()))
    off = float((seen - hue).abs().max())
    expect(off <= ROUNDING[dtype], f"{off:.1e} from the color")
    return f"the color, off by {off:.0e}"


@CHECKS.case("operator and gradient", "adjoint, to rounding")
def _adjoint(dtype: torch.dtype) -> str:
    rows = build_taps(painted_box(), ASIDE, MAP).rows
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(rows.shape[1], 3, generator=generator).to(dtype).requires_grad_()
    seen = rows(x)
    y = torch.randn(rows.shape[0], 3, generator=generator).to(seen)
    (gradient,) = torch.autograd.grad((seen * y).sum(), x)
    forward, backward = (
        float((seen * y).double().sum().detach()),
        float((x.detach().double() * gradient.double()).sum()),
    )
    scale = float(seen.detach().double().norm() * y.double().norm())
    off, bound = abs(forward - backward) / scale, {torch.float64: 1e-12, torch.float32: 1e-6}.get(dtype, 1e-3)
    expect(off <= bound, f"products with K and its gradient differ by {off:.1e} of |Kx||y|")
    return f"products with K and its gradient differ by {off:.0e}"


@CHECKS.case("gradients of 1e-7", "summed without loss, in float32 at least")
def _small_gradients(dtype: torch.dtype) -> str:
    rows = build_taps(painted_box(), ASIDE, MAP).rows
    x = torch.rand(rows.shape[1], 3).to(dtype).requires_grad_()
    asked = torch.full((rows.shape[0], 3), 1e-7)
    (gradient,) = torch.autograd.grad((rows(x) * asked).sum(), x)
    matrix = sparse.csr_array((rows.weights.astype(np.float64), rows.columns, rows.indptr), rows.shape)
    wanted = torch.from_numpy(matrix.T @ asked.double().numpy())
    reached = wanted > 1e-12
    off = float(((gradient.double() - wanted).abs() / wanted)[reached].max())
    bound = {torch.bfloat16: 4e-3}.get(dtype, 1e-5)
    expect(gradient.dtype == dtype, f"the gradient is {gradient.dtype}")
    expect(off <= bound, f"sums are off by {off:.1e}")
    return f"sums off by {off:.0e} from float64's"


@CHECKS.case("NaN in a gradient", "shown, and not kept for the next step")
def _nan_in_a_gradient(dtype: torch.dtype) -> None:
    box, pyramid = _box()
    rows = build_taps(box, ASIDE, MAP, pyramid=pyramid).rows
    texels = _random_texels(pyramid, dtype).requires_grad_()
    seen = MipmappedTexture(pyramid, texels).sample([rows])
    (bad,) = torch.autograd.grad(seen, texels, torch.full_like(seen, torch.nan))
    expect(bad.isnan().any(), "NaN is hidden")
    (good,) = torch.autograd.grad(MipmappedTexture(pyramid, texels).sample([rows]).sum(), texels)
    expect(torch.isfinite(good).all(), "NaN stays in the buffer")


@CHECKS.case("display: black, white, beyond, NaN", "the sRGB curve with finite slopes")
def _linear_to_srgb_at_its_ends(dtype: torch.dtype) -> str:
    linear = torch.tensor([-1.0, 0.0, 1e-9, 0.003, 0.0032, 0.2, 1.0, 1.5, 1e6], dtype=dtype, requires_grad=True)
    shown = linear_to_srgb(linear)
    (gradient,) = torch.autograd.grad(shown.sum(), linear)
    off = np.abs(shown.detach().double().numpy() - color.linear_to_srgb(linear.detach().double().numpy())).max()
    bound = {torch.bfloat16: 8e-3}.get(dtype, 1e-6)
    expect(off <= bound, f"{off:.1e} from the curve")
    expect(torch.isfinite(gradient).all(), "slopes are not finite")
    beyond = gradient[torch.tensor([0, 7, 8])]
    expect(not beyond.any(), "a slope beyond the range")
    expect(abs(float(gradient[1]) - 12.92) < 0.05, f"slope {float(gradient[1]):.3g} at black")
    expect(linear_to_srgb(torch.tensor(float("nan"), dtype=dtype)).isnan(), "NaN is hidden")
    return f"off by {off:.0e}, slope 12.9 at black, 0 beyond the range, NaN shown"


@CHECKS.case("decoding: black, white, beyond", "clipped, with finite slopes")
def _srgb_to_linear_at_its_ends(dtype: torch.dtype) -> None:
    srgb = torch.tensor([-0.2, 0.0, 0.03, 0.5, 1.0, 1.3], dtype=dtype, requires_grad=True)
    found = srgb_to_linear(srgb)
    (gradient,) = torch.autograd.grad(found.sum(), srgb)
    expect(found[0] == 0 and found[5] == 1, "not clipped")
    expect(torch.isfinite(gradient).all(), "slopes are not finite")
    expect(gradient[0] == 0 and gradient[5] == 0, "a slope beyond the range")
    expect((gradient[1:5] > 0).all(), "no slope within the range")
