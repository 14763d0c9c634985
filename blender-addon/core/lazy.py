"""An engine whose models are loaded by whoever needs them first: a worker, not the interface."""

import threading
from collections.abc import Callable
from pathlib import Path


class LazyEngine:
    """Stands for the engine that `load()` makes; everything asked of it is asked of that one.

    Raises what `load` raises, again at every use until it succeeds. `models` is the folder of its
    models, known before they are read.
    """

    def __init__(self, load: Callable[[], object], models: Path | None = None):
        self._load, self.models = load, models
        self._engine = None
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
