"""What the buttons of step 7 do; the bake works beside the window, which stays alive."""

from __future__ import annotations

import threading
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...core import contract, files
from ...folders import chosen_folder
from ...jobs import watch
from ...scene.bake import Baked, Task, add_layer, baked_image, other_layers, prepare_bake, run_bake, show_baked
from ...scene.baked_export import export_glb
from ...scene.mesh_edits import object_mode
from ..camouflage.painted_vehicle import coat_shown, painted_surface, painted_vehicle, require_coat, surface_of
from ..operator import NO_UNDO, RaucaOperator

TICK_S = 0.1


class BakeRun(threading.Thread):
    """A bake under way. It works on arrays alone: nothing of Blender is touched from its thread."""

    def __init__(self, task: Task) -> None:
        super().__init__(daemon=True)
        self.task = task
        self.done = 0.0
        self.result: Baked | None = None
        self.error = ""
        self._stop_asked = threading.Event()

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
        self._stop_asked.set()

    def _step(self, done: float) -> None:
        self.done = done
        if self._stop_asked.is_set():
            raise _StoppedError


class _StoppedError(Exception):
    pass


@dataclass(frozen=True, eq=False)
class Order:
    """What was asked for when the button was pressed: the bake, its UV layer, and the PNG's place."""

    task: Task
    layer: str
    path: Path


running: BakeRun | None = None


class RAUCA_OT_bake(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Carry the camouflage to another UV layer of the vehicle, as a PNG and inside this .blend; Esc stops it"""

    bl_idname = "rauca.bake"
    bl_label = "Bake"
    _finishing: Generator[None] | None = None

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if coat_shown(context) is None:
            return rpt("Apply a camouflage first")
        if running is not None:
            return rpt("A bake is running; press Esc in the viewport to stop it")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        """At once: for scripts, and in background mode."""
        order = self._prepare(context)
        for _ in self._finish(context, order, run_bake(order.task, lambda done: None)):
            pass

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        global running
        try:
            self._order = self._prepare(context)
        except contract.RaucaError as error:
            return self.refuse(error)
        running = BakeRun(self._order.task)
        running.start()
        self._shown = -1
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK_S, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if running is None or event.type == "ESC":
            self._end(context)
            self.report({"INFO"}, rpt("Bake stopped; nothing was written"))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if (percent := int(100 * running.done)) != self._shown:
            self._shown = percent
            watch.redraw()
        if running.is_alive():
            return {"PASS_THROUGH"}
        try:
            if running.result is None:
                raise contract.RaucaError(running.error)
            if self._finishing is None:
                self._finishing = self._finish(context, self._order, running.result)
            next(self._finishing)
        except StopIteration:
            self._end(context)
            return {"FINISHED"}
        except contract.RaucaError as mistake:
            self._end(context)
            return self.refuse(mistake)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator itself: another file is loaded, or the window closes."""
        self._end(context)

    def _prepare(self, context: bpy.types.Context) -> Order:
        settings = context.scene.rauca.bake
        with object_mode(context):
            surface, coat = painted_surface(context)
            layer = _layer(settings.layer, other_layers(surface))
            task = prepare_bake(surface, coat, layer, int(settings.size), settings.allow_overlaps)
        settings.layer = layer
        folder = chosen_folder(settings.folder, "the baked image")
        name = bpy.path.clean_name(f"{surface.vehicle.name}-{coat.tree['rauca_camouflage']}-{layer}")
        return Order(task, layer, folder / f"{name}.png")

    def _finish(self, context: bpy.types.Context, order: Order, baked: Baked) -> Generator[None]:
        """Put the result in place, in steps between which the window draws; raises :class:`RaucaError`.

        Between two steps the user may undo or delete anything: no block of Blender's is kept across them but by name.
        """
        image = baked_image(baked).name
        try:
            yield
            _still_there(image).pack()
            yield
            with object_mode(context):
                vehicle, _ = painted_vehicle(context)
            if vehicle.paint_faces().sum() != len(order.task.source_uvs):
                text = rpt("{name}: changed while it was baked; bake again")
                raise contract.RaucaError(text.format(name=vehicle.name))
            yield
            files.write_bytes(order.path, baked.png)
            yield
            with object_mode(context):
                surface, coat = surface_of(context, vehicle), require_coat(context)
                show_baked(surface, coat, order.layer, order.task.wraps, _still_there(image))
        finally:
            left = bpy.data.images.get(image)
            if left is not None and left.users == 0:
                bpy.data.images.remove(left)
        settings = context.scene.rauca.bake
        settings.difference, settings.baked_layer, settings.file = baked.difference, order.layer, str(order.path)
        text = rpt("Baked to {file}: colors differ by {share:.1%} on average (PSNR {decibels:.1f} dB, texel by texel)")
        self.report({"INFO"}, text.format(file=order.path.name, share=baked.difference, decibels=baked.psnr_db))

    def _end(self, context: bpy.types.Context) -> None:
        global running
        if running is not None:
            running.stop()
        running = None
        if self._finishing is not None:
            self._finishing.close()
        if getattr(self, "_timer", None) is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        watch.redraw()


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


def unregister() -> None:
    """The add-on is disabled while a bake runs: it ends without a result."""
    global running
    if running is not None:
        running.stop()
    running = None


class RAUCA_OT_new_uv_layer(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Add a UV layer in which Blender's Smart UV Project lays out the vehicle's paint"""

    bl_idname = "rauca.new_uv_layer"
    bl_label = "New UV Layer"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("Apply a camouflage first") if coat_shown(context) is None else ""

    def work(self, context: bpy.types.Context) -> str:
        with object_mode(context):
            surface, _ = painted_surface(context)
            name = add_layer(surface)
        context.scene.rauca.bake.layer = name
        return rpt("UV layer {name} added").format(name=name)


class RAUCA_OT_export_glb(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Save the vehicle with the baked camouflage as a GLB, for game engines, simulators and viewers"""

    bl_idname = "rauca.export_glb"
    bl_label = "Export GLB"
    bl_options = NO_UNDO
    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})  # type: ignore[valid-type]

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        coat = coat_shown(context)
        return rpt("Bake the camouflage first") if coat is None or coat.image("baked") is None else ""

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


CLASSES = (
    RAUCA_OT_bake,
    RAUCA_OT_new_uv_layer,
    RAUCA_OT_export_glb,
)
