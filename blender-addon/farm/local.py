"""Runs shots in a pool of processes on this machine."""

import os
import queue
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed

from .attempt import ShotProcess


def run(
    command: list[str], shots: list[dict], workers: int, chunk: int, **limits
) -> Iterator[dict]:
    """Yields the reports of all shots as they end, with `workers` processes at a time.

    A process does up to `chunk` shots and gets an equal share of the cores. `limits` are passed to
    `ShotProcess.do`. If the caller stops early, running processes are ended.
    """
    threads = max(1, (os.cpu_count() or 1) // workers)
    processes = [ShotProcess(command, threads, chunk) for _ in range(workers)]
    idle, stop = queue.SimpleQueue(), threading.Event()
    for process in processes:
        idle.put(process)

    def one(shot: dict) -> dict:
        process = idle.get()
        try:
            return process.do(shot, stop=stop, **limits)
        finally:
            idle.put(process)

    with ThreadPoolExecutor(workers) as pool:
        waiting = [pool.submit(one, shot) for shot in shots]
        try:
            for future in as_completed(waiting):
                yield future.result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)
            for process in processes:
                process.close()
