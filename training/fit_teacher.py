"""Fits the co-articulation teacher to recorded motion and reports on held-out clips.

    python -m training.fit_teacher --data ../shared/data --out runs/teacher

Fits on the training clips of grid_s1 (phones by pocketsphinx) and writes
`training/corpus/teacher.json`. Measured features are lip gap, mouth width, chin, upper and lower
inner lip, corners and protrusion; all but the gap are compared after each clip's mean is taken
away, as the recording keeps a pose of its own there. The loss is 1 − Lin's concordance, whose best
answer has the recording's own amplitude. Frames of p, b and m are left out: the video under-reports
closure. A prior pulls every segment towards `articulation`; what the features of all segments share
is fitted too, so segments that GRID lacks move with their kin.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from training.corpus import articulation
from training.corpus.aligned import read_grid_speech, speak
from training.corpus.articulation import CHANNELS, GROUP_OF, GROUPS
from training.corpus.clip import FPS, Clip
from training.corpus.espeak import Espeak
from training.corpus.facegood import read_arkit
from training.corpus.grid import read_grid
from training.corpus.ict import IctLandmarks
from training.corpus.phones import FEATURES, SEGMENTS, Phone, bilabials, feature_table
from training.corpus.teacher import PARAMETERS, Teacher, row_of
from training.teacher_report import report

MEASURES = ("gap", "width", "chin", "upper", "lower", "corners", "protrusion")
SHARES = (3.0, 1.0, 1.0, 0.3, 0.7, 0.1, 0.1)
VELOCITY_SHARE = 1.0
PRIOR = 2e-4
SPREAD = {"strength": 0.7, "rate": 0.4}
"""Standard deviation of the prior in nepers."""
TARGET_SPREAD = (0.08, 0.02, 0.06, 0.06, 0.06, 0.03, 0.05, 0.02, 0.015, 0.015, 0.01, 0.015, 0.015)
"""Standard deviation of each channel's prior in ARKit weight. Where channels do alike in the front
view of 68 points (press and shrug, funnel and pucker), a narrow prior keeps the textbook's share.
That the mouth is narrower in speech than at rest is left to what all segments share."""
ROUNDING, UNROUNDED_SPREAD = slice(2, 4), 0.015
SCALE_SPREAD = (1e-3, 0.05, 0.05, 0.2, 0.2, 0.2, 0.2)
"""How far the speaker's own scale of each measure may stray, in nepers; it is not saved."""
SLOWEST_HZ, FASTEST_HZ = 6.0, 60.0
SOFT = 0.01
SMALL = ("kin", "own", "rest", "lead")
MATCHED = ("jawOpen", "mouthFunnel", "mouthPucker", "mouthLowerDown")


def measures(motion: np.ndarray) -> np.ndarray:
    """[..., 68, 3] metres → [..., 7] millimetres, linear in the motion."""
    x, y, z = np.moveaxis(motion * 1e3, -1, 0)
    columns = [
        y[..., 62] - y[..., 66],
        x[..., 54] - x[..., 48],
        -y[..., 8],
        y[..., 61:64].mean(axis=-1),
        y[..., 65:68].mean(axis=-1),
        (y[..., 48] + y[..., 54]) / 2,
        (z[..., 51] + z[..., 57] - z[..., 48] - z[..., 54]) / 2,
    ]
    return np.stack(columns, axis=-1)


def spreads(rounded: np.ndarray) -> Tensor:
    """`TARGET_SPREAD` for each row, [R, C]; only rows that are `rounded` [R] learn rounding freely."""
    table = np.tile(np.array(TARGET_SPREAD, np.float32), (len(rounded), 1))
    table[~rounded, ROUNDING] = UNROUNDED_SPREAD
    return torch.from_numpy(table)


