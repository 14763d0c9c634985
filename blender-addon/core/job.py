"""One long call in a worker thread, with progress and a way to stop it."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from .errors import AnyfaceError, Cancelled, plain


class Progress:
    """How far a job is, and whether it should stop; safe to share between threads.

    A job reports its stages with `check`, or attaches a running native call to read them from.
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
        """Reports a stage; raises `Cancelled` once the job was asked to stop."""
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


# A generator that writes a result yields this once it has begun to change things. From then on it
# runs to its end, whatever the artist presses; the yield also gives the interface a turn.
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
    """A function for a worker thread; `about` is for the code that writes its result."""

    work: Callable[[Progress], object]
    about: object = None


def _keep(_outcome) -> None:
    """Discards nothing: most results lie only in memory."""


class Job:
    """Runs `work(progress)` in a thread; the result or the error is fetched with `result`.

    `discard` removes what a result has left on disk if nobody fetches it.
    """

    def __init__(
        self, work: Callable[[Progress], object], discard: Callable[[object], None] = _keep
    ):
        self.progress = Progress()
        self._work, self._discard = work, discard
        self._outcome: object = None
        self._ended = self._unwanted = False
        self._lock = threading.Lock()
        # This error stays if the thread ends without a result.
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
        """Drops the result: what it leaves on disk is removed as soon as the work has ended."""
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
            # A thread would swallow the exception, and the artist would wait for ever.
            self._error = plain(error)
        with self._lock:
            self._ended = True
            unwanted = self._unwanted
        if unwanted and self._error is None:
            self._discard(self._outcome)
