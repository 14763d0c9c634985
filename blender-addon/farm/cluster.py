"""The same over Dask: its workers, on any number of machines, each do some shots in a row.

Only the Python that runs the batch and those of the workers need Dask; Blender's does not.
"""

import sys
from collections.abc import Iterator

from ..core import beside, errors, json_file
from ..core.errors import AnyfaceError, plain
from . import attempt, ledger

# So many parts of the work each thread of a worker gets, if there are enough shots.
_TURNS = 4


def run(
    command: list[str],
    shots: list[dict],
    scheduler: str,
    connect_s: float,
    chunk: int,
    **limits,
) -> Iterator[dict]:
    """Reports of all shots as they end, up to `chunk` of them by one process; those whose worker is
    lost go to another one, which does what is not finished yet."""
    distributed, cloudpickle = _dask()
    for module in (attempt, ledger, json_file, errors, beside):
        # Workers need not have the extension in their own Python.
        cloudpickle.register_pickle_by_value(module)
    try:
        client = distributed.Client(scheduler, timeout=connect_s)
    except (OSError, TimeoutError, ValueError) as error:
        text = f"no Dask scheduler at {scheduler}: {error}: start one, or check the address"
        raise AnyfaceError("input", text) from error
    work = attempt.run_shots

    def some(shots: list[dict]) -> list[dict]:
        # A function inside a function: Dask sends it by value, and what it calls with it.
        return list(work(command, shots, **limits))

    with client:
        threads = sum(client.nthreads().values())
        # Each of them gets several, so that none waits long for the last.
        size = max(1, min(chunk, len(shots) // (_TURNS * max(1, threads))))
        futures = {}
        for first in range(0, len(shots), size):
            part = shots[first : first + size]
            key = f"anyface-{part[0]['name']}-{part[0]['digest']}-{len(part)}"
            futures[client.submit(some, part, key=key)] = part
        for future in distributed.as_completed(list(futures)):
            yield from _reports(future, futures[future])


def _reports(future, shots: list[dict]) -> list[dict]:
    """The reports of shots; those that their worker has not sent say why."""
    try:
        if future.status == "finished":
            return future.result()
        if future.status == "error":
            error = plain(future.exception())
            text = f"its worker failed: {error}"
        else:
            text = f"the scheduler has dropped it ({future.status})"
    except BaseException as raised:
        text = f"its result did not arrive: {plain(raised)}"
    text = f"{text}: see that scheduler and workers run, then run the batch again"
    outcome = {"ok": False, "kind": "internal", "exit_code": 10, "message": text}
    return [ledger.finished(shot) or ledger.close(shot, outcome) for shot in shots]


def _dask():
    try:
        import cloudpickle
        import distributed
    except ImportError as error:
        raise AnyfaceError(
            "input",
            f"--scheduler needs Dask in the Python that starts the batch, and {sys.executable} has "
            "none: run `pip install distributed` and `python -m anyface_batch batch …` there "
            "(Blender itself needs no Dask), or leave --scheduler out",
        ) from error
    return distributed, cloudpickle
