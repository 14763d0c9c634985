"""Trains FreeTalk with one part left out at a time, for equally many steps, and measures each variant.

    python -m training.paper.ablations --corpus DIR [DIR ...] --vertices DIR [DIR ...] --out runs/ablations

Writes `scores.json` for `python -m training.paper --ablations`. Variants of ATS: without the time embedding,
without the band mask, and with every intensity at 1. Variants of STM (the paper's table 5): without the
landmark graph, without cross-attention, without the geometry of the mesh. They run in PyTorch, because the
engine plays only whole models.
"""

import argparse
import itertools
import json
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.corpus import ear
from training.corpus.bank import few
from training.corpus.sequence_meshes import SequenceMesh, sequence_meshes
from training.machine import Machine, add_arguments
from training.paper.tables import LIPS, LONGEST_FRAMES, UPPER, Table, means, scores_of
from training.speech.ear import SHIPPED_EAR, EarConfig, load_ear
from training.speech.source import EarSpeech
from training.systems.freetalk import train as train_ats
from training.systems.freetalk.ats import ANY_STYLE, AtsConfig, AtsDenoiser
from training.systems.freetalk.stm.paper import PaperConfig, PaperDecoder
from training.systems.freetalk.stm.train_paper import paper_mesh, predict, train_paper

STM_CONFIG = PaperConfig(32, 32, 2, 2, 3, 4, 16, 48)
"""Small enough to train many variants on a desktop computer.

The inputs of a vertex are its position and normal, as in the paper.
"""
ONE_FRAME_IN = 5


class WithoutTime(AtsDenoiser):
    """A denoiser that does not know how noisy its input is."""

    def _conditions(self, timestep: Tensor, affect: Tensor, style: Tensor) -> Tensor:
        return super()._conditions(torch.zeros_like(timestep), affect, style)


class WithoutBand(AtsDenoiser):
    """Every frame may attend to all of the speech."""

    def __init__(self, config: AtsConfig, dropout: float = 0.0):
        super().__init__(replace(config, radius=config.window_frames), dropout)


class WithoutIntensity(AtsDenoiser):
    """Gives every emotion above intensity 0 the intensity 1."""

    def _conditions(self, timestep: Tensor, affect: Tensor, style: Tensor) -> Tensor:
        whole = torch.cat([affect[..., :-1], (affect[..., -1:] > 0).to(affect.dtype)], dim=-1)
        return super()._conditions(timestep, whole, style)


class WithoutGraph(PaperDecoder):
    """A decoder whose landmarks do not exchange features: the graph has no edge."""

    def __init__(self, config: PaperConfig):
        super().__init__(config)
        self.landmark_encoder.adjacency.copy_(torch.eye(len(self.landmark_encoder.adjacency)))


class WithoutAttention(PaperDecoder):
    """Vertices get the landmarks' displacements unweighted, joined to their own feature."""

    def __init__(self, config: PaperConfig):
        super().__init__(config)
        self.attention.forward = lambda vertices, landmarks: vertices.new_zeros(
            len(landmarks), *vertices.shape
        )


class WithoutGeometry(PaperDecoder):
    """A decoder without vertex positions and normals; only the surface's operators describe the mesh."""

    def encode(self, vertex_inputs: Tensor, ops) -> Tensor:
        return super().encode(torch.ones_like(vertex_inputs), ops)


ATS = {
    "ATS, whole": AtsDenoiser,
    "without the time embedding": WithoutTime,
    "without the band mask": WithoutBand,
    "with every intensity at 1": WithoutIntensity,
}
STM = {
    "STM, whole": PaperDecoder,
    "without the landmark graph": WithoutGraph,
    "without cross-attention": WithoutAttention,
    "without geometry": WithoutGeometry,
}


def ats_table(arguments) -> Table:
    """Sound to landmarks. Every variant trains for equally many steps from the same seed."""
    heard = EarSpeech(load_ear(SHIPPED_EAR), ear.of_folders(arguments, EarConfig().taps))
    entries = heard.entries
    has_intensity = any(e.intensity > 0 for e in entries)
    variants = {name: kind for name, kind in ATS.items() if has_intensity or kind is not WithoutIntensity}
    rows, clips = {}, 0
    for name, kind in variants.items():
        print(name, flush=True)
        out = arguments.out / kind.__name__
        line = ["--corpus", *map(str, arguments.corpus), "--out", str(out), "--steps", str(arguments.steps),
                "--tokens", str(arguments.tokens), "--seed", str(arguments.seed),
                "--validation-clips", "0", "--log-every", str(arguments.steps)]  # fmt: skip
        line += ["--limit", str(arguments.limit)] if arguments.limit else []
        line += ["--device", arguments.device]
        saved = torch.load(train_ats.train(train_ats.parser().parse_args(line), kind))
        model = kind(AtsConfig.from_json(saved["config"]))
        model.load_state_dict(saved["state"])
        scores = ats_scores(model.eval(), heard, few([e for e in entries if e.held_out], arguments.clips))
        rows[name], clips = scores, len(scores)
    what = f"sound to landmarks, {arguments.steps} steps of {arguments.tokens} frames"
    return Table("Ablations", what, means(rows), clips, 68)


