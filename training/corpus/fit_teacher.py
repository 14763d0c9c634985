"""Fits the co-articulation teacher to recorded motion.

    python -m training.corpus.fit_teacher --data ../shared/data

Fits on the training clips of grid_s1 (phones by pocketsphinx) and writes `training/corpus/teacher.json`.
The fit compares these measures of motion: lip gap, mouth width, chin, upper and lower inner lip, corners and
protrusion. All but the gap are also components of the teacher's motion. Each clip has a pose of its own in
them, so they are compared after each clip's mean is removed. The loss is 1 − Lin's concordance, whose optimum
has the recording's own amplitude. Frames of p, b and m are left out, because the teacher closes the lips
there by rule. A segment's target is the sum of an offset of its own and a part that depends on its
articulatory features, so segments that GRID lacks move like related ones.
"""

import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from training import DATA
from training.corpus import articulation
from training.corpus.aligned import read_grid_speech
from training.corpus.articulation import COMPONENTS
from training.corpus.clip import FPS, Clip
from training.corpus.grid import read_grid
from training.corpus.mirror import symmetrise
from training.corpus.phones import FEATURES, SEGMENTS, Phone, bilabials, feature_table, split
from training.corpus.teacher import LOWER_FACE, PARAMETERS, row_of
from training.flags import run_command
from training.run import downhill

MEASURES = ("gap", *COMPONENTS)
SHARES = (3.0, 1.0, 1.5, 0.7, 0.5, 0.7, 0.3)
VELOCITY_SHARE = 1.0
PRIOR = 2e-4
SPREAD = {"strength": 0.7, "rate": 0.4, "offset": 0.7, "kin": 2.0}
"""Standard deviation of each parameter's prior.

`strength` and `rate` are in nepers, the others in standard deviations of the component's own motion.
"""
SLOWEST_HZ, FASTEST_HZ = 6.0, 60.0
LEAST_SEEN = 20
"""A segment gets its own offset only if the clips contain it at least this many times."""


def measures(motion: np.ndarray) -> np.ndarray:
    """[..., 68, 3] metres → [..., 7] millimetres, linear in the motion."""
    x, y, z = np.moveaxis(motion * 1e3, -1, 0)
    columns = [
        y[..., 62] - y[..., 66],
        -y[..., 8],
        x[..., 54] - x[..., 48],
        z[..., 48:68].mean(axis=-1),
        y[..., 61:64].mean(axis=-1),
        y[..., 65:68].mean(axis=-1),
        (y[..., 48] + y[..., 54]) / 2,
    ]
    return np.stack(columns, axis=-1)


def measure_basis(clips: list[Clip]) -> np.ndarray:
    """Patterns of landmark motion [K, 68, 3] in metres, each for one standard deviation of its measure.

    Each pattern regresses the motion that the earlier patterns leave unexplained on the next measure.
    """
    moved = np.concatenate([symmetrise(c.motion)[c.weight[:, 0] > 0] for c in clips]).astype(np.float64)
    rest = np.zeros_like(moved)
    rest[:, LOWER_FACE] = moved[:, LOWER_FACE]
    rest = (rest - rest.mean(axis=0)).reshape(len(rest), -1)
    basis = []
    for k in range(1, len(MEASURES)):
        score = measures(rest.reshape(-1, 68, 3))[:, k]
        score = score / score.std()
        pattern = score @ rest / len(rest)
        rest = rest - score[:, None] * pattern
        basis.append(pattern.reshape(68, 3))
    return np.stack(basis).astype(np.float32)


