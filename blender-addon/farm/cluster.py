"""Runs a batch over Dask: its workers, on any number of machines, each do some shots in a row.

The Python that runs the batch and the workers' Pythons need Dask; Blender's Python does not.
"""

import sys
from collections.abc import Iterator

from ..core import beside, errors, json_file
from ..core.errors import AnyfaceError, plain
from . import attempt, ledger

# Each thread of a worker gets this many parts of the work, if there are enough shots.
_TURNS = 4


def run(
    command: list[str],
    shots: list[dict],
    scheduler: str,
    connect_s: float,
    chunk: int,
    **limits,
) -> Iterator[dict]:
    """Yields the reports of all shots as they end; a process does up to `chunk` shots.

    If a worker is lost, another one gets its shots and does those that are not finished yet.
    """
    distributed, cloudpickle = _dask()
    for module in (attempt, ledger, json_file, errors, beside):
        # The workers' Python may lack the extension, so the modules travel with the work.
        cloudpickle.register_pickle_by_value(module)
    try:
        client = distributed.Client(scheduler, timeout=connect_s)
    except (OSError, TimeoutError, ValueError) as error:
        text = f"no Dask scheduler at {scheduler}: {error}: start one, or check the address"
        raise AnyfaceError("input", text) from error
    work = attempt.run_shots

    def some(shots: list[dict]) -> list[dict]:
        # This is an inner function so that Dask sends it by value, with all that it calls.
        return list(work(command, shots, **limits))

    with client:
        threads = sum(client.nthreads().values())
        # Each thread gets several parts, so that none waits long for the last one to end.
        size = max(1, min(chunk, len(shots) // (_TURNS * max(1, threads))))
        futures = {}
        for first in range(0, len(shots), size):
            part = shots[first : first + size]
            key = f"anyface-{part[0]['name']}-{part[0]['digest']}-{len(part)}"
            futures[client.submit(some, part, key=key)] = part
        for future in distributed.as_completed(list(futures)):
            yield from _reports(future, futures[future])


def _reports(future, shots: list[dict]) -> list[dict]:
    """The reports of shots. If the worker sent none, those of unfinished shots say why."""
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