class Dominance(nn.Module):
    """The teacher of `corpus.teacher` with gradients, over a batch of utterances."""

    def __init__(self, ict: IctLandmarks):
        super().__init__()
        table = feature_table()
        f = dict(zip(FEATURES, table.T, strict=True))
        extra = np.stack([f["round"] * f["high"], f["front"] * f["high"] * f["vowel"]], axis=1)
        speech = np.concatenate([table[:, 1:], extra, np.ones((len(table), 1))], axis=1)
        speech *= (1.0 - f["silence"] - (f["closed"] == 1.0))[:, None]
        self.register_buffer("features", torch.tensor(speech, dtype=torch.float32))
        self.register_buffer("fitted", (self.features.abs().sum(1, keepdim=True) > 0).float())
        self.register_buffer("targets0", torch.from_numpy(articulation.targets()))
        self.register_buffer("strengths0", torch.from_numpy(articulation.strengths()).log())
        self.register_buffer("rates0", torch.from_numpy(articulation.rates()).log())
        self.register_buffer("own_spread", spreads(f["round"] > 0.2))
        names = [*FEATURES[1:], "round high", "front high", "all"]
        self.register_buffer(
            "kin_spread", spreads(np.array(["round" in name or name == "all" for name in names]))
        )
        sides = [(f"{n}_L", f"{n}_R") if f"{n}_L" in ict.modes else (n,) for n in CHANNELS]
        modes = [sum(ict.mode(side) for side in both) for both in sides]
        self.register_buffer("effect", torch.from_numpy(measures(np.stack(modes))).float())
        n, c, g = len(SEGMENTS), len(CHANNELS), len(GROUPS)
        self.kin = nn.Parameter(torch.zeros(speech.shape[1], c))
        self.own = nn.Parameter(torch.zeros(n, c))
        self.strength = nn.Parameter(torch.zeros(n, g))
        self.rate = nn.Parameter(torch.zeros(2, n, g))
        self.lead = nn.Parameter(torch.tensor(0.0))
        self.rest = nn.Parameter(torch.zeros(c))
        self.scale = nn.Parameter(torch.zeros(len(MEASURES)))

    def targets(self) -> Tensor:
        """[N, C], never negative."""
        start = torch.log(torch.expm1((self.targets0 / SOFT).clamp_min(0.05))) * SOFT
        moved = start + self.features @ self.kin + self.own * self.fitted
        free = nn.functional.softplus(moved / SOFT) * SOFT
        return torch.where(self.fitted > 0, free, self.targets0)

    def shapes(self) -> tuple[Tensor, Tensor, Tensor]:
        """Strengths [N, G], rates [2, N, G], lead in seconds."""
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
        targets = self.targets() + nn.functional.one_hot(torch.tensor(0), len(SEGMENTS))[:, None] * self.rest
        picked = targets[index]
        groups = [torch.bmm(dominance[..., g], picked[..., GROUP_OF == g]) for g in range(len(GROUPS))]
        order = np.argsort(np.concatenate([np.flatnonzero(g == GROUP_OF) for g in range(len(GROUPS))]))
        return torch.cat(groups, dim=2)[..., order] @ self.effect * self.scale.exp()

    def prior(self) -> Tensor:
        """Sum of squares in units of `SPREAD`."""
        spread = torch.tensor(TARGET_SPREAD)
        total = (self.kin / self.kin_spread).square().sum() + (self.own / self.own_spread).square().sum()
        total += sum((getattr(self, name) / s).square().sum() for name, s in SPREAD.items())
        return (
            total
            + (self.scale / torch.tensor(SCALE_SPREAD)).square().sum()
            + (self.rest / spread).square().sum()
        )


def concordance(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """1 − Lin's concordance of each measure over a whole batch [B, T, M] → [M]."""
    total = weight.sum((0, 1))
    mean_a, mean_b = ((weight * x).sum((0, 1)) / total for x in (a, b))
    p, t = a - mean_a, b - mean_b
    covariance, var_a, var_b = ((weight * x).sum((0, 1)) / total for x in (p * t, p * p, t * t))
    return 1.0 - 2.0 * covariance / (var_a + var_b + (mean_a - mean_b).square() + 1e-9)


def centred(x: Tensor, weight: Tensor) -> Tensor:
    """All measures but the gap less their weighted mean over each clip."""
    mean = (weight * x).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp_min(1.0)
    return torch.cat([x[..., :1], (x - mean)[..., 1:]], dim=2)


def fit(model: Dominance, clips: list[tuple[Clip, list[Phone]]], epochs: int, seed: int = 0) -> None:
    """Adam over whole clips."""
    frames = max(len(clip.motion) for clip, _ in clips)
    core, half, index = padded(clips)
    truth, weight = (torch.zeros(len(clips), frames, len(MEASURES)) for _ in range(2))
    for k, (clip, phones) in enumerate(clips):
        truth[k, : len(clip.motion)] = torch.from_numpy(measures(clip.motion)).float()
        weight[k, : len(clip.motion)] = torch.from_numpy(
            clip.weight[:, :1] * spoken_open(clip, phones)[:, None]
        )
    small = [p for name, p in model.named_parameters() if name in SMALL]
    large = [p for name, p in model.named_parameters() if name not in SMALL]
    optimiser = torch.optim.Adam([{"params": large, "lr": 0.01}, {"params": small, "lr": 0.002}])
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, epochs)
    generator = torch.Generator().manual_seed(seed)
    for epoch in range(epochs):
        for rows in torch.randperm(len(clips), generator=generator).split(128):
            out = model(core[rows], half[rows], index[rows], frames)
            loss = data_loss(out, truth[rows], weight[rows]) + PRIOR * model.prior()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        schedule.step()
        if epoch % 20 == 19:
            print(
                f"epoch {epoch + 1}: loss {loss.item():.3f} lead {model.lead.item() * 1e3:.0f} ms", flush=True
            )


