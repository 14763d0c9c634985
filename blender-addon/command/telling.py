"""How far a long task is, for whoever waits in a terminal."""

import sys

from ..core.errors import say
from ..core.job import Job

# Seconds between two looks, and the share of a stage after which it is told again.
_LOOK_S, _SHARE = 0.2, 0.1


def work(snapshot, quiet: bool):
    """What `snapshot.work` returns; unless `quiet`, stages are told on standard error."""
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
    """Tells a new stage, or more of the same; returns what was told last."""
    stage, share = now
    if quiet or not stage or (stage == last[0] and share < last[1] + _SHARE):
        return last
    say(f"anyface: {name}: {stage} {share:.0%}", sys.stderr)
    return now
