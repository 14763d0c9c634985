"""An engine that loads its models at first use: in a worker thread, not in the interface."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any


class LazyEngine:
    """Stands in for the engine that `load()` makes: every attribute comes from that engine.

    Calls `load` at each use until it succeeds, and raises what `load` raises. `models` is the
    folder of its models, known before they are read.
    """

    def __init__(self, load: Callable[[], object], models: Path | None = None):
        self._load, self.models = load, models
        self._engine: Any = None
        self._lock = threading.Lock()

    @property
    def is_loaded(self) -> bool:
        """True once the models are in memory."""
        return self._engine is not None

    def close(self) -> None:
        """Frees the models, if they were loaded."""
        with self._lock:
            engine, self._engine = self._engine, None
        if engine is not None:
            engine.close()

    def __getattr__(self, name: str):
        with self._lock:
            if self._engine is None:
                self._engine = self._load()
            return getattr(self._engine, name)
