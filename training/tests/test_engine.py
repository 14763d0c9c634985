"""Every configuration trains on a made-up corpus folder, exports, and moves a mesh through the engine.

The engine is the binary of ANYFACE_BINARY, or target/debug/anyface; without one these tests are ignored.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from training import REPOSITORY
from training.export import export
from training.export import main as command_line
from training.speech import whisper
from training.systems.cafe_talk import train as train_cafe_talk
from training.systems.cafe_talk.denoiser import CONFIGS as CAFE_TALK
from training.systems.emoface import train as train_emoface
from training.systems.emoface.model import CONFIGS as EMOFACE
from training.systems.facetalk import train_motion as train_facetalk
from training.systems.freetalk import train as train_ats
from training.systems.freetalk.ats import CONFIGS
from training.systems.freetalk.stm import train as train_stm
from training.systems.freetalk.stm.paper import CONFIGS as PAPER
from training.tests.made_up import made_up
from training.tests.test_cafe_talk import little_space
from training.tests.test_speech import written

BINARY = Path(os.environ.get("ANYFACE_BINARY", REPOSITORY / "target/debug/anyface"))
CHECKPOINTS = {"hubert": "hubert_tiny", "wav2vec2": "wav2vec2_tiny", "stable": "wav2vec2_stable_tiny"}
HEARD = [*CHECKPOINTS, "whisper"]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not BINARY.exists(), reason=f"ignored: no engine at {BINARY}"),
]


@pytest.fixture(scope="module")
def faces(tmp_path_factory) -> Path:
    """Six clips of 2 s with vertex sequences; its neutral mesh is the one that is animated."""
    folder = made_up(tmp_path_factory.mktemp("corpus") / "made_up", 2.0, "vertices")
    (folder / "landmarks_of_mesh.json").write_text(json.dumps(list(range(68))))
    return folder


@pytest.fixture(scope="module")
def built_in(faces, tmp_path_factory) -> np.ndarray:
    """What the built-in weights give."""
    return animate(faces, tmp_path_factory.mktemp("built_in"))


def animate(faces: Path, out: Path, *more: str) -> np.ndarray:
    """Displacements [T, V, 3] of the engine's result for the sound of a held-out clip."""
    mesh, marks = faces / "topologies/ball/neutral.obj", faces / "landmarks_of_mesh.json"
    flags = ["--mesh", mesh, "--landmarks", marks, "--audio", faces / "audio/cem_0.wav"]
    flags += ["--out", out / "talk.npz", "--threads", "1", "--no-cache", *more]
    done = subprocess.run([BINARY, "animate", *map(str, flags)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return np.load(out / "talk.npz")["displacements"]


def write_checkpoint(name: str, folder: Path) -> None:
    """A Hugging Face folder of a tiny encoder with random weights."""
    if name in CHECKPOINTS:
        written(CHECKPOINTS[name], folder)
        return
    torch.manual_seed(0)
    folder.mkdir()
    whisper.write_hugging_face(whisper.WhisperEncoder(whisper.WhisperConfig(2, 32, 750, 4)), folder)


def moves(displacements: np.ndarray, built_in: np.ndarray) -> None:
    """Asserts that the mesh moves, otherwise than with the built-in weights."""
    assert displacements.shape == built_in.shape and np.isfinite(displacements).all()
    assert np.ptp(displacements, axis=0).max() > 1e-5
    assert np.abs(displacements - built_in).max() > 1e-5


@pytest.mark.parametrize("features", ["compact", *HEARD])
@pytest.mark.parametrize("name", list(CONFIGS))
def test_ats_of_every_size_and_encoder_moves_a_mesh(faces, built_in, tmp_path, name, features):
    out, models, flags, options = tmp_path / "run", tmp_path / "models", [], []
    if features != "compact":
        write_checkpoint(features, tmp_path / "checkpoint")
        flags = ["--hubert", str(tmp_path / "checkpoint")]
        options = ["--speech", str(tmp_path / "checkpoint")]
    elif name == "paper":
        flags = ["--speech", str(train_ats.SHIPPED_EAR)]
    flags += ["--corpus", str(faces), "--out", str(out), "--config", name, "--tokens", "96"]
    flags += ["--validation-clips", "0", "--steps", "6" if name == "paper" else "20"]
    trained = train_ats.train(train_ats.parser().parse_args(flags))
    export("ats", models, run=trained, steps=4)
    moves(animate(faces, tmp_path, "--weights", models, *options), built_in)


HEARS = [(name, "compact") for name in CAFE_TALK] + [("compact", features) for features in HEARD]


@pytest.mark.parametrize("name,features", [*HEARS, ("paper", "stable")])
def test_cafe_talk_of_every_size_and_encoder_moves_a_mesh(faces, built_in, tmp_path, name, features):
    flags, options = (
        ["--corpus", str(faces), "--config", name, "--text", str(little_space(tmp_path))],
        [],
    )
    flags += ["--tokens", "96", "--validation-clips", "0", "--steps", "4" if name == "paper" else "20"]
    if features != "compact":
        write_checkpoint(features, tmp_path / "checkpoint")
        flags += ["--hubert", str(tmp_path / "checkpoint")]
        options = ["--speech", str(tmp_path / "checkpoint")]
    run = lambda *more: train_cafe_talk.train(train_cafe_talk.parser().parse_args([*flags, *map(str, more)]))  # noqa: E731
    fine = run("--base", run("--out", tmp_path / "base"), "--out", tmp_path / "fine")
    export("cafe_talk", tmp_path / "models", run=fine)
    options += ["--weights", str(tmp_path / "models"), "--system", "cafe-talk"]
    moves(animate(faces, tmp_path, *options, "--event", "0.5-1.0:12,45L"), built_in)


@pytest.mark.parametrize(
    "name,features",
    [
        *((name, "compact") for name in EMOFACE),
        ("paper", "hubert"),
        ("paper", "wav2vec2"),
        ("debug", "tuned"),
    ],
)
def test_emoface_of_every_size_and_encoder_moves_a_mesh(faces, built_in, tmp_path, name, features):
    flags, options = ["--corpus", str(faces), "--config", name, "--out", str(tmp_path / "run")], []
    flags += ["--tokens", "96", "--validation-clips", "1", "--steps", "20", "--log-every", "20"]
    models = tmp_path / "models"
    if features == "tuned":
        flags, models = [*flags, "--tune-encoders"], tmp_path / "run/models"
    elif features != "compact":
        written(CHECKPOINTS[features], tmp_path / "checkpoint")
        flags += ["--hubert", str(tmp_path / "checkpoint")]
        options = ["--speech", str(tmp_path / "checkpoint")]
    if features == "wav2vec2":
        # The paper's two encoders; the second stands beside the model.
        models.mkdir()
        second = models / "emotion_hubert"
        written(CHECKPOINTS["hubert"], second)
        flags += ["--emotion-hubert", str(second)]
    trained = train_emoface.train(train_emoface.parser().parse_args(flags))
    export("emoface", models, run=trained)
    options += ["--weights", str(models), "--system", "emoface"]
    moves(animate(faces, tmp_path, *options), built_in)


def test_facetalk_moves_a_mesh_as_the_corpus_taught_it(faces, built_in, tmp_path):
    flags = ["--corpus", str(faces), "--config", "debug", "--out", str(tmp_path / "run"), "--steps", "6"]
    flags += ["--windows", "4", "--frames", "24", "--validation-clips", "0"]
    trained = train_facetalk.train(train_facetalk.parser().parse_args(flags))
    command_line(["facetalk", "--motion", str(trained), "--models", str(tmp_path / "models")])
    mine = animate(faces, tmp_path, "--weights", str(tmp_path / "models"), "--system", "facetalk")
    moves(mine, built_in)
    (tmp_path / "shipped").mkdir()
    assert np.abs(mine - animate(faces, tmp_path / "shipped", "--system", "facetalk")).max() > 1e-5
    kept = json.loads((tmp_path / "models/facetalk_compact/config.json").read_text())
    assert {"motion", "landmark_motion"} <= set(kept) and kept["motion"]["codes"] == kept["expression_code"]


DECODERS = [("static", "static"), ("static", "debug"), *(("paper", name) for name in PAPER)]


@pytest.mark.parametrize("model,config", DECODERS)
def test_a_decoder_of_every_size_moves_a_mesh(faces, built_in, tmp_path, model, config):
    flags = [model, "--corpus", str(faces), "--config", config, "--runs", str(tmp_path), "--steps", "20"]
    train_stm.main([*flags, "--shapes", "80"])
    models = tmp_path / "models"
    export("stm", models, runs=tmp_path, trained="corpus")
    moves(animate(faces, tmp_path, "--weights", models, "--decoder", model), built_in)