def data_loss(out: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Weighted sum of each measure's disagreement, and of the gap's speed."""
    a, b = centred(out, weight), centred(truth, weight)
    total = (concordance(a, b, weight) * torch.tensor(SHARES)).sum()
    both = weight[:, 1:, :1] * weight[:, :-1, :1]
    return (
        total + VELOCITY_SHARE * concordance(out[..., :1].diff(dim=1), truth[..., :1].diff(dim=1), both).sum()
    )


def padded(clips: list[tuple[Clip, list[Phone]]]) -> tuple[Tensor, Tensor, Tensor]:
    """Rows of all clips, [B, S] each; padding has index −1."""
    rows = [row_of(phones, len(clip.motion) / FPS) for clip, phones in clips]
    longest = max(len(row.index) for row in rows)
    found = [np.zeros((len(rows), longest), np.float32) for _ in range(2)] + [
        np.full((len(rows), longest), -1)
    ]
    for k, row in enumerate(rows):
        for table, values in zip(found, (row.core_s, row.half_s, row.index), strict=True):
            table[k, : len(values)] = values
    return tuple(torch.from_numpy(table) for table in found)


def spoken_open(clip: Clip, phones: list[Phone]) -> np.ndarray:
    """1 at frames away from p, b and m, [T]."""
    seconds, kept = np.arange(len(clip.motion)) / FPS, np.ones(len(clip.motion), np.float32)
    for start, end in bilabials(phones):
        kept[(seconds > start - 0.06) & (seconds < end + 0.06)] = 0.0
    return kept


def save(model: Dominance, gains: dict[str, np.ndarray], path: Path) -> None:
    """The parameters as rounded numbers; the recording's own rest face is left out."""
    with torch.no_grad():
        strengths, rates, lead = (x.detach().numpy() for x in model.shapes())
        targets = model.targets().numpy()
    fields = {
        "segments": list(SEGMENTS),
        "channels": list(CHANNELS),
        "lead_s": round(float(lead), 4),
        "gains": {name: np.round(values, 3).tolist() for name, values in gains.items()},
        "targets": np.round(targets.astype(float), 4).tolist(),
        "strengths": np.round(strengths.astype(float), 3).tolist(),
        "rates": np.round(rates.astype(float), 2).tolist(),
    }
    lines = [f'"{key}": {json.dumps(value, ensure_ascii=False)}' for key, value in fields.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def mandarin_gains(data: Path, teacher: Teacher) -> np.ndarray:
    """Gain of each channel [C] that gives Mandarin speech the recorded 95th percentiles.

    facegood_zh has no phone times, so made Mandarin speech stands in for its sentences; training
    parts of the takes only. Channels that its capture lacks or uses in another way keep 1.
    """
    spoken = speak(Espeak(), "cmn", 2.0, seed=3)
    made = np.concatenate([teacher.channels(u.phones, len(u.samples) // 640) for u in spoken])
    takes = [read_arkit(p) for p in sorted((data / "motion/facegood_zh").glob("*.arkit.csv"))]
    gains = np.ones(len(CHANNELS))
    for name in MATCHED:
        key = name if name in takes[0] else f"{name}Left"
        truth = np.concatenate([take[key][: int(0.85 * len(take[key]))] for take in takes])
        column = CHANNELS.index(name)
        gains[column] = np.quantile(truth, 0.95) / max(np.quantile(made[:, column], 0.95), 0.01)
    return gains.clip(0.5, 2.5)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("runs/teacher"))
    parser.add_argument("--parameters", type=Path, default=PARAMETERS)
    parser.add_argument("--epochs", type=int, default=80)
    parser.add_argument("--report-only", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    arguments.out.mkdir(parents=True, exist_ok=True)
    model = Dominance(IctLandmarks(arguments.data))
    flat = {"grid_s1": np.ones(len(CHANNELS))}
    save(model, flat, arguments.out / "guess.json")
    phones = {u.name: u.phones for u in read_grid_speech(arguments.data)}
    clips = [(clip, phones[clip.name]) for clip in read_grid(arguments.data) if clip.name in phones]
    if not arguments.report_only:
        fit(model, [pair for pair in clips if not pair[0].held_out], arguments.epochs)
        save(model, flat, arguments.parameters)
        teacher = Teacher.load(arguments.data, path=arguments.parameters)
        both = flat | {"facegood_zh": mandarin_gains(arguments.data, teacher)}
        save(model, both, arguments.parameters)
    report(arguments.data, arguments.out, [p for p in clips if p[0].held_out], arguments.parameters)


if __name__ == "__main__":
    main()
