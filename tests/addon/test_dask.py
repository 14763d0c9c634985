"""The same batch over Dask: a scheduler and worker processes of a real cluster on this machine."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from floor import LIMIT_S, Floor, wait_gone

pytest.importorskip("distributed")


class Cluster:
    """One scheduler and `count` workers, each a process that runs one shot at a time."""

    def __init__(self, folder, environment, count):
        self._file, self._environment = folder / "scheduler.json", environment
        self._folder = folder
        self._processes = [self._dask("scheduler", "--host", "127.0.0.1", "--port", "0")]
        for _ in range(600):
            if self._file.exists() and self._file.stat().st_size:
                break
            time.sleep(0.1)
        self.address = json.loads(self._file.read_text())["address"]
        self.workers = [self._worker(number) for number in range(count)]

    def _worker(self, number):
        local_directory = ("--local-directory", str(self._folder / f"worker{number}"))
        return self._dask("worker", "--no-nanny", "--nthreads", "1", *local_directory)

    def _dask(self, role, *words):
        command = [sys.executable, "-m", "dask", role, "--no-dashboard", "--scheduler-file"]
        return subprocess.Popen(
            [*command, str(self._file), *words],
            env=self._environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def close(self):
        """Kills all processes."""
        for process in [*self.workers, *self._processes]:
            process.kill()
            process.wait()


@pytest.fixture
def floor(tmp_path, installed):
    """A place to run batches in."""
    return Floor(tmp_path, installed)


@pytest.fixture
def cluster(floor):
    """Three workers; each shot takes two seconds on them."""
    environment = floor.environment(seconds=2.0)
    cluster = Cluster(floor.folder, {**os.environ, **environment}, 3)
    yield cluster
    cluster.close()


def test_every_shot_ends_once_though_a_worker_is_killed_at_work(floor, cluster):
    floor.write(6)
    batch = floor.start("--scheduler", cluster.address)
    floor.wait_begun(4)
    # The shot that began last has most of its work still to do.
    at_work, _ = floor.begun()[-1]
    victim = next(worker for worker in cluster.workers if worker.pid == at_work)
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    orphans = [child for parent, child in floor.begun() if parent == victim.pid]
    text = batch.communicate(timeout=LIMIT_S)[0]
    assert batch.returncode == 0, text
    assert floor.ended() == {f"sh{n:02d}": 1 for n in range(6)}
    for child in orphans:
        wait_gone(child)
    hands = {parent for parent, _ in floor.begun()}
    assert hands <= {worker.pid for worker in cluster.workers} and len(hands) >= 2
    assert len(floor.begun()) > 6, "the killed shot was begun elsewhere again"
    whole = sorted(path.name for path in (floor.folder / "out").iterdir())
    assert whole == [f"sh{n:02d}.blend" for n in range(6)]


def test_a_bad_shot_is_reported_and_a_second_run_does_only_that(floor, cluster):
    floor.write(2)
    jobs = json.loads(floor.jobs.read_text())
    jobs["shots"][1]["object"] = "Hed"
    floor.jobs.write_text(json.dumps(jobs))
    code, text = floor.run("--scheduler", cluster.address)
    assert code == 12, text
    assert floor.report("sh00")["ok"] and floor.report("sh01")["exit_code"] == 3
    assert floor.run("--scheduler", cluster.address)[0] == 12
    assert floor.ended() == {"sh00": 1, "sh01": 2}


def test_no_scheduler_is_an_error_with_its_address(floor):
    floor.write(1)
    code, text = floor.run("--scheduler", "tcp://127.0.0.1:9", "--connect", "2")
    assert code == 3 and "tcp://127.0.0.1:9" in text


def test_without_dask_the_remedy_is_named(floor):
    floor.write(1)
    (floor.folder / "distributed.py").write_text("raise ImportError('hidden')")
    more = {"PYTHONPATH": str(floor.folder)}
    code, text = floor.run("--scheduler", "tcp://127.0.0.1:9", more=more)
    assert code == 3 and "pip install distributed" in text
