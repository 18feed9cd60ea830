"""Trees, bushes and hedges. Trees are a few meshes of plain opaque polygons, instanced."""

from __future__ import annotations

import math

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import seeding
from ..massing import MeshParts, pick, shifted
from .materials import Materials
from .site import Site
from .tables import TREES, Tree

TREE_ROOM_M = 5.0  # from the vehicle: a crown above it would shade every view
BESIDE_M = 13.0  # where cameras stand; only every third tree grows there
MODELS = 3  # meshes per kind of tree


class Nursery:
    """Tree meshes, shared by all districts."""

    def __init__(self, seed: int, materials: Materials) -> None:
        self._seed, self._materials = seed, materials
        self._meshes: dict[tuple[str, int], bpy.types.Mesh] = {}

    def plant(self, name: str, kind: str, model: int) -> bpy.types.Object:
        """An object with a shared mesh; not linked yet."""
        key = kind, model
        if key not in self._meshes:
            rng = seeding.named_rng(self._seed, "tree", kind, model)
            parts = MeshParts()
            (_conifer if kind == "conifer" else _broadleaf)(parts, TREES[kind], rng)
            self._meshes[key] = parts.to_mesh(f"rauca {kind} tree {model}", self._materials)
        return bpy.data.objects.new(name, self._meshes[key])


def build_greenery(site: Site) -> None:
    """Trees along the street and further off, bushes and hedges."""
    layout, rng = site.layout, site.layout.rng("greenery")
    district = layout.district
    if district.tree_every_m:
        for side in (-1, 1):
            _avenue(site, rng, side)
    elif district.pavement_m:
        _avenue(site, rng, int(rng.choice((-1, 1))), every=21.0)
    for side in (-1, 1):
        kind = layout.sides[side]
        if kind in ("park", "houses", "slabs", "fields"):
            _scatter(site, rng, side, {"park": 24, "houses": 9, "slabs": 8, "fields": 8}[kind])
        if kind == "houses" or (kind == "park" and rng.random() < 0.6):
            _garden_edge(site, rng, side)


def _avenue(site: Site, rng: np.random.Generator, side: int, every: float = 0.0) -> None:
    district = site.layout.district
    every = every or district.tree_every_m
    aside = site.layout.outer_m + 1.2 if district.pavement_m < 4 else district.road_half_m + 1.4
    if district.pavement_m and district.front_m[0] < aside + 2.5:  # a narrow street has them at the kerb
        aside = district.road_half_m + 1.0
    kind = pick(rng, district.trees)
    for along in np.arange(-75.0, 76.0, every).tolist():
        if rng.random() < 0.75:
            _tree(site, rng, kind, along + rng.uniform(-1.5, 1.5), side * aside)


def _scatter(site: Site, rng: np.random.Generator, side: int, count: int) -> None:
    district = site.layout.district
    fields = site.layout.sides[side] == "fields"
    low = site.layout.outer_m + (2.5 if not fields else 3.0)
    for _ in range(count):
        kind = pick(rng, district.trees)
        _tree(site, rng, kind, rng.uniform(-70, 70), side * (low + 42.0 * rng.random() ** (1.0 if fields else 1.8)))


def _tree(site: Site, rng: np.random.Generator, kind: str, along: float, aside: float) -> None:
    scale, model = rng.uniform(0.8, 1.3), int(rng.integers(MODELS))
    spin, thinned = rng.uniform(0, 2 * math.pi), rng.random() > 0.35
    if not site.clear_of_crossing(along, 2.5):
        return
    frame = site.frame(along, aside, spin)
    crown = TREES[kind].crown_m[0] * scale
    away = site.layout.from_vehicle(frame[:3, 3])
    if away < TREE_ROOM_M + crown or (away < BESIDE_M and thinned) or not site.claim(frame, max(0.7, crown * 0.6)):
        return
    frame[:3, :3] *= scale
    site.trees.append((f"{kind}:{model}", frame))


def _garden_edge(site: Site, rng: np.random.Generator, side: int) -> None:
    """A hedge or a picket fence along the pavement, open at gates."""
    district, hedge = site.layout.district, rng.random() < 0.55
    edge = site.layout.outer_m + (0.35 if district.pavement_m else 4.5)  # a country road has room to pull off
    height = rng.uniform(0.8, 1.3)
    along = -70.0
    while along < 70.0:
        length = rng.uniform(6, 13)
        middle = along + length / 2
        frame = site.frame(middle, side * edge)
        if site.clear_of_crossing(middle, length / 2 + 2.0) and site.claim(frame, 0.3, length):
            with site.parts.at(frame):
                if hedge:
                    _hedge(site.parts, rng, length, height)
                else:
                    _pickets(site.parts, length)
        along += length + rng.uniform(2.5, 4.0)


