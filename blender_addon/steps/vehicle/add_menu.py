"""The menu of Rauca's own vehicles, with their pictures: in step 1, and in Add > Mesh beside Blender's own meshes."""

from __future__ import annotations

import bpy

from ...core import assets
from ...jobs import pictures
from .operators import vehicle_items

COLUMNS, HEIGHT = 5, 4.0  # of the menu, and of a picture in it, in rows of text


class RAUCA_MT_vehicles(bpy.types.Menu):
    """Add a vehicle that Rauca brings, at the 3D cursor, and choose it"""

    bl_label = "Add Vehicle"

    def draw(self, context: bpy.types.Context) -> None:
        # A menu of the operator's choices would show the pictures as small as icons. Blender places what is in a menu
        # by columns, each filled from its top: a second row would be set to the right of the first.
        row, items = self.layout.row(), vehicle_items()
        for first in range(COLUMNS):
            column = row.column()
            for name, shown, *_ in items[first::COLUMNS]:
                column.template_icon(picture_of(name), scale=HEIGHT)
                column.operator("rauca.add_vehicle", text=shown, translate=False).vehicle = name


def picture_of(name: str) -> int:
    """The icon of a shipped vehicle's picture; 0 where it has none."""
    path = assets.assets_folder() / "vehicles" / f"{name}.jpg"
    return pictures.load(f"vehicle.{name}", path, now=True) if path.is_file() else 0


def _draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    if context.mode == "OBJECT":
        menu.layout.menu("RAUCA_MT_vehicles", text="Vehicle", icon="AUTO")


def register() -> None:
    bpy.types.VIEW3D_MT_mesh_add.append(_draw)


def unregister() -> None:
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw)
