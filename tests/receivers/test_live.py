"""Programs by other authors read what `anyface live` sends to its receivers.

`ANYFACE_COMMAND` names the command. Without it the tests run the one that `cargo build` makes.
"""

import json
import os
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pylivelinkface import FaceBlendShape, PyLiveLinkFace
from pythonosc.osc_bundle import OscBundle

from conftest import write_wav

ROOT = Path(__file__).resolve().parents[2]
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
RATE_HZ, SECONDS, FPS = 16000, 2.0, 25


@pytest.fixture(scope="module")
def voice(tmp_path_factory):
    """A WAV file of a buzz that swells four times a second."""
    time = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    buzz = sum(np.sin(2 * np.pi * 120 * k * time) / k for k in range(1, 20))
    samples = 0.15 * buzz * np.clip(np.sin(2 * np.pi * 4.0 * time), 0.0, None)
    path = tmp_path_factory.mktemp("voice") / "voice.wav"
    write_wav(path, (samples * 32767).astype("<i2").tobytes())
    return path


@pytest.fixture(scope="module")
def sent(voice):
    """Packets of VMC and Live Link, and the lines of JSON, of one performance."""
    with (
        socket.socket(type=socket.SOCK_DGRAM) as vmc,
        socket.socket(type=socket.SOCK_DGRAM) as link,
    ):
        for receiver in (vmc, link):
            receiver.bind(("127.0.0.1", 0))
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            receiver.settimeout(5.0)
        vmc_at, link_at = (f"127.0.0.1:{one.getsockname()[1]}" for one in (vmc, link))
        targets = ["--vmc", vmc_at, "--live-link", link_at, "--subject", "Änne", "--json"]
        live = subprocess.run(
            [COMMAND, "live", "--input", voice, "--any-sound", "--emotion", "happy:1", *targets],
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        assert live.returncode == 0, live.stderr
        lines = [json.loads(line) for line in live.stdout.splitlines()]
        assert len(lines) == SECONDS * FPS
        packets = {
            "vmc": [vmc.recv(65536) for _ in lines],
            "link": [link.recv(65536) for _ in lines],
        }
    return packets, lines


def messages(packet: bytes) -> list:
    """Addresses and values of a bundle, as python-osc reads it."""
    return [(message.address, message.params) for message in OscBundle(packet)]


def test_python_osc_reads_expressions_and_the_head(sent):
    packets, lines = sent
    for packet, line in zip(packets["vmc"], lines, strict=True):
        read = messages(packet)
        addresses = [address for address, _ in read]
        # Expressions take effect together, after the last of them.
        assert addresses.index("/VMC/Ext/Blend/Apply") > max(
            place for place, address in enumerate(addresses) if address == "/VMC/Ext/Blend/Val"
        )
        weights = {
            values[0]: values[1] for address, values in read if address == "/VMC/Ext/Blend/Val"
        }
        assert weights["JawOpen"] == pytest.approx(line["shapes"]["jawOpen"], abs=1e-6)
        assert weights["happy"] == weights["Joy"] == pytest.approx(1.0)
        assert all(0.0 <= weight <= 1.0 for weight in weights.values())
        (bone,) = [values for address, values in read if address == "/VMC/Ext/Bone/Pos"]
        name, *place, x, y, z, w = bone
        assert (name, place) == ("Head", [0.0, 0.0, 0.0])
        assert x * x + y * y + z * z + w * w == pytest.approx(1.0, abs=1e-5)
    jaws = [line["shapes"]["jawOpen"] for line in lines]
    assert max(jaws) > 0.1


def test_pylivelinkface_reads_the_same_weights(sent):
    packets, lines = sent
    for number, (packet, line) in enumerate(zip(packets["link"], lines, strict=True)):
        is_packet, face = PyLiveLinkFace.decode(packet)
        assert is_packet and face.name == "Änne" and face._frames == number
        assert (face.fps, face._denominator) == (FPS, 1)
        for shape in list(FaceBlendShape)[:52]:
            name = shape.name[0].lower() + shape.name[1:]
            assert face.get_blendshape(shape) == pytest.approx(line["shapes"][name], abs=1e-6), name
