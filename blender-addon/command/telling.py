"""Prints the progress of a long task to the terminal."""

import sys

from ..core.errors import say
from ..core.job import Job

# Seconds between two checks of the job, and the share of a stage between two printed lines.
_LOOK_S, _SHARE = 0.2, 0.1


def work(snapshot, quiet: bool):
    """Runs `snapshot.work`, returns its result; prints stages to standard error unless `quiet`."""
    job, last = Job(snapshot.work).start(), ("", 0.0)
    try:
        while not job.wait(_LOOK_S):
            last = _tell(snapshot.object_name, job.progress.at, last, quiet)
    except BaseException:
        job.cancel(wait_s=None)
        raise
    _tell(snapshot.object_name, job.progress.at, ("", 0.0), quiet)
    return job.result()


def _tell(name: str, now: tuple[str, float], last: tuple[str, float], quiet: bool):
    """Prints a new stage, or progress in the same one; returns what was printed last."""
    stage, share = now
    if quiet or not stage or (stage == last[0] and share < last[1] + _SHARE):
        return last
    say(f"anyface: {name}: {stage} {share:.0%}", sys.stderr)
    return now
