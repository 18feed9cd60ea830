"""The fog layer: a box of scattering medium over the ground; not the World's volume, which would hide the sky.

Fog that thins out with height is one volume of varying density, marched through in steps. Measured at extinction
0.03/m, falloff 2, 16 samples: that is four times as cheap as tracking collisions in it, with 1 dB less noise and a mean
within 0.4 %. Homogeneous slabs stacked to the same optical depth cost twice as much with three of them, and with six
lose a tenth of the light to the limit on bounces. In uniform fog, tracking is the better of the two.
"""

from __future__ import annotations

import bpy

from .. import compat
from ..core import contract
from . import nodes
from .massing import box_solid

HALF_WIDTH_M = 300.0
ANISOTROPY = 0.5  # forward scattering of droplets, tempered as multiple scattering evens it out
MARCH_RATE = 0.2  # of Cycles' default step, a tenth of the box; only fog that varies is marched through
CLEARING_EDGE = 0.1  # share of fog_distance over which fog sets in


class FogLayer:
    """The layer of one scene.

    Attributes:
        box: its object, hidden when there is no fog; it stands on the ground at its own origin.
    """

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.box = new_box()
        self.box.hide_render = True
        scene.collection.objects.link(self.box)
        scene.cycles.volume_step_rate = MARCH_RATE
        self._scene = scene

    def apply(self, weather: contract.Weather) -> None:
        """Set density and shape, see :meth:`contract.Weather.extinction_at`."""
        self.box.hide_render = weather.extinction == 0.0
        compat.march_volumes(self._scene, not weather.fog_is_uniform)
        fill(self.box, weather)


def new_box() -> bpy.types.Object:
    """The layer's box with a material of its own, in no scene yet."""
    half = HALF_WIDTH_M
    corners, faces = box_solid((-half, -half, -0.5), (half, half, contract.weather.FOG_TOP_M))
    mesh = bpy.data.meshes.new("rauca fog")
    mesh.from_pydata(corners, [], faces)
    mesh.materials.append(bpy.data.materials.new("rauca fog"))
    return bpy.data.objects.new("rauca fog", mesh)


def fill(box: bpy.types.Object, weather: contract.Weather) -> None:
    """Give a box the weather's fog; its nodes are built anew only when fog turns from uniform to shaped or back."""
    material = box.data.materials[0]
    tree = material.node_tree
    if weather.fog_is_uniform:
        if tree is None or "fog" not in tree.nodes or "fog_falloff" in tree.nodes:
            _scatter(nodes.fresh_tree(material), 0.0)
        material.node_tree.nodes["fog"].inputs["Density"].default_value = weather.extinction
        return
    if tree is None or "fog_falloff" not in tree.nodes:
        _build_shaped(nodes.fresh_tree(material))
    for name in ("extinction", "fog_falloff", "fog_distance"):
        material.node_tree.nodes[name].outputs[0].default_value = getattr(weather, name)


def _build_shaped(tree: bpy.types.NodeTree) -> None:
    numbers = {}
    for name in ("extinction", "fog_falloff", "fog_distance"):
        node = nodes.add(tree, "ShaderNodeValue")
        node.name = name
        numbers[name] = node.outputs[0]
    position = nodes.add(tree, "ShaderNodeTexCoord").outputs["Object"]  # the box stands on the ground
    height = nodes.add(tree, "ShaderNodeSeparateXYZ", Vector=position).outputs["Z"]
    above = nodes.compute(tree, "MAXIMUM", height, 0.0)
    halvings = nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "MULTIPLY", above, numbers["fog_falloff"]), -0.1)
    thinned = nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "POWER", 2.0, halvings), numbers["extinction"])
    away = nodes.add(tree, "ShaderNodeCameraData").outputs["View Distance"]
    beyond = nodes.compute(tree, "SUBTRACT", away, numbers["fog_distance"])
    edge = nodes.compute(tree, "MULTIPLY_ADD", numbers["fog_distance"], CLEARING_EDGE, 1e-3)
    set_in = nodes.compute(tree, "DIVIDE", beyond, edge, clamp=True)
    _scatter(tree, nodes.compute(tree, "MULTIPLY", thinned, set_in))


def _scatter(tree: bpy.types.NodeTree, density: bpy.types.NodeSocket | float) -> None:
    volume = nodes.add(tree, "ShaderNodeVolumeScatter", Density=density, Anisotropy=ANISOTROPY)
    volume.name = "fog"
    nodes.output(tree, Volume=volume.outputs[0])
