"""What the operators share: a mistake is reported in one line, and the scene is left as it was."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import bpy
from bpy.app.translations import pgettext_rpt as rpt
from bpy.app.translations import pgettext_tip as tip

from ..core import contract
from ..jobs import watch
from ..jobs.background import Job
from ..jobs.child import with_buttons

NO_UNDO = {"REGISTER"}  # of an operator that leaves the scene as it is
TICK_S = 0.1


@dataclass(frozen=True)
class Obstacle:
    """Why a button cannot be pressed, in English, while ``stands``; asked for at every redraw."""

    words: str
    stands: Callable[[bpy.types.Context], bool]


NO_COAT = Obstacle("Apply a camouflage first", lambda context: context.scene.rauca.camouflage.coat is None)
LINKED = Obstacle(
    "This scene is linked from another file: open that file", lambda context: context.scene.library is not None
)
NOT_OBJECT_MODE = Obstacle("Leave edit mode first", lambda context: context.mode != "OBJECT")
NOT_PICKED = Obstacle(
    "Pick the vehicle's object or collection first", lambda context: context.scene.rauca.vehicle.picked(context) is None
)

VIEWS = ("cameras", "camouflage", "photograph")  # steps that may look through a camera of their own
LEAVE_FIRST = "Leave the view that is looked through first"


def covered(mine: str) -> Obstacle:
    """While a step's view lies below a later one: the last is left first, so that each gives back what it found."""

    def stands(context: bpy.types.Context) -> bool:
        others = [getattr(context.scene.rauca, step).camera for step in VIEWS if step != mine]
        return getattr(context.scene.rauca, mine).camera is not None and context.scene.camera in filter(None, others)

    return Obstacle(LEAVE_FIRST, stands)


def see_through_camera(context: bpy.types.Context, wanted: bool) -> None:
    """Look through the scene's camera as Numpad 0 does, or back from where the user looked before."""
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and (space.region_3d.view_perspective == "CAMERA") != wanted:
        bpy.ops.view3d.view_camera()


class RaucaOperator:
    """Base of an operator that does its work at once; the subclass also derives from ``bpy.types.Operator``.

    Blender knows ``RAUCA_OT_name`` as ``rauca.name``.
    """

    bl_idname: ClassVar[str]
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    obstacles: ClassVar[tuple[Obstacle, ...]] = ()

    def __init_subclass__(cls) -> None:
        cls.bl_idname = cls.__name__.replace("RAUCA_OT_", "rauca.")

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Of a button that makes one of several choices, that choice's tooltip; empty: the operator's own."""
        for name, known in properties.bl_rna.properties.items():
            if known.type == "ENUM" and (chosen := known.enum_items.get(getattr(properties, name))):
                return str(tip(chosen.description))
        return ""

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        """Why it cannot be pressed at present, translated; empty if it can."""
        return next((rpt(obstacle.words) for obstacle in cls.obstacles if obstacle.stands(context)), "")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if reason := cls.obstacle(context):
            cls.poll_message_set(reason)  # type: ignore[attr-defined]
        return not reason

    def work(self, context: bpy.types.Context) -> str | None:
        """Do it; returns what to tell the user, if anything.

        Raises:
            RaucaError: a mistake, in words that say what to do; nothing was changed.
        """
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            told = self.work(context)
        except contract.RaucaError as error:
            return self.refuse(error)
        if told:
            self.report({"INFO"}, rpt(told))  # type: ignore[attr-defined]
        return {"FINISHED"}

    def refuse(self, error: contract.RaucaError) -> set[str]:
        """Report a mistake and end."""
        self.report({"ERROR"}, rpt(with_buttons(str(error))))  # type: ignore[attr-defined]
        return {"CANCELLED"}


class BackgroundOperator(RaucaOperator):
    """Base of an operator that starts a job; the subclass also derives from ``bpy.types.Operator``.

    In a window it returns at once and the panel shows the job. A script without a window has no timer: there it returns
    when the job has ended, unless ``wait`` is given as False.

    A subclass gives ``job``, its name, and ``running``, why it cannot be started twice; ``missing = staticmethod(...)``
    where what is to be done before depends on more than one obstacle.
    """

    bl_options = NO_UNDO
    job: str
    running: str

    wait: bpy.props.BoolProperty(
        name="Wait", description="Return only when the job has ended", options={"SKIP_SAVE", "HIDDEN"}
    )

    @staticmethod
    def missing(context: bpy.types.Context) -> str:
        """What to do before it can be pressed, translated; empty when all is there."""
        return ""

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        reason = cls.missing(context) or super().obstacle(context)
        return reason or (rpt(cls.running) if watch.busy(cls.job) else "")

    def begin(self, context: bpy.types.Context) -> None:
        """Start the job with :func:`watch.begin`; raises :class:`RaucaError`."""
        raise NotImplementedError

    def work(self, context: bpy.types.Context) -> str | None:
        self.begin(context)
        watch.redraw()
        given = self.properties.is_property_set("wait")  # type: ignore[attr-defined]
        if not (self.wait if given else bpy.app.background):
            return None
        job = watch.run_to_end(self.job)
        return None if job.alive else self.outcome(context, job)

    def outcome(self, context: bpy.types.Context, job: Job) -> str:
        """What to tell a script that waited; raises :class:`RaucaError` for what went wrong."""
        if job.phase == "failed":
            raise contract.RaucaError(job.ending)
        return job.ending


class Work(Protocol):
    """What a :class:`ModalOperator` waits for: a thread or a process."""

    def is_alive(self) -> bool:
        """Whether it still works; its result is there once it does not."""

    def stop(self) -> None:
        """Give it up, if it still works, and remove its traces."""


class ModalOperator(RaucaOperator):
    """Base of an operator that waits for work beside the window, then puts the result in place; Esc stops it.

    The subclass also derives from ``bpy.types.Operator`` and gives ``stopped``, what is told then.
    """

    stopped: str
    under_way: ClassVar[dict[str, Any]] = {}  # by the operator's class; one of each at most

    def begin(self, context: bpy.types.Context) -> Work:
        """Start the work; raises :class:`RaucaError`."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, work: Any) -> Generator[None]:
        """Put the result in place and report it, in steps between which the window draws.

        Raises:
            RaucaError: the work failed, or its result does not fit any more.
        """
        raise NotImplementedError

    @classmethod
    def running(cls) -> Any:
        """The work under way, or None."""
        return cls.under_way.get(cls.__name__)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            work = self.begin(context)
        except contract.RaucaError as error:
            return self.refuse(error)
        self.under_way[type(self).__name__] = work
        self._finishing = self.finish(context, work)
        self._timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        work = self.running()
        if work is None or event.type == "ESC":
            self.report({"INFO"}, rpt(self.stopped))  # type: ignore[attr-defined]
            ended = {"CANCELLED"}
        elif event.type != "TIMER":
            return {"PASS_THROUGH"}
        else:
            watch.redraw()
            try:
                if not work.is_alive():
                    next(self._finishing)
                return {"PASS_THROUGH"}
            except StopIteration:
                ended = {"FINISHED"}
            except contract.RaucaError as error:
                ended = self.refuse(error)
        self.cancel(context)
        return ended

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this too: another file is loaded, or the window closes."""
        self._finishing.close()
        context.window_manager.event_timer_remove(self._timer)
        if work := self.under_way.pop(type(self).__name__, None):
            work.stop()
        watch.redraw()


def unregister() -> None:
    """The add-on is disabled: what works beside the window ends without a result."""
    while ModalOperator.under_way:
        ModalOperator.under_way.popitem()[1].stop()
