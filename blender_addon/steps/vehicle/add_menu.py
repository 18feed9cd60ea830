"""Add > Mesh > Vehicle, beside Blender's own meshes."""

from __future__ import annotations

import bpy


def _draw(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    if context.mode == "OBJECT":
        menu.layout.operator_menu_enum("rauca.add_vehicle", "vehicle", text="Vehicle", icon="AUTO")


def register() -> None:
    bpy.types.VIEW3D_MT_mesh_add.append(_draw)


def unregister() -> None:
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw)
