"""Step 8: carry the camouflage to another UV layout; the bake works beside the window, which stays alive."""

from __future__ import annotations

import threading
from collections.abc import Generator
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract, files
from ..folders import chosen_folder
from ..scene.bake import Baked, Task, add_layer, baked_image, other_layers, prepare_bake, run_bake, show_baked
from ..scene.baked_export import export_glb
from ..scene.coating import atlas_layers
from ..scene.mesh_edits import object_mode
from ..translations import OWN_SENSE
from .camouflage.painted_vehicle import (
    coat_shown,
    painted_surface,
    painted_vehicle,
    require_coat,
    surface_of,
    vehicle_gone,
)
from .operator import NO_COAT, NO_UNDO, ModalOperator, Obstacle, RaucaOperator
from .panel import State, StepPanel, folder_setting

LEAST_DB = 30.0  # of a bake that looks like the camouflage; below, the difference is seen at a glance


def _layers(self: RaucaBake, context: bpy.types.Context, typed: str) -> list[str]:
    """The UV layers to choose from."""
    return bakeable(context)


def bakeable(context: bpy.types.Context) -> list[str]:
    """UV layers of the painted mesh beside the camouflage's own; asks no faces: quick enough for drawing."""
    anchor = context.scene.rauca.camouflage.anchor
    if anchor is None or anchor.type != "MESH":
        return []
    own = atlas_layers(anchor)
    return [layer.name for layer in anchor.data.uv_layers if layer.name not in own]


class RaucaBake(bpy.types.PropertyGroup):
    """Where the camouflage goes; ``baked_layer``, ``file``, ``difference`` and ``decibels`` tell of the last bake."""

    layer: bpy.props.StringProperty(
        name="UV Layer",
        translation_context=OWN_SENSE,
        search=_layers,
        description="The UV layer to bake into; empty: the only one beside the camouflage's own",
    )
    size: bpy.props.EnumProperty(
        name="Size",
        items=[(str(size), f"{size} px", f"{size} x {size} texels") for size in (512, 1024, 2048, 4096)],
        default="2048",
        description="Width and height of the image",
    )
    folder: folder_setting("Folder", "The image is written here, and kept inside the .blend as well")
    allow_overlaps: bpy.props.BoolProperty(
        name="Allow Overlaps",
        description="Bake although parts share texels, such as mirrored sides: they get a mixture of both",
    )
    baked_layer: bpy.props.StringProperty(options={"HIDDEN"})
    file: bpy.props.StringProperty(options={"HIDDEN"})
    difference: bpy.props.FloatProperty(options={"HIDDEN"})
    decibels: bpy.props.FloatProperty(options={"HIDDEN"})  # PSNR, texel by texel


def state(context: bpy.types.Context) -> State:
    settings, coat = context.scene.rauca.bake, context.scene.rauca.camouflage.coat
    if RAUCA_OT_bake.running() is not None:
        return State("running", iface("Baking; Esc stops it"))
    if coat is None or vehicle_gone(context):
        return State("missing", iface("Apply a camouflage first"))
    if not settings.folder:
        return State("missing", iface("Choose a folder for the image"))
    if _is_baked(context) and settings.file:
        told = {"file": Path(settings.file).name, "share": settings.difference}
        if settings.decibels < LEAST_DB:
            text = iface(
                "Baked to {file}, but it looks different: colors differ by {share:.1%}. Choose a larger size, or a UV "
                "layer with fewer pieces"
            )
            return State("ready", text.format(**told))
        return State("done", iface("Baked to {file}: colors differ by {share:.1%} on average").format(**told))
    layers = bakeable(context)
    if not layers:
        return State("missing", iface("The vehicle has no other UV layer yet: press New UV Layer"))
    if settings.layer not in layers and (settings.layer or len(layers) > 1):
        return State("missing", iface("Choose the UV layer to bake into"))
    return State("ready", iface("Ready to bake"))


def _is_baked(context: bpy.types.Context) -> bool:
    coat = coat_shown(context)
    return coat is not None and coat.image("baked") is not None


class RAUCA_PT_bake(StepPanel, bpy.types.Panel):
    """Bake the camouflage to other UVs"""

    bl_label = "Bake"
    number = 8
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.bake
        run = RAUCA_OT_bake.running()
        column = layout.column()
        column.enabled = run is None
        column.prop(settings, "layer", icon="GROUP_UVS")
        column.operator("rauca.new_uv_layer", icon="ADD")
        for name in ("size", "folder", "allow_overlaps"):
            column.prop(settings, name)
        if run is None:
            layout.operator("rauca.bake", icon="RENDER_STILL")
        else:
            layout.progress(factor=run.done, text=f"{run.done:.0%}")
        layout.operator("rauca.export_glb", icon="EXPORT")


class BakeRun(threading.Thread):
    """A bake under way. It works on arrays alone: nothing of Blender is touched from its thread.

    Attributes:
        task, layer, path: what was asked for when the button was pressed: the bake, its UV layer, the PNG's place.
        done: share, in [0, 1].
        result: of a bake that has ended; None if it was stopped or failed.
        error: why it failed.
    """

    def __init__(self, task: Task, layer: str, path: Path) -> None:
        super().__init__(daemon=True)
        self.task, self.layer, self.path = task, layer, path
        self.done = 0.0
        self.result: Baked | None = None
        self.error = ""
        self._stop_asked = False

    def run(self) -> None:
        try:
            self.result = run_bake(self.task, self._step)
        except _StoppedError:
            pass
        except MemoryError:
            self.error = "The bake needs more memory than there is; choose a smaller size"
        except Exception as error:  # the operator reports it; a thread's would vanish
            self.error = f"The bake failed ({error}); please report this"

    def stop(self) -> None:
        """Give up at the next opportunity, well within a second."""
        self._stop_asked = True

    def _step(self, done: float) -> None:
        self.done = done
        if self._stop_asked:
            raise _StoppedError


