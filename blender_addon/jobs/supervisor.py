"""One run over the frames that a data set lacks: workers are hired, replaced and heard, the ledger is kept."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue

from ..core import contract
from .workers import News, Worker

REMEMBERED = 64
ATTEMPTS = 2
GRACE_S = 20.0  # for the frame in flight when interrupted; less than `rauca dataset make` grants Blender
BARREN_STARTS = 3


class Pace:
    """Times of the latest frames; starts when made, so the first estimate includes what it took to get going."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._times: deque[float] = deque([clock()], maxlen=REMEMBERED)

    def step(self) -> None:
        """A frame was rendered."""
        self._times.append(self._clock())

    def left_s(self, frames: int) -> float | None:
        """Seconds that ``frames`` more will take; None before the first."""
        if len(self._times) < 2:
            return None
        return frames * (self._times[-1] - self._times[0]) / (len(self._times) - 1)


@dataclass(frozen=True)
class Crew:
    """How the work is staffed.

    Attributes:
        command: starts a worker.
        workers: how many run at once.
        recycle: frames after which a worker is replaced, so that what Blender leaks stays small.
    """

    command: Sequence[str]
    workers: int = 1
    recycle: int = 200


@dataclass(frozen=True)
class Listener:
    """Who is told: ``progress`` at every settled frame, ``note`` of what goes wrong, ``news`` of everything."""

    progress: Callable[[contract.Progress], None]
    note: Callable[[str], None]
    news: Callable[[Worker, News], None] = lambda worker, news: None


class Supervisor:
    """One run over the frames that a folder lacks."""

    def __init__(
        self, folder: Path, shard: contract.Shard, crew: Crew, listener: Listener, claim: Callable[[], None]
    ) -> None:
        """``claim`` is called once, when the first worker has built its scene: until then nothing is written."""
        self._folder, self._shard, self._crew, self._listener = folder, shard, crew, listener
        self._claim: Callable[[], None] | None = claim
        self._inbox: SimpleQueue[tuple[Worker, News | None]] = SimpleQueue()
        self._workers: set[Worker] = set()
        self._pieces: deque[list[str]] = deque()
        self._attempts: Counter[str] = Counter()
        self._noted: set[str] = set()
        self._barren = 0
        self._pace = Pace()
        self._done = self._total = 0
        self.quarantined: dict[str, str] = {}

    def run(self, pieces: Iterable[list[str]], done: int) -> None:
        """Render pieces of work to the end; ``done`` frames of the shard were there before.

        Afterwards :attr:`quarantined` names the frames that failed twice, with the reasons.

        Raises:
            RaucaError: a mistake that only the user can mend, or workers that die before their first frame.
            KeyboardInterrupt: passed on, once the frames in flight are finished and the workers gone.
        """
        self._pieces.extend(pieces)
        self._done, self._total = done, done + sum(map(len, self._pieces))
        self._listener.progress(contract.Progress(self._done, self._total, ""))
        try:
            self._hire()
            while self._workers:
                worker, news = self._inbox.get()
                if news is None:
                    self._bury(worker)
                else:
                    self._hear(worker, news)
        except BaseException:
            self._stop()
            raise

    def _hire(self) -> None:
        """Start workers while there is work for them; only one until the folder is claimed."""
        most = 1 if self._claim else self._crew.workers
        while len(self._workers) < min(most, len(self._pieces)):
            self._workers.add(Worker(self._crew.command, self._inbox))

    def _hear(self, worker: Worker, news: News) -> None:
        self._listener.news(worker, news)
        if news.event == "ready" and self._claim:
            self._claim()
            self._claim = None
            self._hire()
        if news.event in ("ready", "idle"):
            self._employ(worker)
        elif news.event == "note":
            if news.reason not in self._noted:  # every worker builds the same scene
                self._noted.add(news.reason)
                self._listener.note(news.reason)
        elif news.event == "begin":
            worker.in_flight, self._barren = news.frame, 0
        elif news.event == "failed":
            worker.settle(news.frame)
            self._fail(news.frame, news.reason)
        else:
            worker.settle(news.frame)
            self._settle(news)

    def _employ(self, worker: Worker) -> None:
        """Give a worker its next piece, or let it go when there is none that it may do."""
        if self._pieces:
            piece = self._pieces[0]
            tired = worker.rendered + len(piece) > self._crew.recycle
            # A second try wants a worker that has done nothing before.
            if not worker.rendered or not (tired or self._attempts[piece[0]]):
                worker.give(self._pieces.popleft())
                return
        worker.dismiss()

    def _bury(self, worker: Worker) -> None:
        """See to what an ended worker left, and replace it."""
        self._workers.discard(worker)
        if (worker.piece or not worker.rendered) and (mistake := worker.mistake()):
            raise contract.RaucaError(mistake)
        if left := [frame for frame in worker.piece if frame != worker.in_flight]:
            self._pieces.appendleft(left)
        if worker.in_flight:
            self._fail(worker.in_flight, worker.death())
        elif not worker.rendered and (worker.piece or self._pieces):
            self._barren += 1
            if self._barren >= BARREN_STARTS:
                raise contract.RaucaError(f"{BARREN_STARTS} workers died before their first frame: {worker.death()}")
        self._hire()

    def _settle(self, news: News) -> None:
        if news.event == "done":
            entry = contract.LedgerEntry(news.frame, "done", seconds=news.seconds)
            self._pace.step()
        else:
            entry = contract.LedgerEntry(news.frame, "occluded", visible=news.visible)
        contract.append_entry(self._folder, entry, self._shard.label)
        self._advance(news.frame)

    def _fail(self, frame: str, reason: str) -> None:
        self._attempts[frame] += 1
        again = self._attempts[frame] < ATTEMPTS
        state = "failed" if again else "quarantined"
        contract.append_entry(self._folder, contract.LedgerEntry(frame, state, reason=reason), self._shard.label)
        self._listener.note(f"{frame} failed: {reason}; " + ("trying it once more" if again else "left out"))
        if again:
            self._pieces.append([frame])
        else:
            self.quarantined[frame] = reason
            self._advance(frame)

    def _advance(self, frame: str) -> None:
        self._done += 1
        left = self._pace.left_s(self._total - self._done)
        self._listener.progress(contract.Progress(self._done, self._total, frame, left))

    def _stop(self) -> None:
        """Let the frames in flight finish and be entered, then end what is still there; a second Ctrl-C hurries."""
        deadline = time.monotonic() + GRACE_S
        try:
            for worker in self._workers:
                worker.dismiss() if worker.in_flight else worker.kill()
            while self._workers:
                worker, news = self._inbox.get(timeout=max(0.0, deadline - time.monotonic()))
                if news is None:
                    self._workers.discard(worker)
                elif news.event in ("done", "occluded"):
                    worker.settle(news.frame)
                    self._settle(news)
        except (Empty, KeyboardInterrupt):
            pass
        finally:
            for worker in self._workers:
                worker.kill()
            for worker in self._workers:
                worker.death()
