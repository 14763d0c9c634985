"""The same over Dask: its workers, on any number of machines, each run one shot at a time.

Only the Python that runs the batch and those of the workers need Dask; Blender's does not.
"""

import sys
from collections.abc import Iterator

from ..core import beside, errors, json_file
from ..core.errors import AnyfaceError, plain
from . import attempt, ledger


def run(
    command: list[str], shots: list[dict], scheduler: str, connect_s: float, **limits
) -> Iterator[dict]:
    """Reports of all shots as they end; a shot whose worker is lost goes to another one."""
    distributed, cloudpickle = _dask()
    for module in (attempt, ledger, json_file, errors, beside):
        # Workers need not have the extension in their own Python.
        cloudpickle.register_pickle_by_value(module)
    try:
        client = distributed.Client(scheduler, timeout=connect_s)
    except (OSError, TimeoutError, ValueError) as error:
        text = f"no Dask scheduler at {scheduler}: {error}: start one, or check the address"
        raise AnyfaceError("input", text) from error
    work = attempt.run_shot

    def one(shot: dict) -> dict:
        # A function inside a function: Dask sends it by value, and what it calls with it.
        return work(command, shot, **limits)

    with client:
        futures = {}
        for shot in shots:
            key = f"anyface-{shot['name']}-{shot['digest']}"
            futures[client.submit(one, shot, key=key)] = shot
        for future in distributed.as_completed(list(futures)):
            yield _report(future, futures[future])


def _report(future, shot: dict) -> dict:
    """The report of a shot, or one that says why its worker has sent none."""
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
    return ledger.close(shot, {"ok": False, "kind": "internal", "exit_code": 10, "message": text})


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