class _StoppedError(Exception):
    pass


class RAUCA_OT_bake(ModalOperator, bpy.types.Operator):
    """Carry the camouflage to another UV layer of the vehicle, as a PNG and inside this .blend; Esc stops it"""

    bl_label = "Bake"
    stopped = "Bake stopped; nothing was written"
    obstacles = (
        NO_COAT,
        Obstacle(
            "A bake is running; press Esc in the viewport to stop it", lambda _: RAUCA_OT_bake.running() is not None
        ),
    )

    def begin(self, context: bpy.types.Context) -> BakeRun:
        settings = context.scene.rauca.bake
        with object_mode(context):
            surface, coat = painted_surface(context)
            if settings.layer in {piece.layer for piece in surface.painted_pieces()}:
                text = rpt("UV layer {layer}: the camouflage lies there already; choose another, or press New UV Layer")
                raise contract.RaucaError(text.format(layer=repr(settings.layer)))
            layer = _layer(settings.layer, other_layers(surface))
            task = prepare_bake(surface, coat, layer, int(settings.size), settings.allow_overlaps)
        settings.layer = layer
        folder = chosen_folder(settings.folder, "the baked image")
        name = bpy.path.clean_name(f"{surface.vehicle.name}-{coat.tree['rauca_camouflage']}-{layer}")
        run = BakeRun(task, layer, folder / f"{name}.png")
        run.start()
        return run

    def work(self, context: bpy.types.Context) -> None:
        """At once: for scripts, and in background mode."""
        run = self.begin(context)
        run.join()
        for _ in self.finish(context, run):
            pass

    def finish(self, context: bpy.types.Context, run: BakeRun) -> Generator[None]:
        """Between two steps the user may undo or delete anything: no block is kept across them but by name."""
        if (baked := run.result) is None:
            raise contract.RaucaError(run.error)
        image = baked_image(baked).name
        try:
            yield
            _still_there(image).pack()
            yield
            with object_mode(context):
                vehicle, _ = painted_vehicle(context)
            if vehicle.paint_faces().sum() != len(run.task.source_uvs):
                text = rpt("{name}: changed while it was baked; bake again")
                raise contract.RaucaError(text.format(name=vehicle.name))
            yield
            files.write_bytes(run.path, baked.png)
            yield
            with object_mode(context):
                surface, coat = surface_of(context, vehicle), require_coat(context)
                show_baked(surface, coat, run.layer, run.task.wraps, _still_there(image))
        finally:
            left = bpy.data.images.get(image)
            if left is not None and left.users == 0:
                bpy.data.images.remove(left)
        settings = context.scene.rauca.bake
        settings.difference, settings.decibels = baked.difference, baked.psnr_db
        settings.baked_layer, settings.file = run.layer, str(run.path)
        text = rpt("Baked to {file}: colors differ by {share:.1%} on average")
        self.report({"INFO"}, text.format(file=run.path.name, share=baked.difference))


def _still_there(image: str) -> bpy.types.Image:
    found = bpy.data.images.get(image)
    if found is None:
        raise contract.RaucaError("The baked image was undone before it was in place; bake again")
    return found


def _layer(wanted: str, layers: list[str]) -> str:
    """The UV layer to bake into: the one chosen, or the only other one.

    Raises:
        RaucaError: there is none, or several and none is chosen.
    """
    if wanted and wanted in layers:
        return wanted
    shown = ", ".join(repr(name) for name in layers)
    if wanted:
        text = rpt("UV layer {wanted}: the vehicle's paint does not have it, but {others}")
        raise contract.RaucaError(text.format(wanted=repr(wanted), others=shown or rpt("only the camouflage's own")))
    if not layers:
        raise contract.RaucaError(
            "The vehicle has no UV layer beside the camouflage's own; press New UV Layer, or add one yourself"
        )
    if len(layers) > 1:
        raise contract.RaucaError(
            rpt("The vehicle has several UV layers: {shown}; choose the one to bake into").format(shown=shown)
        )
    return layers[0]


class RAUCA_OT_new_uv_layer(RaucaOperator, bpy.types.Operator):
    """Add a UV layer in which Blender's Smart UV Project lays out the vehicle's paint"""

    bl_label = "New UV Layer"
    obstacles = (NO_COAT,)

    def work(self, context: bpy.types.Context) -> str:
        with object_mode(context):
            surface, _ = painted_surface(context)
            name = add_layer(surface)
        context.scene.rauca.bake.layer = name
        return rpt("UV layer {name} added").format(name=name)


class RAUCA_OT_export_glb(RaucaOperator, bpy.types.Operator):
    """Save the vehicle with the baked camouflage as a GLB, for game engines, simulators and viewers"""

    bl_label = "Export GLB"
    bl_options = NO_UNDO
    obstacles = (Obstacle("Bake the camouflage first", lambda context: not _is_baked(context)),)
    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath:
            self.filepath = str(Path(context.scene.rauca.bake.file).with_suffix(".glb"))
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> str:
        if not self.filepath:
            raise contract.RaucaError("No file: choose where to save the GLB")
        path = Path(bpy.path.abspath(self.filepath)).with_suffix(".glb")
        with object_mode(context):
            surface, coat = painted_surface(context)
            export_glb(context, surface, coat, context.scene.rauca.bake.baked_layer, path)
        return rpt("{file} saved").format(file=path.name)
