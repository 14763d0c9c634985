"""FreeTalk's own Sparse-To-Mesh decoder (Nocentini et al. 2026, section 3.2).

Mirrors `rust-core/src/systems/freetalk/stm/paper.rs`; attributes here have the names of its layers.

A DiffusionNet reads the neutral mesh once; per frame a graph network reads the 68 landmark
displacements, every vertex attends to the landmarks, and a second DiffusionNet turns vertex
feature, global displacement vector and attended feature into a displacement.

The paper leaves some choices open. This file chooses:
- landmark graph: iBUG chains plus bridges (`landmark_edges`);
- index encoding: the sinusoidal one of Vaswani et al. 2017 (`index_encoding`);
- `phi` (eq. 12) is one linear layer; the attention has no output projection (eq. 14 has none);
- units: positions and displacements come in decimetres, so that both are of order one.

Shapes: `T` frames, `V` vertices, `N` = 68 landmarks.
"""

import itertools
import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from training.nn.config import Config
from training.nn.diffusion_net import DiffusionNet, SurfaceOperators

LANDMARKS = 68
INPUTS = 6
"""Number of input channels of a vertex: position and normal."""

CHAINS = [
    (range(17), False),
    (range(17, 22), False),
    (range(22, 27), False),
    (range(27, 31), False),
    (range(31, 36), False),
    (range(36, 42), True),
    (range(42, 48), True),
    (range(48, 60), True),
    (range(60, 68), True),
]
"""The nine iBUG curves, and whether each is closed."""

BRIDGES = [
    (0, 17), (16, 26), (17, 36), (26, 45), (21, 22), (21, 27), (22, 27), (21, 39), (22, 42),
    (27, 39), (27, 42), (30, 33), (31, 48), (33, 51), (35, 54), (48, 60), (54, 64), (51, 62),
    (57, 66), (62, 66), (8, 57), (4, 48), (12, 54), (31, 39), (35, 42), (2, 31), (14, 35),
]  # fmt: skip
"""Edges between curves. They connect the graph, so that a motion reaches the neighbouring curves."""


@dataclass(frozen=True)
class PaperConfig(Config):
    """Sizes of the decoder; saved beside the weights as config.json."""

    width: int = 128
    latent: int = 128
    encoder_blocks: int = 4
    decoder_blocks: int = 4
    graph_layers: int = 3
    heads: int = 4
    index_encoding: int = 16
    eigenpairs: int = 128


CONFIGS = {
    "paper": PaperConfig(),
    "compact": PaperConfig(64, 64, 3, 3, 3, 4, 64, 64),
    "debug": PaperConfig(8, 8, 1, 1, 3, 2, 4, 48),
}


def landmark_edges() -> list[tuple[int, int]]:
    """Edges of the landmark graph, each once."""
    edges = []
    for chain, closed in CHAINS:
        nodes = list(chain)
        edges += list(itertools.pairwise(nodes))
        if closed:
            edges.append((nodes[-1], nodes[0]))
    return edges + BRIDGES


def normalised_adjacency() -> Tensor:
    """`D^-1/2 (A + I) D^-1/2` of the landmark graph, Kipf & Welling 2017. [N, N]."""
    adjacency = torch.eye(LANDMARKS)
    for a, b in landmark_edges():
        adjacency[a, b] = adjacency[b, a] = 1.0
    scale = adjacency.sum(1).rsqrt()
    return scale[:, None] * adjacency * scale[None, :]


def index_encoding(size: int) -> Tensor:
    """Sine and cosine of `j / 10000^(2i/size)`, interleaved. [N, size], size even."""
    frequency = torch.exp(torch.arange(0, size, 2) * (-math.log(10000.0) / size))
    angle = torch.arange(LANDMARKS)[:, None] * frequency
    return torch.stack([angle.sin(), angle.cos()], dim=-1).reshape(LANDMARKS, size)


