"""Hosts of a farm on one machine: each has its own network, name, mounts and process numbers.

A host is a process in namespaces of its own. A bridge joins all hosts, and nothing else is
connected to it. When a host ends, everything that runs on it ends too, as if its plug were pulled.
"""

import contextlib
import os
import shutil
import subprocess
from pathlib import Path

_NETWORK = "10.77.0"
_UNSHARE = ("unshare", "--net", "--uts", "--mount", "--pid", "--fork", "--kill-child")
# The host runs until the process that started it closes this input, or dies.
_BOOT = 'hostname "$1"; mount --bind "$2" /etc/hosts; ip link set lo up; echo up; read end'


def missing() -> str:
    """Why this machine cannot make hosts; empty if it can."""
    if os.name != "posix" or not hasattr(os, "geteuid") or os.geteuid() != 0:
        return "hosts in network namespaces need root on Linux"
    for program in ("ip", "unshare", "nsenter"):
        if shutil.which(program) is None:
            return f"hosts in network namespaces need the program {program}"
    trial = ["unshare", "--net", "ip", "link", "add", "anyface0", "type", "bridge"]
    done = subprocess.run(trial, capture_output=True, text=True, check=False)
    if done.returncode:
        return f"no network namespaces here: {done.stderr.strip()}"
    return ""


class Host:
    """One host. The others reach it at `address`, and it calls itself `name`."""

    def __init__(self, name: str, number: int, names_file: Path):
        self.name, self.address = name, f"{_NETWORK}.{number}"
        self._names_file = names_file
        self._outer = None

    def boot(self, switch: int):
        """Starts the host and plugs it into the bridge of process `switch`."""
        words = [*_UNSHARE, "--mount-proc", "sh", "-c", _BOOT, "sh", self.name, self._names_file]
        self._outer = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        if self._outer.stdout.readline() != "up\n":
            raise OSError(f"host {self.name} did not start")
        children = Path(f"/proc/{self._outer.pid}/task/{self._outer.pid}/children").read_text()
        self._inner = int(children.split()[0])
        plug = f"to-{self.name}"
        _ip(switch, "link", "add", plug, "type", "veth", "peer", "eth0", "netns", str(self._inner))
        _ip(switch, "link", "set", plug, "master", "bridge", "up")
        _ip(self._inner, "address", "add", f"{self.address}/24", "dev", "eth0")
        _ip(self._inner, "link", "set", "eth0", "up")

    def start(self, *words, **more) -> subprocess.Popen:
        """Starts a program on the host; `more` goes to `subprocess.Popen`."""
        enter = ["nsenter", "--target", str(self._inner), "--net", "--uts", "--mount", "--pid"]
        return subprocess.Popen([*enter, "--", *map(str, words)], **more)

    def run(self, *words, timeout=60, **more) -> str:
        """Runs a program and returns its output; raises `CalledProcessError` if it fails."""
        process = self.start(
            *words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more
        )
        try:
            said, _ = process.communicate(timeout=timeout)
        finally:
            process.kill()
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, words, said)
        return said

    def end(self):
        """Pulls the plug: everything on the host ends at once."""
        if self._outer is not None:
            self._outer.kill()
            self._outer.wait()
            self._outer.stdin.close()
            self._outer.stdout.close()
            self._outer = None

    @property
    def is_up(self) -> bool:
        """Whether the host runs."""
        return self._outer is not None


class Hosts:
    """Several hosts and the bridge between them; `hosts["node1"]` is one of them."""

    def __init__(self, folder: Path, names: list[str]):
        names_file = folder / "hosts"
        self._hosts = {
            name: Host(name, number, names_file) for number, name in enumerate(names, start=1)
        }
        lines = [f"{host.address} {host.name}" for host in self._hosts.values()]
        names_file.write_text("\n".join(["127.0.0.1 localhost", *lines, ""]))
        self._bridge = subprocess.Popen(
            ["unshare", "--net", "sh", "-c", "echo up; read end"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._bridge.stdout.readline()
        try:
            _ip(self._bridge.pid, "link", "add", "bridge", "type", "bridge")
            _ip(self._bridge.pid, "link", "set", "bridge", "up")
            for name in names:
                self.boot(name)
        except BaseException:
            self.close()
            raise

    def __getitem__(self, name: str) -> Host:
        return self._hosts[name]

    def __iter__(self):
        return iter(self._hosts.values())

    def boot(self, name: str):
        """Starts a host that has ended."""
        with contextlib.suppress(OSError):
            # Linux removes the cable of an ended host by itself, but maybe only later.
            _ip(self._bridge.pid, "link", "delete", f"to-{name}")
        self._hosts[name].boot(self._bridge.pid)

    def cut(self, name: str):
        """Takes a host off the network; its programs go on."""
        _ip(self._bridge.pid, "link", "set", f"to-{name}", "down")

    def join(self, name: str):
        """Puts a host that was cut off back on the network."""
        _ip(self._bridge.pid, "link", "set", f"to-{name}", "up")

    def close(self):
        """Ends all hosts, and the bridge."""
        for host in self:
            host.end()
        self._bridge.kill()
        self._bridge.wait()
        self._bridge.stdin.close()
        self._bridge.stdout.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _ip(process: int, *words: str):
    """Runs `ip` in the network of a process."""
    enter = ["nsenter", "--target", str(process), "--net", "ip", *words]
    done = subprocess.run(enter, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"ip {' '.join(words)}: {done.stderr.strip()}")