def _hedge(parts: MeshParts, rng: np.random.Generator, length: float, height: float) -> None:
    columns = max(2, int(length / 0.45))
    x = np.linspace(-length / 2, length / 2, columns + 1)
    profile = np.array([(-0.35, 0.0), (-0.38, 0.5), (-0.3, 0.97), (0.0, 1.04), (0.3, 0.97), (0.38, 0.5), (0.35, 0.0)])
    points = np.empty((columns + 1, len(profile), 3))
    points[..., 0] = x[:, None]
    points[..., 1], points[..., 2] = profile[:, 0], profile[:, 1] * height
    points += rng.uniform(-0.09, 0.09, points.shape)
    _sheet(parts, "hedge", points)
    sprays = np.stack([rng.uniform(x[0], x[-1], 10 * columns), rng.uniform(-0.4, 0.4, 10 * columns),
                       rng.uniform(0.1, 1.05, 10 * columns) * height], axis=1)  # fmt: skip
    outside = (np.abs(sprays[:, 1]) > 0.3) | (sprays[:, 2] > 0.92 * height)
    _sprays(parts, "hedge", sprays[outside], 0.10, rng)


def _pickets(parts: MeshParts, length: float) -> None:
    x = np.arange(-length / 2, length / 2, 0.16)
    low = np.stack([x, np.zeros_like(x), np.full_like(x, 0.05)], axis=1)
    parts.boxes("picket", low, shifted(low, 0.08, 0.02, 0.95))
    for z in (0.3, 0.75):
        parts.box("picket", (-length / 2, 0.02, z), (length / 2, 0.05, z + 0.08))


def _broadleaf(parts: MeshParts, kind: Tree, rng: np.random.Generator) -> None:
    leaves = pick(rng, kind.leaves)
    (trunk, radius), (half_width, half_height) = kind.trunk_m, kind.crown_m
    middle = np.array([0.0, 0.0, trunk + half_height * 0.85])
    if trunk:
        parts.beam("bark", (0, 0, -0.1), (rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), middle[2]), radius, 8, 0.6)
    surfaces = []
    for i in range(kind.clumps):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        center = middle + direction * [half_width, half_width, half_height] * rng.uniform(0.35, 0.7) * (i > 0)
        size = np.array([half_width, half_width, half_height * 0.5 + half_width * 0.4]) * rng.uniform(0.42, 0.6)
        if trunk and i % 2 == 0:
            parts.beam("bark", (0, 0, trunk * 0.8), center, radius * 0.45, 5, 0.5)
        surfaces.append(_clump(parts, leaves, center, size, rng))
    points = np.concatenate(surfaces)
    chosen = points[rng.integers(0, len(points), kind.sprays)]
    _sprays(parts, leaves, chosen + rng.normal(0, 0.07 * half_width, chosen.shape), 0.13 * half_width**0.5, rng)


def _clump(
    parts: MeshParts, material: str, center: NDArray[np.float64], size: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """A lumpy ball; returns its surface points (N, 3)."""
    rows, columns = 6, 9
    polar = np.linspace(0.12, math.pi - 0.12, rows)[:, None]
    around = np.arange(columns + 1) * 2 * math.pi / columns
    reach = rng.uniform(0.78, 1.2, (rows, columns + 1))
    reach[:, -1] = reach[:, 0]
    ball = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0 * around], -1)
    points = center + ball * reach[..., None] * size
    _sheet(parts, material, points)
    return points.reshape(-1, 3)


def _sheet(parts: MeshParts, material: str, points: NDArray[np.float64]) -> None:
    """Quadrilaterals between neighbors of a grid of points (rows, columns, 3)."""
    rows, columns = points.shape[:2]
    i = np.arange(rows * columns).reshape(rows, columns)
    faces = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)
    parts.polygons(material, points.reshape(-1, 3), faces)


def _sprays(
    parts: MeshParts, material: str, centers: NDArray[np.float64], size: float, rng: np.random.Generator
) -> None:
    """Small four-sided sprays of leaves, each facing its own way."""
    along, across = rng.normal(size=(2, len(centers), 3))
    along *= (size * rng.uniform(0.7, 1.5, len(centers)) / np.linalg.norm(along, axis=1))[:, None]
    across *= (size * rng.uniform(0.5, 1.0, len(centers)) / np.linalg.norm(across, axis=1))[:, None]
    corners = np.stack([centers - along, centers + across * 0.8, centers + along, centers - across * 0.8], axis=1)
    parts.quads(material, corners)


def _conifer(parts: MeshParts, kind: Tree, rng: np.random.Generator) -> None:
    (trunk, radius), (half_width, half_height) = kind.trunk_m, kind.crown_m
    parts.column("bark", (0, 0, -0.1), radius, trunk + half_height, 7, 0.4)
    tiers, spikes = 8, 11
    for tier in range(tiers):
        share = tier / tiers
        low, wide = trunk + 2 * half_height * share * 0.92, half_width * (1 - share) * rng.uniform(0.9, 1.1) + 0.12
        angles = np.arange(2 * spikes) * math.pi / spikes + rng.uniform(0, 1)
        reach = wide * np.where(np.arange(2 * spikes) % 2, 1.0, 0.55) * rng.uniform(0.85, 1.15, 2 * spikes)
        rim = np.stack([reach * np.cos(angles), reach * np.sin(angles), low - 0.18 * reach], axis=1)
        tip = np.array([[0.0, 0.0, low + 2 * half_height / tiers * 1.7]])
        i = np.arange(2 * spikes)
        faces = np.stack([i, (i + 1) % (2 * spikes), np.full_like(i, 2 * spikes)], axis=1)
        parts.polygons("needles", np.concatenate([rim, tip]), faces)