class LandmarkGraphNet(nn.Module):
    """Graph convolutions over the landmark graph: `relu(Â X W + b)`, the last without relu."""

    def __init__(self, inputs: int, width: int, layers: int):
        super().__init__()
        self.layers = layers
        for i in range(layers):
            self.add_module(f"layer_{i}", nn.Linear(inputs if i == 0 else width, width))
        self.register_buffer("adjacency", normalised_adjacency(), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """x: [T, N, inputs]. Returns [T, N, width]."""
        for i in range(self.layers):
            x = self.get_submodule(f"layer_{i}")(self.adjacency @ x)
            x = torch.relu(x) if i + 1 < self.layers else x
        return x


class LandmarkToVertexAttention(nn.Module):
    """Every vertex attends to the landmarks; eqs. 13 and 14 with several heads."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key = nn.Linear(width, width)
        self.value = nn.Linear(width, width)

    def forward(self, vertices: Tensor, landmarks: Tensor) -> Tensor:
        """vertices: [V, C]; landmarks: [T, N, C]. Returns [T, V, C]."""
        frames, width = landmarks.shape[0], landmarks.shape[2]
        value = self._of_heads(self.value(landmarks))
        return (self.shares(vertices, landmarks) @ value).transpose(1, 2).reshape(frames, -1, width)

    def shares(self, vertices: Tensor, landmarks: Tensor) -> Tensor:
        """Attention of each vertex to the landmarks, eq. 13. Returns [T, heads, V, N]."""
        query = self.query(vertices).unflatten(-1, (self.heads, -1)).transpose(0, 1)
        key = self._of_heads(self.key(landmarks))
        return torch.softmax(query @ key.transpose(-1, -2) / math.sqrt(query.shape[-1]), dim=-1)

    def _of_heads(self, nodes: Tensor) -> Tensor:
        return nodes.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class PaperDecoder(nn.Module):
    """The whole decoder; see the top of the file."""

    def __init__(self, config: PaperConfig):
        super().__init__()
        self.config = config
        c = config
        self.mesh_encoder = DiffusionNet(INPUTS, c.latent, c.width, c.encoder_blocks)
        self.landmark_encoder = LandmarkGraphNet(3, c.latent, c.graph_layers)
        self.landmark_projection = nn.Linear(c.latent + c.index_encoding, c.latent)
        self.attention = LandmarkToVertexAttention(c.latent, c.heads)
        fused = 2 * c.latent + 3 * LANDMARKS
        self.decoder = DiffusionNet(fused, 3, c.width, c.decoder_blocks)
        self.register_buffer("index", index_encoding(c.index_encoding), persistent=False)

    def encode(self, vertex_inputs: Tensor, ops: SurfaceOperators) -> Tensor:
        """Features of the neutral mesh. vertex_inputs: [V, inputs]. Returns [V, latent]."""
        return self.mesh_encoder(vertex_inputs[None], ops)[0]

    def nodes(self, landmarks: Tensor) -> Tensor:
        """Features of the landmarks; eq. 12. landmarks: [T, N, 3] dm. Returns [T, N, latent]."""
        index = self.index.expand(len(landmarks), -1, -1)
        return self.landmark_projection(torch.cat([self.landmark_encoder(landmarks), index], dim=-1))

    def decode(self, features: Tensor, landmarks: Tensor, ops: SurfaceOperators) -> Tensor:
        """Displacement of each vertex, decimetres.

        features: [V, latent]; landmarks: [T, N, 3], displacements in decimetres. Returns [T, V, 3].
        """
        frames, vertices = landmarks.shape[0], features.shape[0]
        attended = self.attention(features, self.nodes(landmarks))
        motion = landmarks.reshape(frames, 1, -1).expand(-1, vertices, -1)
        fused = torch.cat([features.expand(frames, -1, -1), motion, attended], dim=-1)
        return self.decoder(fused, ops)

    def forward(self, vertex_inputs: Tensor, landmarks: Tensor, ops: SurfaceOperators) -> Tensor:
        """vertex_inputs: [V, inputs]; landmarks: [T, N, 3] dm. Returns [T, V, 3] dm."""
        return self.decode(self.encode(vertex_inputs, ops), landmarks, ops)
