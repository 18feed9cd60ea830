"""What every pixel shows: coverage, distance and ids, from renders in which nothing but geometry is left.

Every material is exchanged for an emitter of numbers; no light bounces and there is no fog. The emitters have two
modes, so that a location's surfaces are exchanged once for all its cameras:

- *coverage*: red is "vehicle", green "paint", blue the distance to the camera. With the image's own pixel filter a
  pixel's value is exactly the renderer's anti-aliased coverage.
- *ids*: red is the semantic class, green the instance. One sample through the middle of the pixel, at the middle of
  its row's exposure: ids never blend.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from ..core import color, contract, semantics
from . import nodes
from .annotatable import categories, exchanged_materials, is_volume, shown_objects
from .blocks import set_within
from .driving import sharp
from .render import Crop, render_linear
from .vehicle import SceneVehicle

SAMPLES = 64  # on the vehicle, whose edges they resolve
FEW_SAMPLES = 8  # elsewhere, where nothing but the distance is asked for
MARGIN_PX = 16  # around the pixels whose middle shows the vehicle
SMALLEST_FILTER = 0.01  # pixels; Cycles takes no less
MODE = "rauca mode"
MOST_RAYS = 4096  # per camera: 1.5 % standard error at worst, and a hundredth of a second


@dataclass(eq=False)
class Annotation:
    """What a camera sees without weather; (H, W) each, kept small: a location's worth waits in memory.

    Attributes:
        vehicle, paint: uint8 coverage of the vehicle and of its paint, 255 is all.
        distance: float16 metres along the view ray, infinity for sky.
        semantic: uint8 class seen at the pixel's center.
        instances: uint8 vehicle seen there: 255 ours, 0 none.
        others: the other vehicles in ``instances``.
        visible: paint pixels seen divided by those expected without occluders, see :class:`PaintVisibility`.
    """

    vehicle: NDArray[np.uint8]
    paint: NDArray[np.uint8]
    distance: NDArray[np.float16]
    semantic: NDArray[np.uint8]
    instances: NDArray[np.uint8]
    others: tuple[contract.Instance, ...]
    visible: float

    def box_xyxy(self) -> contract.Box | None:
        """The tight box of pixels at least half covered by the vehicle; None when fewer than 16 are."""
        return semantics.mask_box(self.vehicle >= 128)


class GeometryView:
    """The scene while its surfaces emit numbers, one emitter for each kind of surface that occurs.

    Made by :func:`geometry_only`.
    """

    def __init__(self, scene: bpy.types.Scene, vehicle: SceneVehicle) -> None:
        """Raises as :func:`categories`."""
        self._scene, self._vehicle = scene, vehicle
        self._categories = categories(scene, vehicle.vehicle.category, scene.name)
        self._emitters: dict[tuple[str, bool, bool], bpy.types.Material] = {}

    def annotate(self, visible: Callable[[NDArray[np.uint8]], float], seed: int) -> Annotation:
        """Render what the scene's camera sees; ``visible`` tells the visible share of the paint from the instances."""
        semantic, instances = self._ids()
        self._switch(0.0)
        few, many = (contract.Quality(samples, denoise=False, bounces=0) for samples in (FEW_SAMPLES, SAMPLES))
        crop = Crop.around(instances == semantics.TARGET_INSTANCE, MARGIN_PX)
        # Many samples first: with few first, a frame's noise depends on what its process rendered before.
        pixels = near = render_linear(self._scene, many, seed, crop)
        if crop is not None:
            pixels = render_linear(self._scene, few, seed)
            pixels[crop.inside] = near
        solid = pixels[..., 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(solid > 0.5, pixels[..., 2] / solid, np.inf)
        vehicle, paint = color.to_bytes(pixels[..., 0]), color.to_bytes(pixels[..., 1])
        others = semantics.find_instances(instances, self._categories)
        share = visible(instances)
        return Annotation(vehicle, paint, distance.astype(np.float16), semantic, instances, others, share)

    def _ids(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Semantic and instance ids at the pixels' centers, (H, W) each."""
        self._switch(1.0)
        with set_within((self._scene.cycles, "filter_width", SMALLEST_FILTER), *sharp(self._scene)):
            pixels = render_linear(self._scene, contract.Quality(1, denoise=False, bounces=0), 0)
        numbers = np.rint(pixels).astype(np.uint8)
        semantic = np.where(pixels[..., 3] < 0.5, np.uint8(semantics.CLASS_IDS["sky"]), numbers[..., 0])
        return semantic, np.ascontiguousarray(numbers[..., 1])

    def _switch(self, mode: float) -> None:
        for material in self._emitters.values():
            socket = material.node_tree.nodes[MODE].outputs[0]
            if socket.default_value != mode:  # writing the same value would still make Cycles rebuild the shader
                socket.default_value = mode

    def emitter_of(self, thing: bpy.types.Object, material: bpy.types.Material | None) -> bpy.types.Material:
        """The emitter that stands for a material on an object."""
        ours, vehicle = thing == self._vehicle.object, self._vehicle
        name = str(material.get(semantics.CLASS_PROPERTY, "other")) if material else "other"
        paint = ours and vehicle.vehicle.materials[vehicle.materials.index(material)].kind == "paint"
        kind = (name if name in semantics.CLASS_IDS else "other", ours, paint)
        if kind not in self._emitters:
            self._emitters[kind] = self._emitter(*kind)
        return self._emitters[kind]

    def _emitter(self, name: str, ours: bool, paint: bool) -> bpy.types.Material:
        material = bpy.data.materials.new(f"rauca {name}")
        material.cycles.emission_sampling = "NONE"
        tree = nodes.fresh_tree(material)
        coverage = nodes.add(tree, "ShaderNodeCombineXYZ", X=float(ours), Y=0.0)
        tree.links.new(nodes.add(tree, "ShaderNodeCameraData").outputs["View Distance"], coverage.inputs["Z"])
        ids = nodes.add(tree, "ShaderNodeCombineXYZ", X=float(semantics.CLASS_IDS[name]))
        instance = tree.nodes.new("ShaderNodeAttribute")
        instance.attribute_type, instance.attribute_name = "INSTANCER", semantics.INSTANCE_PROPERTY
        tree.links.new(instance.outputs["Fac"], ids.inputs["Y"])
        if paint:
            mask = self._vehicle.paint.mask_socket(tree)
            tree.links.new(mask, coverage.inputs["Y"])
            tree.links.new(_class_where(tree, mask, "paint", "vehicle_part"), ids.inputs["X"])
        elif not ours:  # decided where it is shown: a collection's object may be a vehicle in one instance only
            tree.links.new(_class_where(tree, instance.outputs["Fac"], "other_vehicle", name), ids.inputs["X"])
        shown = nodes.mix_color(tree, nodes.number(tree, MODE), coverage.outputs[0], ids.outputs[0])
        nodes.output(tree, Surface=nodes.add(tree, "ShaderNodeEmission", Color=shown).outputs[0])
        return material

    def remove(self) -> None:
        """Remove the emitters."""
        bpy.data.batch_remove(list(self._emitters.values()))


@contextlib.contextmanager
def geometry_only(scene: bpy.types.Scene, vehicle: SceneVehicle, fog: list[bpy.types.Object]) -> Iterator[GeometryView]:
    """Within: surfaces emit numbers, the sky is transparent, light and fog are off; raises as :func:`categories`."""
    things = shown_objects(scene)
    view = GeometryView(scene, vehicle)
    unlit = [o for o in things if o.type in ("LIGHT", "VOLUME") or is_volume(o)]
    off = [(thing, "hide_render", True) for thing in {*fog, *unlit, *(o for o in scene.objects if o.type == "LIGHT")}]
    flat = [(scene.cycles, "max_bounces", 0), (scene.cycles, "film_exposure", 1.0)]
    bare = [(scene.render, "film_transparent", True), (scene, "world", None)]
    vehicle.object[semantics.INSTANCE_PROPERTY] = semantics.TARGET_INSTANCE
    try:
        surfaces = [thing for thing in things if thing not in unlit]
        with exchanged_materials(surfaces, view.emitter_of), set_within(*off, *flat, *bare):
            yield view
    finally:
        del vehicle.object[semantics.INSTANCE_PROPERTY]
        view.remove()


def _class_where(
    tree: bpy.types.NodeTree, chosen: bpy.types.NodeSocket, there: str, elsewhere: str
) -> bpy.types.NodeSocket:
    """One class where ``chosen`` is above a half, else the other: no blend along an edge between them."""
    one, other = float(semantics.CLASS_IDS[there]), float(semantics.CLASS_IDS[elsewhere])
    return nodes.compute(tree, "MULTIPLY_ADD", nodes.compute(tree, "GREATER_THAN", chosen, 0.5), one - other, other)


class PaintVisibility:
    """How much of the paint that a camera could see is hidden by something else.

    The rule: of the pixels in the image whose middle would show paint if the vehicle stood alone, the share whose
    middle shows the vehicle. What the vehicle hides of itself, and what lies outside the image, counts neither way.
    Rays are cast at the vehicle alone, so that no second render is needed to know what it would show.
    """

    def __init__(self, vehicle: contract.Vehicle) -> None:
        self._vehicle = vehicle
        self._tree = BVHTree.FromPolygons(vehicle.positions.tolist(), vehicle.triangles.tolist(), all_triangles=True)
        self._is_paint = vehicle.paint_faces()

    def share(self, camera_in_vehicle: contract.Camera, instances: NDArray[np.uint8]) -> float:
        """Paint pixels visible / paint pixels expected, 0 to 1; 0 when the image would show no paint at all.

        Args:
            camera_in_vehicle: the camera in the vehicle's own frame.
            instances: (H, W) ids of the frame, 255 where the vehicle is seen.
        """
        rows, columns = self._expected(camera_in_vehicle)
        return float((instances[rows, columns] == semantics.TARGET_INSTANCE).mean()) if rows.size else 0.0

    def _expected(self, camera: contract.Camera) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of pixels that show paint of the vehicle alone, on a grid of at most `MOST_RAYS`."""
        rows, columns = _grid(camera, self._vehicle)
        pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(rows.size)], axis=1)
        directions = pixels @ np.linalg.inv(camera.K).T @ camera.R
        eye = camera.position.tolist()
        hits = [self._tree.ray_cast(eye, direction) for direction in directions.tolist()]
        faces = np.array([-1 if hit[2] is None else hit[2] for hit in hits])
        struck = (faces >= 0) & self._is_paint[faces]
        places = np.array([hit[0] for hit, s in zip(hits, struck, strict=True) if s]).reshape(-1, 3)
        struck[struck] = self._may_change(faces[struck], places)
        return rows[struck], columns[struck]

    def _may_change(self, faces: NDArray[np.intp], places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """True where the paint mask is white: (N,) faces, (N, 3) points on them."""
        mask = self._vehicle.paint_mask
        a, b, c = self._vehicle.positions[self._vehicle.triangles[faces]].astype(np.float64).swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        area = np.maximum((normal**2).sum(axis=1), 1e-30)
        second = (np.cross(places - a, c - a) * normal).sum(axis=1) / area
        third = (np.cross(b - a, places - a) * normal).sum(axis=1) / area
        weights = np.stack([1 - second - third, second, third], axis=1)
        u, v = np.einsum("nk,nkd->dn", weights, self._vehicle.uvs[faces].astype(np.float64))
        size = mask.shape[0]
        column = np.clip((u * size).astype(int), 0, size - 1)
        row = np.clip(((1 - v) * size).astype(int), 0, size - 1)
        return mask[row, column] >= 128


def _grid(camera: contract.Camera, vehicle: contract.Vehicle) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pixels spread evenly over the part of the image where the vehicle may be."""
    points, depth = camera.project(vehicle.positions.astype(np.float64))
    left, top, right, bottom = 0, 0, camera.width, camera.height
    if depth.min() > 0:
        left, top = np.clip(np.floor(points.min(axis=0)).astype(int), 0, (right, bottom))
        right, bottom = np.clip(np.ceil(points.max(axis=0)).astype(int), 0, (right, bottom))
    step = max(1, int(np.ceil(np.sqrt((right - left) * (bottom - top) / MOST_RAYS))))
    first = step // 2
    rows, columns = np.mgrid[top + first : bottom : step, left + first : right : step]
    return rows.ravel(), columns.ravel()
