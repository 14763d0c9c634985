"""A real Slurm on hosts of this machine runs what `--export slurm` writes."""

import time

import pytest

import slurm

REASON = slurm.missing()
pytestmark = pytest.mark.skipif(bool(REASON), reason=f"ignored: {REASON}")

SHOTS = 8


def wait_victim(farm, cluster) -> str:
    """Waits for a node that has written a file and is writing the next; returns its name."""
    for _ in range(600):
        # Read the hosts before the queue. The queue takes longer to answer than a host takes to
        # report a file that it has written.
        hosts = farm.hosts()
        running = [line.split() for line in cluster.queue() if " RUNNING " in line]
        nodes = {node for name, _, _, node in running if name == "jobs"}
        if found := nodes & hosts:
            return found.pop()
        time.sleep(0.1)
    raise AssertionError("expected a node between two files within a minute")


@pytest.fixture
def cluster(farm, tmp_path_factory):
    """Three nodes of two cores."""
    cluster = slurm.Slurm(tmp_path_factory.mktemp("slurm"), 3, farm.environment(1.0))
    yield cluster
    cluster.close()


def test_a_killed_node_loses_no_row_and_none_is_done_twice(farm, cluster):
    farm.write(SHOTS)
    script = farm.export("slurm", "--chunk", 2, "--cores", 1, "--memory", 0.5) / "anyface.sh"
    assert "to start at" in cluster.run("sbatch", "--test-only", script)
    cluster.run("bash", script)
    victim = wait_victim(farm, cluster)
    cluster.kill_node(victim)
    cluster.wait_ended()
    farm.check_whole(SHOTS)
    assert dict(farm.written()) == dict.fromkeys(farm.names(SHOTS), 1)
    assert farm.hosts() > {victim} and farm.total()["ok"] == SHOTS
