"""Facts about Whisper's encoder, on a folder of random weights; on the real ones where they are at hand."""

import os
from pathlib import Path

import numpy as np
import pytest
import torch

from training.corpus.clip import read_sound
from training.speech import whisper
from training.speech.hubert import HubertFeatures
from training.speech.log_mel import power_spectrum
from training.tests.test_parity import SHARED, needs_shared

REAL = Path(os.environ.get("ANYFACE_WHISPER", "runs/whisper-base"))


def write_tensors(path: Path, tensors: dict[str, np.ndarray]) -> None:
    """The inverse of `whisper.read_tensors`."""
    kinds = {np.dtype(kind): number for number, kind in whisper.DTYPES.items()}

    def text(value: str) -> bytes:
        return np.uint16(len(value) + 1).tobytes() + value.encode() + b"\0"

    out = [np.uint32(6).tobytes(), text("WhisperSpec"), np.uint32(3).tobytes()]
    out.append(np.uint32(len(tensors)).tobytes())
    for name, value in tensors.items():
        out += [text(name), np.uint8(value.ndim).tobytes(), np.array(value.shape, "<u4").tobytes()]
        out += [np.uint8(kinds[value.dtype]).tobytes(), np.uint32(value.nbytes).tobytes(), value.tobytes()]
    path.write_bytes(b"".join([*out, np.uint32(0).tobytes()]))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two layers of width 128 with random weights, as CTranslate2 writes them."""
    encoder = whisper.WhisperEncoder(whisper.WhisperConfig(layers=2, width=128, places=1500, heads=2))
    random, state, tensors = np.random.default_rng(0), encoder.state_dict(), {}
    for ours, theirs in whisper.names(2).items():
        tensors[theirs] = (random.standard_normal(state[ours].shape) * 0.1).astype(np.float16)
    write_tensors(tmp_path / "model.bin", tensors)
    return tmp_path


def noise(seconds: float) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(1).standard_normal(int(16000 * seconds)) * 0.1).float()


def test_tensors_come_back_from_a_file(folder):
    tensors = whisper.read_tensors(folder / "model.bin")
    write_tensors(folder / "again.bin", tensors)
    assert (folder / "again.bin").read_bytes() == (folder / "model.bin").read_bytes()
    assert tensors["encoder/layer_1/self_attention/linear_0/weight"].shape == (384, 128)


def test_attention_is_its_definition(folder):
    layer, x = whisper.load(folder).layers[0], torch.randn(1, 7, 128)
    q, k, v = layer.query_key_value(layer.attention_norm(x))[0].unflatten(-1, (3, 2, 64)).permute(1, 2, 0, 3)
    mixed = torch.cat([(q[h] @ k[h].T / 8.0).softmax(-1) @ v[h] for h in range(2)], dim=-1)
    y = x + layer.mix(mixed)
    slow = y + layer.narrow(torch.nn.functional.gelu(layer.wide(layer.feed_norm(y))))
    torch.testing.assert_close(layer(x), slow, atol=1e-4, rtol=1e-4)


def test_spans_agree_with_the_whole_inside_and_in_length(folder):
    model, mel = whisper.load(folder), whisper.whisper_mel(noise(14.0))
    whole, parts = model(mel[None], [1])[0][0], model.hear(mel, [1])[0]
    assert parts.shape == whole.shape
    # The first span begins as the whole does; all that differs is how far attention reaches.
    close = torch.nn.functional.cosine_similarity(whole[:500], parts[:500], dim=1)
    assert close.min() > 0.98


def test_a_layer_does_not_depend_on_those_above(folder):
    model, mel = whisper.load(folder), whisper.whisper_mel(noise(1.0))
    first, last = model.hear(mel, [1, 2])
    torch.testing.assert_close(model.hear(mel, [1])[0], first)
    assert first.shape == last.shape == (50, 128)


def test_a_folder_of_hugging_face_holds_the_same_encoder(folder, tmp_path):
    model = whisper.load(folder)
    with torch.no_grad():
        for layer in model.layers:
            layer.query_key_value.bias[128:256] = 0.0
    other = tmp_path / "other"
    other.mkdir()
    whisper.write_hugging_face(model, other)
    mel = whisper.whisper_mel(noise(1.0))[None]
    torch.testing.assert_close(whisper.load(other)(mel, [2])[0], model(mel, [2])[0], atol=5e-3, rtol=0)


def test_the_encoder_is_that_of_transformers():
    transformers = pytest.importorskip("transformers")
    config = transformers.WhisperConfig(
        d_model=32, encoder_layers=2, encoder_attention_heads=4, encoder_ffn_dim=128, decoder_layers=1,
        decoder_attention_heads=4, decoder_ffn_dim=32, max_source_positions=100, vocab_size=60,
        pad_token_id=0, bos_token_id=1, eos_token_id=2, decoder_start_token_id=3,
    )  # fmt: skip
    torch.manual_seed(0)
    theirs = transformers.WhisperModel(config).eval()
    ours = whisper.from_hugging_face(whisper.WhisperConfig(2, 32, 100, 4), theirs.state_dict())
    mel = whisper.whisper_mel(noise(2.0))
    with torch.no_grad():
        expected = theirs.encoder(mel.T[None], output_hidden_states=True)
    layers = ours(mel[None], [0, 1, 2])
    for state, known in zip(layers[:2], expected.hidden_states[:2], strict=True):
        torch.testing.assert_close(state, known, atol=1e-5, rtol=0)
    torch.testing.assert_close(layers[2], expected.last_hidden_state, atol=1e-5, rtol=0)


def test_the_spectrogram_is_that_of_transformers():
    transformers = pytest.importorskip("transformers")
    samples = noise(2.0)
    extractor = transformers.WhisperFeatureExtractor(feature_size=80, chunk_length=2)
    expected = extractor(samples.numpy(), sampling_rate=16000, return_tensors="pt").input_features[0].T
    torch.testing.assert_close(whisper.whisper_mel(samples), expected, atol=1e-4, rtol=0)


def test_trainers_hear_a_folder_as_they_hear_hubert(folder, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    whisper.write_hugging_face(whisper.load(folder), other)
    features = HubertFeatures(other, transformer_fps=25.0)
    assert (features.kind, features.channels, features.transformer_fps) == ("whisper", 128, None)
    samples = noise(1.0)
    heard = features(samples, 25)
    (expected,) = whisper.load(other).hear(whisper.whisper_mel(samples), [2])
    torch.testing.assert_close(heard, expected[::2])


def test_mel_of_a_power_spectrum_is_that_of_the_sound():
    samples = noise(2.0)
    exact = whisper.decades(samples)
    near = whisper.decades_of_power(power_spectrum(samples))[: len(exact)]
    # A band of low frequency is as wide as one bin, so single frames differ.
    assert (near - exact)[2:-2].mean(dim=0).abs().max() < 0.24


def test_a_folder_without_weights_says_how_to_get_them(tmp_path):
    with pytest.raises(ValueError, match="fetch"):
        whisper.load(tmp_path)


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL}: expected Whisper base (ANYFACE_WHISPER), got nothing")
@needs_shared
def test_the_real_encoder_gives_the_numbers_of_ctranslate2():
    mel = whisper.whisper_mel(torch.from_numpy(read_sound(SHARED / "data/clips/jfk.wav")))[:1100]
    last = whisper.load(REAL)(mel[None], [6])[0][0]
    expected = torch.tensor(CTRANSLATE2)
    torch.testing.assert_close(last[::137, :4], expected, atol=2e-3, rtol=0)


CTRANSLATE2 = [
    [-1.8456, 0.1496, -1.3777, -0.7869],
    [-1.3885, -0.5401, 0.4337, 0.2675],
    [0.8157, -0.1380, 0.0765, 0.2754],
    [-0.1228, -0.2779, 0.1954, 0.9242],
    [-0.2246, 0.5254, 1.1761, -0.1614],
]
"""Features 0, 137, 274 … of jfk.wav, first four channels, as ctranslate2 4.8.5 computes them in float32."""
