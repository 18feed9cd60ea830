"""A camouflage as an asset: for the asset browser, and put on a vehicle from there.

The asset is the coat's node group, of which it needs nothing else: UV map and paint mask are packed images inside it.

- A material would take a vehicle's own finish with it when dropped, would know no vehicle that it does not fit, could
  not be taken off again, and step 1 would no longer find its paint by the material.
- An object would bring the whole vehicle along.
- A node group cannot be dropped on an object. So the asset browser's context menu has a button for it that does what
  an artist expects of a drop: the vehicle of step 1 wears the camouflage, one that does not fit is refused with the
  reason, step 6 knows of it, and where no vehicle is chosen, one of Rauca's own comes with it.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from numpy.typing import NDArray

from ...core import color, contract, files
from ...folders import own_folder
from ...jobs import pictures
from ...scene.blocks import Since
from ...scene.coating import ATLAS_KEY, DIGEST_KEY, NAME_KEY, Coat
from ...scene.images import image_linear
from ..operator import NO_COAT, Obstacle, RaucaOperator
from .operators import wear
from .painted_vehicle import painted_vehicle

TAG = "rauca camouflage"
MADE_FOR_KEY = "rauca_made_for"  # custom property of the asset: the vehicle's name
PREVIEW_TEXELS = 256


def _is_asset(context: bpy.types.Context) -> bool:
    """Whether this file has an asset of the camouflage that is worn; asked for at every redraw."""
    coat = context.scene.rauca.camouflage.coat
    assets = [tree for tree in bpy.data.node_groups if tree.asset_data is not None and MADE_FOR_KEY in tree]
    keys = (NAME_KEY, ATLAS_KEY, DIGEST_KEY)
    return coat is not None and any(all(tree.get(key) == coat.get(key) for key in keys) for tree in assets)


class RAUCA_OT_mark_asset(RaucaOperator, bpy.types.Operator):
    """Keep the camouflage as an asset of this file: the asset browser shows it, and its menu puts it on a vehicle"""

    bl_label = "Mark as Asset"
    obstacles = (NO_COAT, Obstacle("It is an asset of this file already", _is_asset))

    def work(self, context: bpy.types.Context) -> str:
        vehicle, coat = painted_vehicle(context)
        name = coat.tree[NAME_KEY]
        # A copy: whether the original or a bake shows on this vehicle, and taking the coat off, are no matter of it.
        asset = coat.tree.copy()
        asset.name, asset[MADE_FOR_KEY] = f"{name} ({vehicle.name})", vehicle.name
        _show_anywhere(Coat(asset))
        asset.asset_mark()
        asset.asset_data.description = f"Camouflage {name} for {vehicle.name}"
        for tag in (TAG, vehicle.name):
            asset.asset_data.tags.new(tag)
        linear = image_linear(Coat(asset).image("camouflage"))
        pictures.fill(asset.preview_ensure(), color.linear_to_srgb(_shrunk(linear)))
        return rpt("{name} is an asset of this file; save the file to use it in others").format(name=asset.name)


def _show_anywhere(coat: Coat) -> None:
    """Show the camouflage wherever the mask is white: other meshes have no marks on their faces."""
    coat.show("CAMOUFLAGE")
    coat.tree.nodes["baked"].image = None
    mark = next(node for node in coat.tree.nodes if node.type == "ATTRIBUTE")
    for link in list(mark.outputs["Fac"].links):
        link.to_socket.default_value = 1.0
        coat.tree.links.remove(link)


def _shrunk(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means over equal squares of a map (H, H, 3), such that it has at most :data:`PREVIEW_TEXELS`."""
    step = -(-len(linear) // PREVIEW_TEXELS)
    size = len(linear) // step
    kept = linear[: size * step, : size * step]
    return kept.reshape(size, step, size, step, 3).mean(axis=(1, 3))


class RAUCA_OT_apply_asset(RaucaOperator, bpy.types.Operator):
    """Paint the vehicle of step 1 with this camouflage; one of Rauca's own is added if none is chosen"""

    bl_label = "Put on Vehicle"

    blend: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})  # empty: this file
    group: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        with _group(self.blend, self.group) as tree:
            camouflage, png = _read(tree)
        # As a file it can be evaluated like any other, and step 6 shows its picture.
        path = own_folder() / "camouflages" / f"{hashlib.sha256(png).hexdigest()[:16]}.json"
        contract.save_camouflage(path, camouflage, png)
        settings = context.scene.rauca.camouflage
        before, settings.file = settings.file, str(path)
        try:
            return wear(context)
        except contract.RaucaError:
            settings.file = before
            raise


@contextlib.contextmanager
def _group(blend: str, name: str) -> Iterator[bpy.types.NodeTree]:
    """Within: a node group of this file, or of another .blend, of which nothing stays here."""
    if not blend:
        if name not in bpy.data.node_groups:
            raise contract.RaucaError(f"{name}: is no node group of this file")
        yield bpy.data.node_groups[name]
        return
    since = Since()
    try:
        with bpy.data.libraries.load(bpy.path.abspath(blend), link=False) as (there, wanted):
            if name not in there.node_groups:
                raise contract.RaucaError(f"{blend}: has no node group {name}; refresh the asset browser")
            wanted.node_groups = [name]
        yield wanted.node_groups[0]
    except OSError as error:
        raise contract.RaucaError(f"{blend}: cannot be read ({error}); refresh the asset browser") from None
    finally:
        bpy.data.batch_remove(since.blocks())


def _read(tree: bpy.types.NodeTree) -> tuple[contract.Camouflage, bytes]:
    """The camouflage that an asset holds, and its UV map as PNG."""
    node = tree.nodes.get("camouflage")
    image = node.image if node is not None and node.type == "TEX_IMAGE" else None
    told = [tree.get(key) for key in (NAME_KEY, MADE_FOR_KEY, ATLAS_KEY)]
    if image is None or not image.size[0] or not all(isinstance(text, str) for text in told):
        raise contract.RaucaError(f"{tree.name}: holds no camouflage; choose one that Mark as Asset made")
    pixels = color.to_bytes(color.linear_to_srgb(image_linear(image)))
    return contract.Camouflage(*told, len(pixels), "asset"), files.png_bytes(pixels)


def _draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    asset = getattr(context, "asset", None)
    if asset is not None and asset.id_type == "NODETREE" and TAG in asset.metadata.tags:
        menu.layout.separator()
        button = menu.layout.operator("rauca.apply_asset", icon="BRUSH_DATA")
        button.group, button.blend = asset.name, "" if asset.local_id is not None else asset.full_library_path


def register() -> None:
    bpy.types.ASSETBROWSER_MT_context_menu.append(_draw)


def unregister() -> None:
    bpy.types.ASSETBROWSER_MT_context_menu.remove(_draw)
