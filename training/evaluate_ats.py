"""Measures exported speech and ATS models on clips they never saw.

    python -m training.evaluate_ats --data ../shared/data --models rust-core/models

prints a table: lip-gap correlation on SAMPLED motion (inner-lip distance of landmarks 62 and 66
on each clip's own neutral), jaw, amplitude, lag, dependence on seed and loudness, and silence.
`--plots FOLDER` adds pictures; `--sweep` tries sampling settings; `--unseen SOURCE` takes every
clip of a source (for models trained with `--leave-out`).
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from training.corpus.clip import Clip, inner_gap
from training.corpus.facegood import CAPTURE_FPS, SOURCE, read_arkit, read_facegood, resample
from training.corpus.grid import read_grid
from training.corpus.ict import IctLandmarks
from training.export import load_models
from training.speech.compact import normalise
from training.speech.log_mel import log_mel
from training.systems.freetalk.ats import Sampling
from training.systems.freetalk.sampling import sample_motion

LIPS = slice(48, 68)
CHIN = slice(6, 11)


class Speaker:
    """Sound in, sampled motion out."""

    def __init__(self, models: Path, name: str = "compact"):
        self.encoder, self.denoiser = load_models(models, name)
        self.config = self.denoiser.config

    @torch.no_grad()
    def speak(self, samples: np.ndarray, frames: int, style: str, **options) -> np.ndarray:
        """Samples [S] at 16 kHz → displacements [frames, 68, 3] metres.

        Options: `seed`, `sampling`, `affect` [frames, 16].
        """
        features = self.encoder(normalise(log_mel(torch.from_numpy(samples)))[None])[0]
        index = torch.arange(frames).clamp_max(len(features) - 1)
        affect = options.get("affect")
        if affect is None:
            affect = torch.zeros(frames, 16)
            affect[:, 0] = 1.0
        motion = sample_motion(
            self.denoiser,
            features[index],
            affect,
            self.config.styles.index(style),
            options.get("seed", 0),
            options.get("sampling"),
        )
        return motion.unflatten(1, (68, 3)).numpy()


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson r, 0 where one side does not move."""
    return float(np.corrcoef(a, b)[0, 1]) if a.std() > 1e-9 and b.std() > 1e-9 else 0.0


def best_lag(predicted: np.ndarray, true: np.ndarray, reach: int = 5) -> int:
    """Frames by which the prediction comes late (positive) at the highest correlation."""
    scores = {}
    for lag in range(-reach, reach + 1):
        a = predicted[max(lag, 0) : len(predicted) + min(lag, 0)]
        b = true[max(-lag, 0) : len(true) + min(-lag, 0)]
        scores[lag] = correlation(a, b)
    return max(scores, key=scores.get)


def jaw_open(motion: np.ndarray, ict: IctLandmarks) -> np.ndarray:
    """jawOpen equivalent [T]: the chin's motion along ICT's jawOpen mode."""
    mode = ict.mode("jawOpen")[CHIN]
    return (motion[:, CHIN] * mode).sum(axis=(1, 2)) / (mode * mode).sum()


def lip_scores(speaker: Speaker, clips: list[Clip], style: str, **options) -> dict[str, float]:
    """Sampled against recorded motion of some clips."""
    predicted, true, lips = [], [], []
    for clip in clips:
        motion = speaker.speak(clip.samples, len(clip.motion), style, **options)
        predicted.append(inner_gap(motion, clip.neutral))
        true.append(inner_gap(clip.motion, clip.neutral))
        lips.append(np.linalg.norm((motion - clip.motion)[:, LIPS], axis=2).max(axis=1))
    p, t = np.concatenate(predicted), np.concatenate(true)
    return {
        "r_pooled": correlation(p, t),
        "r_clip": float(np.mean([correlation(a, b) for a, b in zip(predicted, true, strict=True)])),
        "std_ratio": float(p.std() / t.std()),
        "bias_mm": float((p - t).mean() * 1e3),
        "lag_frames": best_lag(p, t),
        "lip_error_mm": float(np.concatenate(lips).mean() * 1e3),
    }


def jaw_scores(speaker: Speaker, clips: list[Clip], data: Path, style: str) -> float:
    """r of the jawOpen equivalent with the captured jawOpen weight."""
    ict, pairs = IctLandmarks(data), []
    for clip in clips:
        take, part = clip.name.split("/")
        weight = read_arkit(data / "motion" / SOURCE / f"{take}.arkit.csv")["jawOpen"]
        truth = resample(weight, CAPTURE_FPS, 25.0)
        truth = truth[len(truth) - len(clip.motion) :] if part == "end" else truth
        motion = speaker.speak(clip.samples, len(clip.motion), style)
        pairs.append((jaw_open(motion, ict), truth[: len(motion)]))
    p, t = (np.concatenate(x) for x in zip(*pairs, strict=True))
    return correlation(p, t)


