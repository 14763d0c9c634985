"""A real Slurm on hosts of this machine: a controller and nodes that run batch jobs.

Debian's packages `slurm-wlm` and `munge` contain the programs. The nodes share files, as on a
cluster. Each node has its own network, name and processes.
"""

import contextlib
import os
import re
import secrets
import shutil
import subprocess
import time
from pathlib import Path

import hosts

_PROGRAMS = ("slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "munged")
_CONFIGURATION = """
ClusterName=anyface
SlurmctldHost=control
SlurmUser=root
AuthType=auth/munge
# A job that lost its node is begun again after cred_expire seconds; Slurm's default is 120.
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=2,bf_interval=2,batch_sched_delay=0,sched_min_interval=0
SlurmdParameters=config_overrides
ReturnToService=2
SlurmdTimeout=3
MessageTimeout=3
KillWait=2
MinJobAge=5
BatchStartTimeout=1
JobRequeue=1
NodeName={nodes} CPUs={cores} RealMemory={memory_mb} State=UNKNOWN
PartitionName=farm Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
_LIMIT_S = 60


def missing() -> str:
    """Why Slurm cannot run here; empty if it can."""
    for program in _PROGRAMS:
        if _program(program) is None:
            return f"Slurm needs the program {program}: apt-get install slurm-wlm munge"
    return hosts.missing()


class Slurm:
    """A running controller with `nodes` running nodes; every job sees `environment`."""

    def __init__(self, folder: Path, nodes: int, environment: dict, cores=2, memory_mb=8192):
        self.folder = folder
        self.nodes = [f"node{number}" for number in range(1, nodes + 1)]
        (folder / "state").mkdir()
        text = _CONFIGURATION.format(
            folder=folder, nodes=f"node[1-{nodes}]", cores=cores, memory_mb=memory_mb
        )
        (folder / "slurm.conf").write_text(text)
        self._environment = {**os.environ, **environment, "SLURM_CONF": str(folder / "slurm.conf")}
        self._munge, self.hosts, self._daemons = None, None, {}
        try:
            self._start_munge()
            self.hosts = hosts.Hosts(folder, ["control", *self.nodes])
            self.start_control()
            for node in self.nodes:
                self._start_node(node)
            self.wait_idle(len(self.nodes))
        except BaseException:
            self.close()
            raise

    def _start_munge(self):
        key = self.folder / "munge.key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o600)
        words = ["--foreground", "--force", f"--key-file={key}"]
        for option, name in (("socket", "socket"), ("pid-file", "pid"), ("seed-file", "seed")):
            words.append(f"--{option}={self.folder}/munge.{name}")
        words.append(f"--log-file={self.folder}/munge.log")
        self._munge = subprocess.Popen([_program("munged"), *words], stderr=subprocess.DEVNULL)
        _wait(lambda: (self.folder / "munge.socket").exists(), "munged does not start")

    def start_control(self):
        """Starts the controller, which reads the jobs that it has saved."""
        self._start("control", "slurmctld", "-D")

    def kill_control(self):
        """Kills the controller; its host and its jobs go on."""
        self._daemons["control"].kill()
        self._daemons["control"].wait()
        # The program that entered the host is dead. The controller inside it may still run.
        self.hosts["control"].run("sh", "-c", "pkill -9 slurmctld; true")

    def kill_node(self, node: str):
        """Pulls the plug of a node: its daemon ends, with everything that it has started."""
        self.hosts[node].end()

    def boot_node(self, node: str):
        """Starts a node that was killed."""
        self.hosts.boot(node)
        self._start_node(node)

    def _start_node(self, node: str):
        self._start(node, "slurmd", "-D", "-N", node)

    def _start(self, host: str, program: str, *words: str):
        with open(self.folder / f"{program}-{host}.out", "ab") as out:
            self._daemons[host] = self.hosts[host].start(
                _program(program), *words, env=self._environment, stdout=out, stderr=out
            )

    def run(self, program: str, *words, **more) -> str:
        """Runs a program of Slurm on the controller's host; returns its output."""
        return self.hosts["control"].run(program, *words, env=self._environment, **more)

    def states(self) -> dict[str, str]:
        """The state of each node, in small letters, such as "idle" or "idle+drain"."""
        lines = self.run("scontrol", "show", "nodes", "--oneliner").splitlines()
        matches = [re.search(r"NodeName=(\S+) .*?State=(\S+)", line) for line in lines]
        return {match[1]: match[2].lower() for match in matches if match}

    def wait_control(self):
        """Waits until the controller answers."""

        def ready() -> bool:
            with contextlib.suppress(subprocess.CalledProcessError):
                return bool(self.states())

        _wait(ready, f"Slurm's controller does not start, see {self.folder}")

    def wait_idle(self, count: int):
        """Waits until at least `count` nodes are idle."""
        self.wait_control()

        def ready() -> bool:
            return list(self.states().values()).count("idle") >= count

        _wait(ready, f"Slurm's nodes do not start, see {self.folder}")

    def queue(self) -> list[str]:
        """A line `name task state node` for each job that has not ended."""
        said = self.run("squeue", "--noheader", "--array", "--format=%j %K %T %N", "--states=all")
        ended = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL")
        return [line for line in said.splitlines() if line.split()[2] not in ended]

    def mend(self) -> int:
        """Repairs the cluster as an operator would; returns how many jobs it has released.

        Slurm holds a job if its node went away at the moment of the launch. A controller that was
        killed may launch a job that still runs, and then it drains the node of that job.
        """
        for node, state in self.states().items():
            if "drain" in state or "down" in state:
                with contextlib.suppress(subprocess.CalledProcessError):
                    self.run("scontrol", "update", f"nodename={node}", "state=resume")
        said = self.run("squeue", "--noheader", "--array", "--states=PD", "--format=%i|%r")
        held_jobs = [line.split("|")[0] for line in said.splitlines() if "held" in line.lower()]
        for job in held_jobs:
            self.run("scontrol", "release", job)
        return len(held_jobs)

    def wait_ended(self, limit_s: float = _LIMIT_S):
        """Waits until no job is left."""
        _wait(lambda: not self.queue(), lambda: f"jobs are left: {self.queue()}", limit_s)

    def close(self):
        """Ends everything."""
        if self.hosts is not None:
            self.hosts.close()
        for process in filter(None, [self._munge, *self._daemons.values()]):
            process.kill()
            process.wait()


def _program(name: str) -> str | None:
    # Debian installs daemons into folders that are not in a user's PATH.
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def _wait(ready, problem, limit_s: float = _LIMIT_S):
    last = time.monotonic() + limit_s
    while not ready():
        if time.monotonic() > last:
            raise TimeoutError(problem() if callable(problem) else problem)
        time.sleep(0.1)
