"""Trainings that are killed in the middle, for tests of how they go on."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from training.run import Run


@contextmanager
def killed(monkeypatch: pytest.MonkeyPatch, saved_step: int, last_step: int) -> Iterator[None]:
    """Kills the training within behind its step `last_step`; its checkpoint is of `saved_step`."""
    after = Run.after

    def kill(run: Run, step: int, loss: float) -> None:
        after(run, step, loss)
        if step == saved_step:
            run.save(step + 1)
        if step == last_step:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Run, "after", kill)
        with pytest.raises(KeyboardInterrupt):
            yield