def robustness(speaker: Speaker, clip: Clip, style: str) -> dict[str, float]:
    """Seeds, loudness and silence, in millimetres of landmark motion."""
    frames = len(clip.motion)
    base = speaker.speak(clip.samples, frames, style)
    other = speaker.speak(clip.samples, frames, style, seed=1)
    quiet = speaker.speak(clip.samples * 0.03, frames, style)
    generator = np.random.default_rng(0)
    hiss = (generator.standard_normal(48000) * 3e-3).astype(np.float32)
    silent = speaker.speak(np.zeros(48000, np.float32), 75, style)
    noisy = speaker.speak(hiss, 75, style)

    def lips_mm(x):
        return float(np.linalg.norm(x[:, LIPS], axis=2).mean() * 1e3)

    return {
        "seed difference, lips mm": lips_mm(base - other),
        "30 dB quieter, lips mm": lips_mm(base - quiet),
        "digital silence, lips mm": lips_mm(silent),
        "hiss at -50 dB, lips mm": lips_mm(noisy),
    }


def sweep(speaker: Speaker, clips: dict[str, list[Clip]]) -> None:
    """r, amplitude and time of sampling settings."""
    for steps in (1, 2, 4, 10, 20):
        for temperature in (0.0, 0.3, 0.6, 1.0):
            sampling = Sampling(steps, "trailing", temperature)
            started, line = time.time(), []
            for source, chosen in clips.items():
                scores = lip_scores(speaker, chosen[:30], source, sampling=sampling)
                line.append(f"{source} r {scores['r_pooled']:.3f} std {scores['std_ratio']:.2f}")
            seconds = time.time() - started
            setting = f"steps {steps:3d} temperature {temperature:.1f}"
            print(f"{setting}: {'  '.join(line)}  {seconds:.1f} s")


def plot(speaker: Speaker, clips: dict[str, list[Clip]], folder: Path) -> None:
    """Predicted and recorded lip gap over the waveform."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    for source, chosen in clips.items():
        figure, axes = plt.subplots(4, 1, figsize=(14, 14))
        for axis, clip in zip(axes, (chosen * 4)[:4], strict=True):
            frames = min(len(clip.motion), 250)
            motion = speaker.speak(clip.samples, len(clip.motion), source)
            seconds = np.arange(frames) / 25.0
            wave = clip.samples[: frames * 640]
            axis.plot(np.arange(len(wave)) / 16000, wave * 4, color="0.85", lw=0.5)
            for label, x in (("recorded", clip.motion), ("sampled", motion)):
                gap = inner_gap(x, clip.neutral)[:frames] * 1e3
                axis.plot(seconds, gap, label=f"{label}, mm")
            axis.set_title(f"{source} {clip.name}")
            axis.legend()
        figure.tight_layout()
        figure.savefig(folder / f"gap_{source}.png", dpi=70)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--models", type=Path, default=Path("rust-core/models"))
    parser.add_argument("--name", default="compact")
    parser.add_argument("--plots", type=Path)
    parser.add_argument("--sweep", action="store_true")
    parser.add_argument("--unseen", nargs="*", default=[], help="sources that training left out")
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    speaker = Speaker(arguments.models, arguments.name)
    clips = {"grid_s1": read_grid(arguments.data), "facegood_zh": read_facegood(arguments.data)}
    clips = {
        source: [clip for clip in found if clip.held_out or source in arguments.unseen]
        for source, found in clips.items()
    }
    if arguments.sweep:
        sweep(speaker, clips)
        return
    print(f"sampling: {speaker.config.sampling}")
    for source, chosen in clips.items():
        for style in speaker.config.styles:
            scores = lip_scores(speaker, chosen[:200], style)
            numbers = "  ".join(f"{key} {value:.3f}" for key, value in scores.items())
            print(f"{source} with style {style}: {numbers}")
    for style in speaker.config.styles:
        jaw = jaw_scores(speaker, clips["facegood_zh"], arguments.data, style)
        print(f"facegood_zh jawOpen r with style {style}: {jaw:.3f}")
    default = speaker.config.default_style
    for key, value in robustness(speaker, clips["grid_s1"][0], default).items():
        print(f"{key}: {value:.3f}")
    if arguments.plots:
        plot(speaker, clips, arguments.plots)


if __name__ == "__main__":
    main()
