"""Runs a batch over Dask with a scheduler and workers on several hosts, and lets hosts fail."""

import importlib.util
import os
import subprocess
import sys
import time

import pytest

import hosts

REASON = hosts.missing() or ("" if importlib.util.find_spec("distributed") else "needs distributed")
pytestmark = pytest.mark.skipif(bool(REASON), reason=f"ignored: {REASON}")

WORKERS = ["node1", "node2", "node3"]
SHOTS = 9
# A host that vanishes closes no connection. Dask waits five minutes for it unless told otherwise.
LIMITS = {
    "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "4s",
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s",
}


class Cluster:
    """A scheduler on the host `control`, and a worker of one thread on each other host."""

    def __init__(self, folder, environment: dict):
        self._environment = {**os.environ, **LIMITS, **environment}
        self._folder = folder
        self.hosts = hosts.Hosts(folder, ["control", *WORKERS])
        self.address = f"tcp://{self.hosts['control'].address}:8786"
        self._start("control", "scheduler", "--port", "8786")
        for name in WORKERS:
            words = ("--no-nanny", "--nthreads", "1", "--local-directory", folder / name)
            self._start(name, "worker", self.address, *words)

    def _start(self, name: str, role: str, *words):
        host = self.hosts[name]
        command = (sys.executable, "-m", "dask", role, *words, "--host", host.address)
        with open(self._folder / f"{name}.out", "wb") as out:
            host.start(*command, "--no-dashboard", env=self._environment, stdout=out, stderr=out)

    def start_batch(self, farm, *words) -> subprocess.Popen:
        """Starts the batch on the scheduler's host."""
        command = [sys.executable, farm.extension / "anyface_batch.py", "batch", farm.jobs]
        words = ("--scheduler", self.address, "--blender", farm.blender, *words)
        return self.hosts["control"].start(
            *command,
            *words,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )


@pytest.fixture
def cluster(farm, tmp_path_factory):
    """A cluster whose shots take a second."""
    cluster = Cluster(tmp_path_factory.mktemp("dask"), farm.environment(1.0))
    yield cluster
    cluster.hosts.close()


def wait_for_hosts(farm, count: int):
    """Waits until `count` hosts have written a file."""
    for _ in range(600):
        if len(farm.hosts()) >= count:
            return
        time.sleep(0.1)
    raise AssertionError("the workers did not begin in a minute")


def test_shots_of_a_host_that_is_cut_off_and_of_one_that_dies_are_done_elsewhere(farm, cluster):
    farm.write(SHOTS)
    batch = cluster.start_batch(farm)
    wait_for_hosts(farm, len(WORKERS))
    cluster.hosts.cut("node1")
    cluster.hosts["node2"].end()
    said = batch.communicate(timeout=100)[0]
    assert batch.returncode == 0, said
    farm.check_whole(SHOTS)
    assert farm.total()["ok"] == SHOTS
    written = farm.written()
    # Only the host that was cut off may have done a shot that another host did too.
    again = [name for name, times in written.items() if times > 1]
    assert len(again) <= 1 and set(written) == set(farm.names(SHOTS)), written