class Dominance(nn.Module):
    """The teacher of `corpus.teacher` with gradients, over a batch of utterances."""

    def __init__(self, basis: np.ndarray, frequent: np.ndarray):
        super().__init__()
        table = feature_table()
        f = dict(zip(FEATURES, table.T, strict=True))
        extra = np.stack([f["round"] * f["high"], f["front"] * f["high"] * f["vowel"]], axis=1)
        speech = np.concatenate([table[:, 1:], extra, np.ones((len(table), 1))], axis=1)
        speech *= (1.0 - f["silence"])[:, None]
        self.basis = basis
        self.register_buffer("features", torch.tensor(speech, dtype=torch.float32))
        self.register_buffer("frequent", torch.from_numpy(frequent[:, None].astype(np.float32)))
        self.register_buffer("strengths0", torch.from_numpy(articulation.strengths()).log())
        self.register_buffer("rates0", torch.from_numpy(articulation.rates()).log())
        self.register_buffer("effect", torch.from_numpy(measures(basis)).float())
        n, k = len(SEGMENTS), len(COMPONENTS)
        self.kin = nn.Parameter(torch.zeros(speech.shape[1], k))
        self.offset = nn.Parameter(torch.zeros(n, k))
        self.strength = nn.Parameter(torch.zeros(n, k))
        self.rate = nn.Parameter(torch.zeros(2, n, k))
        self.lead = nn.Parameter(torch.tensor(0.0))

    def targets(self) -> Tensor:
        """Targets [N, K]; 0 for the pause."""
        return self.features @ self.kin + self.offset * self.frequent

    def shapes(self) -> tuple[Tensor, Tensor, Tensor]:
        """Strengths [N, K], rates [2, N, K], lead in seconds."""
        strengths = (self.strengths0 + self.strength).clamp(-4, 4).exp()
        rates = (self.rates0 + self.rate).exp().clamp(SLOWEST_HZ, FASTEST_HZ)
        return strengths, rates, self.lead.clamp(-0.1, 0.1)

    def forward(self, core: Tensor, half: Tensor, index: Tensor, frames: int) -> Tensor:
        """Rows [B, S] (index −1 is padding) → measures [B, T, 7] in mm."""
        strengths, rates, lead = self.shapes()
        offset = torch.arange(frames)[None, :, None] / FPS + lead - core[:, None]
        before, after = ((x - half[:, None]).clamp_min(0.0)[..., None] for x in (-offset, offset))
        real, index = (index >= 0).float(), index.clamp_min(0)
        fall = torch.exp(-before * rates[0][index][:, None] - after * rates[1][index][:, None])
        dominance = (strengths[index] * real[..., None])[:, None] * fall + 1e-9 * real[:, None, :, None]
        dominance = dominance / dominance.sum(2, keepdim=True)
        blended = torch.einsum("btsk,bsk->btk", dominance, self.targets()[index])
        return blended @ self.effect

    def prior(self) -> Tensor:
        """Sum of squares in units of `SPREAD`."""
        return sum((getattr(self, name) / spread).square().sum() for name, spread in SPREAD.items())


def concordance(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """1 − Lin's concordance of each measure over a whole batch [B, T, M] → [M]."""
    total = weight.sum((0, 1))
    mean_a, mean_b = ((weight * x).sum((0, 1)) / total for x in (a, b))
    p, t = a - mean_a, b - mean_b
    covariance, var_a, var_b = ((weight * x).sum((0, 1)) / total for x in (p * t, p * p, t * t))
    return 1.0 - 2.0 * covariance / (var_a + var_b + (mean_a - mean_b).square() + 1e-9)


def centred(x: Tensor, weight: Tensor) -> Tensor:
    """Removes each clip's weighted mean from all measures but the gap."""
    mean = (weight * x).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp_min(1.0)
    return torch.cat([x[..., :1], (x - mean)[..., 1:]], dim=2)


def fit(model: Dominance, clips: list[tuple[Clip, list[Phone]]], epochs: int, seed: int = 0) -> None:
    """Fits the teacher to whole clips with Adam."""
    frames = max(len(clip.motion) for clip, _ in clips)
    core, half, index = padded(clips)
    truth, weight = (torch.zeros(len(clips), frames, len(MEASURES)) for _ in range(2))
    for k, (clip, phones) in enumerate(clips):
        truth[k, : len(clip.motion)] = torch.from_numpy(measures(symmetrise(clip.motion))).float()
        weight[k, : len(clip.motion)] = torch.from_numpy(
            clip.weight[:, :1] * spoken_open(clip, phones)[:, None]
        )
    slow = [{"params": [model.lead], "lr": 0.002}]
    fast = [{"params": [p for p in model.parameters() if p is not model.lead], "lr": 0.02}]
    optimiser = torch.optim.Adam(fast + slow)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, epochs)
    generator = torch.Generator().manual_seed(seed)
    for epoch in range(epochs):
        for rows in torch.randperm(len(clips), generator=generator).split(128):
            out = model(core[rows], half[rows], index[rows], frames)
            loss = data_loss(out, truth[rows], weight[rows]) + PRIOR * model.prior()
            downhill(loss, optimiser)
        schedule.step()
        if epoch % 20 == 19:
            print(
                f"epoch {epoch + 1}: loss {loss.item():.3f} lead {model.lead.item() * 1e3:.0f} ms", flush=True
            )


