"""The renderer for loops of one's own: the optimizer's pictures, their gradient, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from benchmarks.stability.detectors import SmallDetector
from rauca_core.attack import DetectorEnsemble, make_settings
from rauca_core.attack.renderer import Renderer
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, RaucaError, load_camouflage
from rauca_core.runtime.images import read_image

SIDE = 32


@pytest.fixture
def render(dataset: Dataset) -> Renderer:
    return Renderer(dataset.folder, SIDE, samples=2)


def test_images_are_those_that_the_optimizer_steps_through(
    render: Renderer, dataset: Dataset, small_detector: SmallDetector
) -> None:
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), make_settings(map_size=SIDE, samples=2, batch=1))
    texture = run.pictures()[0]
    run.advance()
    run.close()
    images, boxes = render(texture)
    assert images.shape == (len(render), 3, 64, 64)
    alone = [render(texture, [index])[0][0] for index in range(len(render))]  # as the optimizer's batch of one
    assert any(torch.equal(run.last_image, image) for image in alone)
    assert torch.allclose(images, torch.stack(alone), rtol=0, atol=1e-6)
    assert [tuple(box.tolist()) for box in boxes] == [frame.box_xyxy for frame in render.frames]


def test_the_gradient_is_that_of_finite_differences(render: Renderer) -> None:
    generator = torch.Generator().manual_seed(0)
    texture = render.new_texture(seed=1).double().mul(0.8).add(0.1).requires_grad_()
    weights = torch.randn(2, 3, 64, 64, generator=generator, dtype=torch.float64)
    direction = torch.randn(texture.shape, generator=generator, dtype=torch.float64)

    def loss(at: torch.Tensor) -> torch.Tensor:
        return (render(at, [0, 3])[0] * weights).sum()

    (gradient,) = torch.autograd.grad(loss(texture), texture)
    step = 1e-5
    with torch.no_grad():
        found = (loss(texture + step * direction) - loss(texture - step * direction)) / (2 * step)
    assert float((gradient * direction).sum()) == pytest.approx(float(found), rel=1e-6)
    assert gradient.abs().amax(0).count_nonzero() > 0.1 * SIDE**2


def test_frames_are_named_by_index_id_or_themselves(render: Renderer) -> None:
    texture = render.new_texture()
    images, boxes = render(texture, [2, 1])
    named = render(texture, [render.frames[2], render.frames[1].id])
    assert torch.equal(named[0], images)
    assert torch.equal(named[1], boxes)
    assert not torch.equal(images[0], images[1])


def test_new_textures(render: Renderer) -> None:
    grey, noise = render.new_texture(requires_grad=True), render.new_texture(3)
    assert grey.shape == (3, SIDE, SIDE)
    assert grey.requires_grad
    assert grey.is_leaf
    assert (grey == 0.5).all()
    assert torch.equal(noise, render.new_texture(3))
    assert noise.std() > 0.2
    assert not noise.requires_grad


def test_a_texture_is_saved_as_a_camouflage_of_the_vehicle(render: Renderer, dataset: Dataset, tmp_path: Path) -> None:
    texture = render.new_texture(3)
    record, image = load_camouflage(render.save(texture, tmp_path / "mine.json", "mine"))
    assert (record.name, record.size, record.atlas_id) == ("mine", SIDE, dataset.plan.atlas_id)
    again = torch.from_numpy(read_image(image).copy()).permute(2, 0, 1) / 255
    assert (render(again, [0])[0] - render(texture, [0])[0]).abs().max() < 1 / 255


@pytest.mark.parametrize(
    ("texture", "frames", "says"),
    [
        (torch.zeros(3, SIDE, 2 * SIDE), None, r"\(3, 32, 64\); give \(3, 32, 32\)"),
        (torch.zeros(3, SIDE, SIDE, device="meta"), None, "lies on meta, the renderer on cpu"),
        (torch.zeros(3, SIDE, SIDE), [99], "there is no frame 99"),
        (torch.zeros(3, SIDE, SIDE), ["nowhere"], "nowhere is no finished frame"),
        (torch.zeros(3, SIDE, SIDE), [], "none is named"),
    ],
)
def test_refusals(render: Renderer, texture: torch.Tensor, frames: list[int | str] | None, says: str) -> None:
    with pytest.raises(RaucaError, match=says):
        render(texture, frames)
