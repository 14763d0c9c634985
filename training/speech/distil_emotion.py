"""Teaches the ear for emotion to predict Whisper's layers, on sounds of altered pitch, tract, room, noise.

    python -m training.speech.distil_emotion --windows runs/ear/windows.pt --whisper runs/whisper-base \
        --bank runs/ear/bank.pt --out runs/ear/net.pt

Emotion labels serve only to find the directions in which an actor's emotions differ from his neutral voice.
A third of the outputs are these directions. The rest are the directions in which all voices differ most.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from training.corpus.emodb import HELD_OUT, SOURCE
from training.speech import whisper
from training.speech.emotion_ear import EmotionEarConfig, EmotionEarNet, inputs_of
from training.speech.log_mel import BANDS, FFT, FLOOR, FRAME, HOP, SAMPLE_RATE_HZ, mel_filters
from training.systems.emoface import emotion_encoder

LAYERS = [3, 4, 5]
FELT_DIRECTIONS, FELT_SHARE = 40, 2.0
"""Number of target directions in which acted clips differ most from their actor's neutral voice, and the loss
weight of these directions. All other directions weigh 1.
"""
SPEED_OCTAVES = 0.22
SHORTEST, LONGEST, UNIT = 80, 200, 20
"""Shortest and longest part that is cut from a sound, and the step that lengths are rounded down to. All in
frames of 10 ms.
"""
LARGEST = 6.0
BATCH = 32
JITTER = 0.03
"""Standard deviation of the random offset that each band gets throughout a window, in units of the network's
input. It changes the colour of the sound.
"""
LEAST_DEVIATION = 1e-4


def pooled(layers: list[Tensor]) -> Tensor:
    """Mean, spread and change of layers over time, [B, T, C] each → [B, 3 C layers]."""
    parts = [p for x in layers for p in (x.mean(1), x.std(1), x.diff(dim=1).abs().mean(1))]
    return torch.cat(parts, dim=1)


def batch_power(x: Tensor, fft: int) -> Tensor:
    """|X|² of sounds [B, S] as in `log_mel.power_spectrum`, [B, 1 + S // 160, fft / 2 + 1]."""
    frames = 1 + x.shape[1] // HOP
    framed = F.pad(x, (FRAME // 2, FRAME // 2 + HOP)).unfold(1, FRAME, HOP)[:, :frames]
    spectrum = torch.fft.rfft(framed * torch.hann_window(FRAME, periodic=True, device=x.device), n=fft)
    return spectrum.real.square() + spectrum.imag.square()


class Hearing:
    """Network input and Whisper target for a batch of sounds [B, S], all with the same peak."""

    def __init__(self, folder: Path, device: str):
        self.whisper = whisper.load(folder).to(device)
        self.filters, self.mel = whisper.filters().to(device), mel_filters().to(device)
        bins = np.arange(emotion_encoder.LOW_BIN, emotion_encoder.HIGH_BIN)
        cosines = np.cos(2.0 * np.pi * np.outer(bins, emotion_encoder.LAGS) / FFT)
        overlap = np.maximum(emotion_encoder.overlap(), emotion_encoder.LEAST_OVERLAP)
        self.cosines = torch.from_numpy(cosines / overlap).float().to(device)
        self.octave = torch.from_numpy(np.log2(SAMPLE_RATE_HZ / emotion_encoder.LAGS)).float().to(device)

    @torch.no_grad()
    def teacher(self, x: Tensor) -> Tensor:
        """Pooled layers of Whisper, [B, C']."""
        padded = F.pad(x[:, None], (200, 200), mode="reflect")[:, 0]
        framed = padded.unfold(1, 400, HOP)[:, : x.shape[1] // HOP]
        spectrum = torch.fft.rfft(framed * torch.hann_window(400, periodic=True, device=x.device))
        power = (spectrum.real.square() + spectrum.imag.square()) @ self.filters
        decades = power.clamp_min(whisper.FLOOR).log10()
        decades = decades.maximum(decades.amax(dim=(1, 2), keepdim=True) - whisper.RANGE)
        return pooled(self.whisper((decades + 4.0) / 4.0, LAYERS))

    @torch.no_grad()
    def student(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Network input and weights of the sounds, from `inputs_of`."""
        power = batch_power(x, FFT)
        mel = (power @ self.mel).clamp_min(FLOOR).log()
        low = power[..., emotion_encoder.LOW_BIN : emotion_encoder.HIGH_BIN]
        share = low @ self.cosines / low.sum(-1, keepdim=True).clamp_min(1e-9)
        best = share.max(dim=-1)
        return inputs_of(mel, self.octave[best.indices], best.values)


def moved(x: Tensor, random: torch.Generator) -> Tensor:
    """Sounds [B, S] at another pitch and tract, through another microphone, in a room, with noise; peak 0.9.

    A third of them stay as they are.
    """
    count, samples = x.shape
    draw = lambda *shape: torch.rand(*shape, generator=random, device=x.device)  # noqa: E731
    plain = draw(count, 1) < 0.33
    speed = torch.exp2((2.0 * draw(count, 1) - 1.0) * SPEED_OCTAVES)
    at = torch.arange(samples, device=x.device)[None] * speed
    below = at.long().clamp_max(samples - 2)
    share = (at - below).clamp(0.0, 1.0)
    faster = (x.gather(1, below) * (1.0 - share) + x.gather(1, below + 1) * share) * (at < samples - 1)
    spectrum = torch.fft.rfft(faster, n=2 * samples)
    bins = spectrum.shape[1]
    knots = 0.7 * torch.randn(count, 1, 8, generator=random, device=x.device)
    colour = F.interpolate(knots, bins, mode="linear", align_corners=True)[:, 0]
    place = torch.linspace(0.0, 8.0, bins, device=x.device)[None]
    narrow = (draw(count, 1) < 0.15).float()
    top = 3.4 + 3.6 * draw(count, 1)
    colour = colour - narrow * 4.0 * ((place - top).clamp_min(0.0) + (0.3 - place).clamp_min(0.0) * 8.0)
    decay = torch.exp(-torch.arange(samples // 4, device=x.device)[None] / (200.0 + 3000.0 * draw(count, 1)))
    tail = torch.randn(count, samples // 4, generator=random, device=x.device) * decay * 0.06
    tail = tail * (draw(count, 1) < 0.5) * draw(count, 1)
    tail[:, 0] = 1.0
    room = torch.fft.rfft(tail, n=2 * samples)
    heard = torch.fft.irfft(spectrum * colour.exp() * room, n=2 * samples)[:, :samples]
    level = heard.abs().amax(dim=1, keepdim=True).clamp_min(1e-4)
    white = torch.randn(count, samples, generator=random, device=x.device)
    soft = (white + white.roll(1, 1) + white.roll(2, 1)) / 1.7
    noise = torch.where(draw(count, 1) < 0.5, white, soft)
    heard = heard + noise * level * 10.0 ** (-(1.3 + 2.7 * draw(count, 1)))
    heard = torch.where(plain, x, heard)
    return heard * (0.9 / heard.abs().amax(dim=1, keepdim=True).clamp_min(1e-4))


def cut(sounds: Tensor, lengths: Tensor, random: torch.Generator) -> dict[int, tuple[Tensor, Tensor]]:
    """Cuts a part from each sound [N, S] of `lengths` [N]: the longest possible half of the time.

    Keys are numbers of frames, multiples of 20. Values are the numbers of the sounds and their parts.
    """
    draw = lambda: torch.rand(len(sounds), generator=random, device=sounds.device)  # noqa: E731
    least, most = SHORTEST, (lengths // HOP).clamp_max(LONGEST)
    sizes = torch.where(draw() < 0.5, most, least + (draw() * (most - least)).long()) // UNIT * UNIT
    start = (draw() * (lengths - sizes * HOP + 1)).long()
    parts = {}
    for frames in sizes.unique().tolist():
        which = (sizes == frames).nonzero()[:, 0]
        at = start[which, None] + torch.arange(frames * HOP, device=sounds.device)[None]
        parts[frames] = which, sounds[which].gather(1, at)
    return parts


@torch.no_grad()
def bank(
    sounds: Tensor, lengths: Tensor, hearing: Hearing, variants: int, random: torch.Generator
) -> list[dict]:
    """Parts of all sounds, each `variants` times, with network input and Whisper target."""
    batches = []
    for variant in range(variants):
        for frames, (which, parts) in cut(sounds, lengths, random).items():
            for first in range(0, len(which), 32):
                x = moved(parts[first : first + 32], random)
                heard, weight = hearing.student(x)
                batches.append({"which": which[first : first + 32], "heard": heard.half(), "weight": weight,
                              "rows": hearing.teacher(x).half(), "frames": frames})  # fmt: skip
        print("variant", variant + 1, "of", variants, flush=True)
    return batches


def leading(rows: Tensor, count: int) -> Tensor:
    """The directions of largest variance, [C, count]."""
    return torch.svd_lowrank(rows, q=count + 20, niter=4)[2][:, :count]


def directions(rows: Tensor, emotion_offsets: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """`mean`, `scale` [C] and `basis` [C, count] of the targets in pooled layers [N, C].

    `emotion_offsets` [M, C]: acted clips minus the neutral voice of their actor.
    """
    mean, scale = rows.mean(0), rows.std(0) + LEAST_DEVIATION
    first = leading(emotion_offsets / scale, FELT_DIRECTIONS)
    z = ((rows - mean) / scale).clamp(-LARGEST, LARGEST)
    z = z - (z @ first) @ first.T
    second = leading(z, count - FELT_DIRECTIONS)
    return mean, scale, torch.cat([first, second], dim=1)


def made_bank(arguments, sounds: Tensor, lengths: Tensor) -> list[dict]:
    """The bank from the file `--bank`, which is written if it is missing."""
    if not arguments.bank.exists():
        random = torch.Generator().manual_seed(arguments.seed)
        hearing = Hearing(arguments.whisper, "cpu")
        torch.save(bank(sounds, lengths, hearing, arguments.variants, random), arguments.bank)
    return torch.load(arguments.bank)


def train(net: EmotionEarNet, batches: list[tuple[Tensor, Tensor, Tensor, Tensor]], seconds: float) -> dict:
    """Fits `net` to (heard, weight, target, chance) of equally long windows. Returns averaged weights."""
    optimiser = torch.optim.AdamW(net.parameters(), 0.0, weight_decay=0.05)
    average = {k: v.clone() for k, v in net.state_dict().items()}
    many = torch.tensor([float(chance.sum()) for *_, chance in batches])
    share = torch.ones(net.outer.out_features)
    share[:FELT_DIRECTIONS] = FELT_SHARE
    step, losses, began = 0, [], time.monotonic()
    while (done := (time.monotonic() - began) / seconds) < 1.0:
        for group in optimiser.param_groups:
            group["lr"] = 2e-3 * min(1.0, step / 100) * (0.5 + 0.5 * np.cos(np.pi * done)) + 1e-5
        heard, weight, target, chance = batches[int(torch.multinomial(many, 1))]
        rows = torch.multinomial(chance, BATCH, replacement=True)
        x = heard[rows].float()
        x[..., :BANDS] += JITTER * torch.randn(BATCH, 1, BANDS)
        loss = (share * (net(x, weight[rows]) - target[rows]).square()).mean()
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()
        with torch.no_grad():
            for key, value in net.state_dict().items():
                average[key].lerp_(value, 1.0 - min(0.995, step / (step + 10)))
        losses.append(loss.detach())
        step += 1
        if step % 100 == 0:
            print(f"{100 * done:.0f} %, step {step}: {torch.stack(losses[-100:]).mean():.4f}", flush=True)
    return average


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--windows", type=Path, required=True, help="windows.pt of training.speech.emotion_windows"
    )
    parser.add_argument("--whisper", type=Path, required=True, help="folder of training.speech.whisper")
    parser.add_argument(
        "--bank",
        type=Path,
        required=True,
        help="file of the network's inputs and targets; written if it is missing",
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--leave", nargs="*", default=HELD_OUT, help="actors of emodb_de to leave out")
    parser.add_argument("--variants", type=int, default=3)
    parser.add_argument("--go-on", type=Path, help="an earlier --out to start from")
    parser.add_argument("--minutes", type=float, default=12.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    saved = torch.load(arguments.windows)
    places = [k for k, a in enumerate(saved["about"]) if a["source"] == SOURCE or not a["held_out"]]
    about, sounds = [saved["about"][k] for k in places], saved["sounds"][places]
    lengths = torch.tensor([a["samples"] for a in about])
    batches = made_bank(arguments, sounds.float() / 32768.0, lengths)
    is_felt = torch.tensor([a["source"] == SOURCE for a in about])
    is_left = torch.tensor([a["source"] == SOURCE and a["speaker"] in arguments.leave for a in about])
    chance = torch.where(is_felt, 1.0 / is_felt.sum(), 1.2 / (~is_felt).sum()) * ~is_left
    which = torch.cat([b["which"] for b in batches])
    rows = torch.cat([b["rows"] for b in batches]).float()
    emotion_offsets = torch.zeros_like(rows)
    for actor in {a["speaker"] for a in about if a["source"] == SOURCE}:
        of_actor = torch.tensor([about[k]["speaker"] == actor for k in which.tolist()])
        neutral = of_actor & torch.tensor([about[k]["emotion"] == "neutral" for k in which.tolist()])
        emotion_offsets[of_actor] = rows[of_actor] - rows[neutral].mean(0)
    config = EmotionEarConfig()
    is_training = ~is_left[which]
    mean, scale, basis = directions(
        rows[is_training], emotion_offsets[is_training & is_felt[which]], config.told
    )
    spread = (((rows[is_training] - mean) / scale).clamp(-LARGEST, LARGEST) @ basis).std(0)
    # Directions of large spread count more: in proportion to their deviation, not to their variance.
    unit = spread.sqrt() * spread.max().sqrt()
    sized = {}
    for b in batches:
        target = ((b["rows"].float() - mean) / scale).clamp(-LARGEST, LARGEST) @ basis / unit
        sized.setdefault(b["frames"], []).append((b["heard"], b["weight"], target, chance[b["which"]]))
    merged = [tuple(torch.cat(parts) for parts in zip(*group, strict=True)) for group in sized.values()]
    merged = [group for group in merged if group[3].sum() > 0]
    power = torch.cat([target.square().mean()[None] for *_, target, _ in merged]).mean()
    print(f"targets of mean square {power:.4f}", flush=True)
    net = EmotionEarNet(config)
    if arguments.go_on is not None:
        net.load_state_dict(torch.load(arguments.go_on)["state"])
    state = train(net, merged, 60.0 * arguments.minutes)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"config": config.to_json(), "state": state, "leave": arguments.leave}, arguments.out)
    print(arguments.out)


if __name__ == "__main__":
    main()