def data_loss(out: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Weighted sum of 1 − concordance of each measure and of the gap's speed."""
    a, b = centred(out, weight), centred(truth, weight)
    total = (concordance(a, b, weight) * torch.tensor(SHARES)).sum()
    both = weight[:, 1:, :1] * weight[:, :-1, :1]
    return (
        total + VELOCITY_SHARE * concordance(out[..., :1].diff(dim=1), truth[..., :1].diff(dim=1), both).sum()
    )


def padded(clips: list[tuple[Clip, list[Phone]]]) -> tuple[Tensor, Tensor, Tensor]:
    """Rows of all clips, [B, S] each. Padding has index −1."""
    rows = [row_of(phones, len(clip.motion) / FPS) for clip, phones in clips]
    longest = max(len(row.index) for row in rows)
    tables = [np.zeros((len(rows), longest), np.float32) for _ in range(2)] + [
        np.full((len(rows), longest), -1)
    ]
    for k, row in enumerate(rows):
        for table, values in zip(tables, (row.core_s, row.half_s, row.index), strict=True):
            table[k, : len(values)] = values
    return tuple(torch.from_numpy(table) for table in tables)


def spoken_open(clip: Clip, phones: list[Phone]) -> np.ndarray:
    """Mask [T]: 1 at frames away from p, b and m, else 0."""
    seconds, mask = np.arange(len(clip.motion)) / FPS, np.ones(len(clip.motion), np.float32)
    for start, end in bilabials(phones):
        mask[(seconds > start - 0.06) & (seconds < end + 0.06)] = 0.0
    return mask


def heard_often(clips: list[tuple[Clip, list[Phone]]]) -> np.ndarray:
    """Which segments the clips hold at least `LEAST_SEEN` times, [N] bool. The pause is never among them."""
    indices = [SEGMENTS.index(s) for _, phones in clips for phone in phones for _, _, s in split(phone)]
    counts = np.bincount(indices, minlength=len(SEGMENTS))
    counts[0] = 0
    return counts >= LEAST_SEEN


def save(model: Dominance, path: Path) -> None:
    """Writes the parameters as rounded numbers, the basis in millimetres."""
    with torch.no_grad():
        strengths, rates, lead = (x.detach().numpy() for x in model.shapes())
        targets = model.targets().numpy()
    fields = {
        "segments": list(SEGMENTS),
        "components": list(COMPONENTS),
        "lead_s": round(float(lead), 4),
        "basis": np.round(model.basis.reshape(len(COMPONENTS), -1).astype(float) * 1e3, 3).tolist(),
        "targets": np.round(targets.astype(float), 3).tolist(),
        "strengths": np.round(strengths.astype(float), 3).tolist(),
        "rates": np.round(rates.astype(float), 2).tolist(),
    }
    lines = [f'"{key}": {json.dumps(value, ensure_ascii=False)}' for key, value in fields.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def main(data: Path = DATA) -> None:
    """Fits on the training clips whose words could be aligned."""
    torch.set_num_threads(1)
    phones = {u.name: u.phones for u in read_grid_speech(data)}
    known = [
        (clip, phones[clip.name]) for clip in read_grid(data) if clip.name in phones and not clip.held_out
    ]
    model = Dominance(measure_basis([clip for clip, _ in known]), heard_often(known))
    fit(model, known, epochs=60)
    save(model, PARAMETERS)


if __name__ == "__main__":
    run_command(main)
