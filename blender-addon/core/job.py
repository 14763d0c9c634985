"""One long call in a worker thread, with progress and a way to stop it."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from .errors import AnyfaceError, Cancelled, plain


class Progress:
    """How far a job is, and whether it is to stop; safe to share between threads.

    Stages are reported with `check`, or read from a running native call that was attached.
    """

    def __init__(self):
        self._at = "", 0.0
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._read: Callable[[], tuple[str, float]] | None = None
        self._cancel: Callable[[], None] | None = None

    @property
    def at(self) -> tuple[str, float]:
        """The name of the stage ("" before the first) and its done share, 0 to 1."""
        with self._lock:
            if self._read is not None:
                self._at = self._read()
            return self._at

    @property
    def cancelled(self) -> bool:
        """True once the job was asked to stop."""
        return self._stop.is_set()

    def check(self, stage: str, fraction: float = 0.0) -> None:
        """Reports, and raises `Cancelled` once the job is to stop."""
        self._at = stage, fraction
        if self.cancelled:
            raise Cancelled

    def cancel(self) -> None:
        """Asks the job to stop."""
        self._stop.set()
        with self._lock:
            if self._cancel is not None:
                self._cancel()

    def attach(self, read: Callable[[], tuple[str, float]], cancel: Callable[[], None]) -> None:
        """Hands over to a native call: `read` tells how far it is, `cancel` stops it."""
        with self._lock:
            self._read, self._cancel = read, cancel
            if self.cancelled:
                cancel()

    def detach(self) -> None:
        """The native call has ended; its `read` and `cancel` are not called any more."""
        with self._lock:
            self._read = self._cancel = None


# What a generator that lands a result yields once it has begun to change things: it goes on to its
# end then, whatever the artist presses, and gives the interface a turn.
BEGUN = "begun"


def at_once(steps):
    """Runs a generator to its end; returns what it returns."""
    while True:
        try:
            next(steps)
        except StopIteration as ended:
            return ended.value


@dataclass
class Work:
    """What runs in a worker thread, and what it is `about` for whoever writes its result."""

    work: Callable[[Progress], object]
    about: object = None


def _keep(_outcome) -> None:
    """Nothing of most results lies elsewhere than in memory."""


class Job:
    """Runs `work(progress)` in a thread; the result or the error is fetched with `result`.

    `discard` takes back what a result that nobody fetches has left on disk.
    """

    def __init__(
        self, work: Callable[[Progress], object], discard: Callable[[object], None] = _keep
    ):
        self.progress = Progress()
        self._work, self._discard = work, discard
        self._outcome: object = None
        self._ended = self._unwanted = False
        self._lock = threading.Lock()
        # Whatever ends the thread before it has a result is an error.
        self._error: AnyfaceError | None = AnyfaceError(
            "internal", "the work ended without a result: start it again"
        )
        self._thread = threading.Thread(target=self._run, name="anyface", daemon=True)

    def start(self) -> "Job":
        """Starts the thread."""
        self._thread.start()
        return self

    @property
    def done(self) -> bool:
        """True once the thread has ended."""
        return not self._thread.is_alive()

    def cancel(self, wait_s: float | None = 0.0) -> None:
        """Asks the work to stop and waits up to `wait_s` seconds (None: until it has)."""
        self.progress.cancel()
        self._thread.join(wait_s)

    def wait(self, seconds: float) -> bool:
        """Waits for the thread's end, `seconds` at most; True once it has ended."""
        self._thread.join(seconds)
        return self.done

    def result(self):
        """What the work returned; raises the `AnyfaceError` that it raised."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._outcome

    def discard(self) -> None:
        """Nobody wants the result: what it leaves on disk is taken back as soon as it is there."""
        with self._lock:
            self._unwanted = True
            ended = self._ended
        if ended and self._error is None:
            self._discard(self._outcome)

    def _run(self) -> None:
        try:
            self._outcome = self._work(self.progress)
            self._error = None
        except BaseException as error:
            # A thread would swallow it, and the artist would wait for ever.
            self._error = plain(error)
        with self._lock:
            self._ended = True
            unwanted = self._unwanted
        if unwanted and self._error is None:
            self._discard(self._outcome)
