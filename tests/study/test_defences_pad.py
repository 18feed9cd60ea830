"""PAD's heat maps against their definitions, and its mask on pictures with a patch pasted in."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.runtime.images import read_image
from rauca_core.study.defences import heat_maps as recompression
from rauca_core.study.defences.heat_maps import mutual_information_map, recompression_map, window_side
from rauca_core.study.defences.pad import GraphSegments, Pad

TOWN = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "town.jpg"
SIDE = 320


@pytest.fixture(scope="module")
def views() -> list[NDArray[np.uint8]]:
    """Square parts of a rendered town, as large as a data set's frames."""
    town = read_image(TOWN)
    scale = SIDE / min(town.shape[:2])
    town = cv2.resize(town, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    starts = np.linspace(0, town.shape[1] - SIDE, 3).astype(int)
    return [np.ascontiguousarray(town[:SIDE, start : start + SIDE]) for start in starts]


def direct_mutual_information(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Sum of p(x, y) log(p(x, y) / (p(x) p(y))) over the joint histogram, nats."""
    joint, _, _ = np.histogram2d(a.ravel(), b.ravel(), bins=256, range=((0, 256), (0, 256)))
    joint /= joint.sum()
    independent = joint.sum(1, keepdims=True) * joint.sum(0, keepdims=True)
    some = joint > 0
    return float((joint[some] * np.log(joint[some] / independent[some])).sum())


def test_mutual_information_is_the_mean_over_touching_windows() -> None:
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 256, (36, 44), np.uint8)
    grey[:, :20] //= 60  # few levels: windows there share much less than their size allows
    heat = mutual_information_map(grey)
    mirrored = np.pad(grey, 4, mode="symmetric")

    def at(row: int, column: int) -> float:
        """Of the window around the pixel edge (4 row, 4 column)."""
        here = mirrored[4 * row :, 4 * column :][:8, :8]
        found = []
        for dy, dx in ((-8, 0), (8, 0), (0, -8), (0, 8)):
            top, left = 4 * row + dy, 4 * column + dx
            if top >= 0 and left >= 0 and top + 8 <= mirrored.shape[0] and left + 8 <= mirrored.shape[1]:
                found.append(direct_mutual_information(here, mirrored[top : top + 8, left : left + 8]))
        return float(np.mean(found))

    for row, column in ((0, 0), (4, 4), (5, 9), (8, 10), (1, 6)):
        corners = [(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)]
        # Half a pixel from the edge: 1/8 of the way to the next center along each axis.
        weights = (49 / 64, 7 / 64, 7 / 64, 1 / 64)
        expected = sum(weight * at(*corner) for weight, corner in zip(weights, corners, strict=True))
        assert heat[4 * row, 4 * column] == pytest.approx(expected, abs=0.02)  # remap rounds positions to 1/32


def test_windows_grow_with_the_image() -> None:
    assert [window_side(*size) for size in ((8, 8), (320, 416), (1080, 1920), (2160, 100))] == [8, 8, 20, 22]


def test_flat_images_are_neither_hot_nor_masked() -> None:
    for level in (0, 127, 255):
        pixels = np.full((64, 64, 3), level, np.uint8)
        assert float(np.abs(mutual_information_map(pixels[:, :, 0])).max()) < 1e-6
        assert float(recompression_map(pixels).max()) == 0
        assert not Pad().mask(pixels).any()


def test_recompression_is_the_mean_of_scaled_box_means(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recompression, "QUALITIES", (55, 90))
    pixels = np.random.default_rng(0).integers(0, 256, (19, 26, 3), np.uint8)
    pixels[:, 13:] //= 4
    expected = np.zeros((19, 26))
    for quality in (55, 90):
        _, data = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
        saved = cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        squared = ((pixels.astype(float) - saved) ** 2).mean(2)
        mirrored = np.pad(squared, 8, mode="symmetric")
        means = np.array([[mirrored[y : y + 17, x : x + 17].mean() for x in range(26)] for y in range(19)])
        expected += (means - means.min()) / np.ptp(means) / 2
    np.testing.assert_allclose(recompression_map(pixels), expected, atol=1e-5)


@pytest.mark.parametrize("block", [1, 4], ids=["noise", "coarse noise"])
def test_pad_finds_a_patch_in_a_rendered_view(views: list[NDArray[np.uint8]], block: int) -> None:
    rng = np.random.default_rng(0)
    for view, (top, left) in zip(views, ((150, 40), (30, 180), (110, 110)), strict=True):
        patch = rng.integers(0, 256, (120 // block, 120 // block, 3), np.uint8).repeat(block, 0).repeat(block, 1)
        pixels, truth = view.copy(), np.zeros((SIDE, SIDE), bool)
        pixels[top : top + 120, left : left + 120] = patch
        truth[top : top + 120, left : left + 120] = True
        found = Pad().mask(pixels)
        assert (found & truth).sum() / truth.sum() > 0.8
        assert (found & truth).sum() / (found | truth).sum() > 0.5


def test_the_mask_is_whole_segments_of_suspect_heat(views: list[NDArray[np.uint8]]) -> None:
    pad, pixels = Pad(), views[0]
    suspect, labels, found = pad.suspect(pad.heat(pixels)), GraphSegments().labels(pixels), pad.mask(pixels)
    for label in range(labels.max() + 1):
        inside = labels == label
        assert found[inside].all() == (suspect[inside].mean() > 0.5)
        assert found[inside].any() == found[inside].all()


def test_segments_tile_the_image(views: list[NDArray[np.uint8]]) -> None:
    for pixels in (views[0], views[0][:8, :8], views[0][:5, :200]):
        assert (np.sum(list(GraphSegments()(np.ascontiguousarray(pixels))), axis=0) == 1).all()


def test_overlapping_segments_are_taken_in_their_order() -> None:
    class Twice:
        fingerprint = "twice"

        def __call__(self, pixels: NDArray[np.uint8]) -> list[NDArray[np.bool_]]:
            small, large = np.zeros((2, *pixels.shape[:2]), bool)
            small[40:60, 40:60] = large[30:70, 30:70] = True
            return [small, large]

    pixels = np.full((96, 96, 3), 90, np.uint8)
    pixels[28:72, 28:72] = np.random.default_rng(0).integers(0, 256, (44, 44, 3))
    pad = Pad(segmenter=Twice())
    assert pad.fingerprint != Pad().fingerprint  # the user's segmenter makes another defence
    mask = pad.mask(pixels)
    assert mask.sum() == 400  # a quarter of the large one was masked by then: it is left out


def test_the_gradient_passes_where_nothing_is_masked(views: list[NDArray[np.uint8]]) -> None:
    images = (torch.from_numpy(views[1]).permute(2, 0, 1)[None] / 255).requires_grad_()
    Pad()(images).sum().backward()
    assert images.grad is not None
    masked = torch.from_numpy(Pad().mask(views[1]))
    assert torch.equal(images.grad[0, 0], (~masked).float())
