"""Layers and samplers against reference numbers in ../shared/parity."""

import os
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from training.diffusion.ddim import ddim_sample
from training.diffusion.schedule import alphas_cumprod, inference_timesteps
from training.nn.attention import band_mask
from training.nn.transformer import TransformerDecoderLayer

SHARED = Path(os.environ.get("ANYFACE_SHARED", Path(__file__).resolve().parents[3] / "shared"))
needs_shared = pytest.mark.skipif(not SHARED.exists(), reason="needs ../shared")


def read(name: str):
    """Tensors and metadata of a parity file."""
    with safe_open(SHARED / "parity" / f"{name}.safetensors", "pt") as file:
        return {key: file.get_tensor(key) for key in list(file.keys())}, file.metadata()


@needs_shared
@pytest.mark.parametrize("ours,theirs", [("linear", "linear"), ("cosine", "squaredcos_cap_v2")])
@pytest.mark.parametrize("spacing", ["leading", "trailing"])
@pytest.mark.parametrize("steps", [10, 100])
def test_ddim_matches_diffusers(ours, theirs, spacing, steps):
    reference, _ = read("ddim")
    alphas = alphas_cumprod(ours, 1000)
    torch.testing.assert_close(alphas, reference[f"{theirs}.alphas_cumprod"], atol=1e-6, rtol=1e-5)
    key = f"{theirs}.{spacing}.{steps}"
    assert inference_timesteps(1000, steps, spacing) == reference[f"{key}.timesteps"].tolist()
    c = reference[f"{key}.c"]
    x0 = ddim_sample(lambda x, t: torch.tanh(0.3 * x + c), reference[f"{key}.x_T"], alphas, steps, spacing)
    torch.testing.assert_close(x0, reference[f"{key}.x_0"], atol=1e-5, rtol=0)


@needs_shared
@pytest.mark.parametrize("norm", ["pre", "post"])
def test_decoder_layer_matches_torch(norm):
    tensors, metadata = read(f"decoder_layer_{norm}norm")
    weights = {k.removeprefix("weights."): v for k, v in tensors.items() if "weights." in k}
    width, feedforward = weights["linear2.weight"].shape
    layer = TransformerDecoderLayer(width, int(metadata["heads"]), feedforward, norm)
    layer.load_state_dict(weights)
    frames = tensors["x"].shape[1]
    band = band_mask(frames, frames, int(metadata["radius"]))
    y = layer(tensors["x"], tensors["memory"], None, band)
    torch.testing.assert_close(y, tensors["y"], atol=1e-5, rtol=0)


def test_unknown_spacing_is_refused():
    with pytest.raises(ValueError, match="leading or trailing"):
        inference_timesteps(1000, 10, "sideways")
