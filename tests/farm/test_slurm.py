"""What `--export slurm` writes, run by a real Slurm on hosts of this machine."""

import time

import pytest

import slurm

REASON = slurm.missing()
pytestmark = pytest.mark.skipif(bool(REASON), reason=f"ignored: {REASON}")

SHOTS = 8


def wait_written(farm, count: int):
    """Waits until so many files were written."""
    for _ in range(600):
        if (farm.reports / "written.txt").is_file() and sum(farm.written().values()) >= count:
            return
        time.sleep(0.1)
    raise AssertionError(f"expected {count} files in a minute")


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
    wait_written(farm, 1)
    running = [line.split() for line in cluster.queue() if " RUNNING " in line]
    victim = next(node for name, _, _, node in running if name == "jobs")
    cluster.kill_node(victim)
    cluster.wait_ended()
    farm.check_whole(SHOTS)
    assert dict(farm.written()) == dict.fromkeys(farm.names(SHOTS), 1)
    assert len(farm.hosts()) >= 2 and farm.total()["ok"] == SHOTS
