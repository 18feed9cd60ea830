"""Edges of the light maps: the share of paint comes from the annotation, the light from around."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bpy")


def test_edges_take_their_coverage_from_the_annotation():
    from blender_addon.scene.light_maps import refine_edges

    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:40, :40]
    coverage = np.clip((columns - 0.3 * rows - 5.3) / 2 + 0.5, 0, 1).astype(np.float32)
    light = (0.4 + 0.004 * rows)[..., None] * np.array([1.0, 0.9, 0.7])
    truth = coverage[..., None] * light
    edge = (coverage > 0) & (coverage < 1)
    sampled = np.where(edge, rng.binomial(8, coverage) / 8, coverage)
    gain = (sampled[..., None] * light).astype(np.float32)

    refined = refine_edges(gain, coverage)
    assert np.array_equal(refined[~edge], gain[~edge])
    assert np.square(refined - truth)[edge].mean() < 0.5 * np.square(gain - truth)[edge].mean()
    # A mask of True and False has no edges.
    assert np.array_equal(refine_edges(gain, coverage > 0), gain)
