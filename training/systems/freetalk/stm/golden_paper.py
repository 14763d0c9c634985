"""Golden of the `paper` decoder: debug size, random weights, the procedural mesh of the parity set."""

from pathlib import Path

import torch
from safetensors.torch import load_file

from training.goldens import write_golden
from training.nn.diffusion_net import SurfaceOperators
from training.systems.freetalk.stm.paper import CONFIGS, PaperDecoder

SOURCE = "parity/diffusion_net_random.safetensors"


def operators_of(parity: dict[str, torch.Tensor]) -> SurfaceOperators:
    """Converts the surface operators of a parity file to the network's format."""
    size = (parity["mass"].shape[0],) * 2

    def sparse(name: str) -> torch.Tensor:
        indices, values = parity[f"{name}.indices"].long(), parity[f"{name}.values"]
        return torch.sparse_coo_tensor(indices, values, size).coalesce().to_sparse_csr()

    return SurfaceOperators(
        parity["mass"], parity["evals"], parity["evecs"], sparse("gradX"), sparse("gradY")
    )


def write(out: Path, shared: Path) -> Path:
    """Writes `stm_paper_debug.safetensors`: `weights.*`, operators, `vertex_inputs` [V, 6],
    `landmarks` [T, 68, 3] dm, `features` [V, latent] and `output` [T, V, 3] dm."""
    torch.manual_seed(7)
    parity = load_file(shared / SOURCE)
    ops = operators_of(parity)
    model = PaperDecoder(CONFIGS["debug"]).eval()
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            if name.endswith("diffusion_time"):
                parameter.uniform_(0.0, 0.1)
        normals = torch.nn.functional.normalize(parity["vertices"], dim=-1)
        vertex_inputs = torch.cat([parity["vertices"], normals], dim=-1)
        landmarks = 0.3 * torch.randn(3, 68, 3)
        features = model.encode(vertex_inputs, ops)
        output = model.decode(features, landmarks, ops)
    operator_names = [k for k in parity if k.startswith("grad") or k in ("mass", "evals", "evecs")]
    tensors = {k: parity[k] for k in operator_names}
    tensors |= {"vertex_inputs": vertex_inputs, "landmarks": landmarks}
    tensors |= {"features": features, "output": output}
    about = {"source": f"random weights, seed 7, mesh of {SOURCE}", "tolerance": "1e-4 absolute"}
    path = out / "stm_paper_debug.safetensors"
    return write_golden(path, tensors, "stm_paper", model, CONFIGS["debug"].to_json(), **about)
