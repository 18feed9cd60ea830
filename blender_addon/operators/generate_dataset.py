"""Render a data set in other Blender processes, so that the window stays responsive."""

from __future__ import annotations

import subprocess
import threading
from queue import Empty, SimpleQueue

import bpy

from ..child import child_command
from ..core import contract


class RAUCA_OT_generate_dataset(bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Render every view in every weather to the chosen folder; run again to go on after stopping"""

    bl_idname = "rauca.generate_dataset"
    bl_label = "Generate dataset"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not context.scene.rauca.dataset.job

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Without a window: run to the end, then report."""
        if not self._start(context):
            return {"CANCELLED"}
        self._process.wait()
        return self._finish(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self._start(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self._process.terminate()
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        self._show_progress(context)
        if self._process.poll() is None:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return self._finish(context)

    def _start(self, context: bpy.types.Context) -> bool:
        steps = context.scene.rauca
        settings = steps.dataset
        if not settings.folder:
            self.report({"ERROR"}, "Choose a folder for the data set")
            return False
        arguments = [
            *("--out", bpy.path.abspath(settings.folder), "--vehicle", steps.vehicle.file),
            *("--weathers", steps.weather.preset_file(context), "--locations", str(settings.locations)),
            *("--azimuths", str(steps.cameras.azimuths), "--size", str(settings.size)),
            *("--samples", str(settings.samples), "--denoise" if settings.denoise else "--no-denoise"),
            "--json-progress",
        ]
        command = child_command("make_dataset", arguments)
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self._lines: SimpleQueue[str] = SimpleQueue()
        self._errors: list[str] = []
        threading.Thread(target=self._listen, daemon=True).start()
        threading.Thread(target=lambda: self._errors.extend(self._process.stderr or ()), daemon=True).start()
        settings.job, settings.done = "Starting", 0.0
        return True

    def _listen(self) -> None:
        """Pass the child's lines on; touches no Blender data, as it runs beside Blender's own thread."""
        for line in self._process.stdout or ():
            self._lines.put(line)

    def _show_progress(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.dataset
        while True:
            try:
                line = self._lines.get_nowait()
            except Empty:
                break
            if progress := contract.parse_progress(line):
                settings.done = progress.done / max(progress.total, 1)
                settings.job = f"{progress.done} of {progress.total} frames"
                for area in context.screen.areas if context.screen else ():
                    area.tag_redraw()

    def _finish(self, context: bpy.types.Context) -> set[str]:
        context.scene.rauca.dataset.job = ""
        if self._process.returncode == 0:
            self.report({"INFO"}, "Data set finished")
            return {"FINISHED"}
        reason = next((line for line in reversed(self._errors) if line.startswith(("error:", "interrupted:"))), "")
        self.report({"ERROR"}, reason.strip() or f"Rendering stopped with code {self._process.returncode}")
        return {"CANCELLED"}


CLASSES = (RAUCA_OT_generate_dataset,)