def ats_scores(model: AtsDenoiser, speech: EarSpeech, entries) -> list[dict[str, float]]:
    """Metrics of held-out clips in the default style, by the model's own sampling."""
    style, scores = model.config.styles.index(ANY_STYLE), []
    for entry in entries:
        motion = train_ats.clip_motion(speech, model, entry, style, model.config.sampling)
        visible = entry.weight.unflatten(1, (68, 3)).any(dim=2).any(dim=0).numpy()
        pair = [x[:LONGEST_FRAMES].float().unflatten(1, (68, 3)).numpy() for x in (motion, entry.motion)]
        scores.append(scores_of(*pair, LIPS[visible[LIPS]], UPPER[visible[UPPER]]))
    return scores


def stm_table(arguments) -> Table:
    """True landmark motion to the mesh. Every variant trains for equally many steps from the same seeds."""
    known = sequence_meshes(arguments.vertices, held_out=False)
    training_meshes = {"corpus": [paper_mesh(mesh, STM_CONFIG) for mesh in known]}
    test_meshes = sequence_meshes(arguments.vertices, held_out=True)
    prepared = {mesh.name: paper_mesh(mesh, STM_CONFIG) for mesh in test_meshes}
    rows: dict[str, list[dict[str, float]]] = {}
    seeds = range(arguments.seed, arguments.seed + arguments.stm_seeds)
    for (name, kind), seed in itertools.product(STM.items(), seeds):
        row = f"{name}, seed {seed}" if len(seeds) > 1 else name
        print(row, flush=True)
        steps, out = arguments.stm_steps, arguments.out / f"{kind.__name__}_{seed}"
        machine = Machine(arguments.device, arguments.precision)
        model = train_paper(
            STM_CONFIG, None, steps, seed, training_meshes, out, machine=machine, decoder=kind
        )
        rows[row] = [stm_scores(mesh, partial(predict, model, prepared[mesh.name])) for mesh in test_meshes]
    what = f"true landmarks to mesh, {arguments.stm_steps} steps of width {STM_CONFIG.width}"
    return Table("Ablations", what, means(rows), len(test_meshes), len(test_meshes[0].lips))


@torch.no_grad()
def stm_scores(mesh: SequenceMesh, method: Callable[[Tensor], Tensor]) -> dict[str, float]:
    """Metrics over every fifth frame of the mesh's sequences, mm."""
    truth = torch.cat([mesh.displacements(i, np.arange(0, len(s), ONE_FRAME_IN))
                       for i, s in enumerate(mesh.sequences)])[:LONGEST_FRAMES]  # fmt: skip
    predicted = torch.cat([method(part) for part in truth[:, mesh.landmarks].split(5)])
    lips = mesh.lips.nonzero()[:, 0].numpy()
    return scores_of(0.1 * predicted.numpy(), 0.1 * truth.numpy(), lips, mesh.landmarks[UPPER].numpy())


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--corpus", type=Path, nargs="*", default=[], help="folders for ATS")
    parser.add_argument("--vertices", type=Path, nargs="*", default=[], help="folders with vertices for STM")
    parser.add_argument("--out", type=Path, default=Path("runs/ablations"))
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--tokens", type=int, default=1024, help="frames in a batch")
    parser.add_argument("--stm-steps", type=int, default=600)
    parser.add_argument("--stm-seeds", type=int, default=1, help="trainings of each, from --seed on")
    parser.add_argument("--limit", type=int, help="training clips of each folder")
    parser.add_argument("--clips", type=int, default=20, help="held-out clips that are measured")
    parser.add_argument("--seed", type=int, default=0)
    add_arguments(parser, "float32")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    arguments.out.mkdir(parents=True, exist_ok=True)
    tables = []
    for folders, make in ((arguments.vertices, stm_table), (arguments.corpus, ats_table)):
        if folders:
            tables.append(asdict(make(arguments)))
            (arguments.out / "scores.json").write_text(json.dumps(tables, indent=1) + "\n")


if __name__ == "__main__":
    main()
