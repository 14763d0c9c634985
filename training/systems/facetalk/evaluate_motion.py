"""Measures FaceTalk's speech model on held-out clips, with FreeTalk and loudness beside it.

    python -m training.systems.facetalk.evaluate_motion --model weights/facetalk/facetalk_compact
    python -m training.systems.facetalk.evaluate_motion --corpus DIR --motion runs/facetalk_motion/motion.pt

`--corpus` takes the held-out clips of corpus folders instead of the project's own. Codes are converted back
to ARKit weights and shown on ICT's landmarks, so the head's field has no influence. `--runs NAME=motion.pt`
adds rows for runs that lack a part of the model (table 2).
"""

import argparse
import itertools
from dataclasses import replace
from pathlib import Path
from statistics import mean

import torch
from torch import Tensor

from training import shipped
from training.corpus import ear
from training.corpus.arkit import landmarks_of
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.ear import EarClip
from training.corpus.faces import CHANNELS, load_ict
from training.corpus.poses import emotion_prototypes
from training.losses import feature_scores, lip_gap
from training.speech.ear import SHIPPED_EAR, EarBody, load_ear
from training.systems.facetalk.motion import CM, Denoiser, Sampling, sample
from training.systems.facetalk.stored import load_folder, load_head, load_motion
from training.systems.facetalk.train_motion import Codes, with_weights
from training.systems.freetalk.ats import neutral_affect
from training.systems.freetalk.sampling import sample_motion
from training.systems.freetalk.stored import load_models

JAW = CHANNELS.index("jawOpen")
GUIDANCES = (1.0, 1.5, 2.0, 3.0)
SEEDS = 5
OFF_MM = (0.0, 0.2, 1.0)
LONG_FRAMES, WINDOW_FRAMES = 1500, 48
UPPER = [*range(17, 27), *range(36, 48)]
STILL = [0, 1, 15, 16, 27, 28]
"""Landmarks that no speech moves: the ends of the jaw line and the bridge of the nose."""


class Speaker:
    """A model with its ear and the map from codes to weights."""

    def __init__(self, model: Denoiser, codes: Codes, encoder: EarBody):
        self.model, self.codes, self.encoder = model, codes, encoder

    @torch.no_grad()
    def heard(self, clip: EarClip) -> Tensor:
        """Speech features [T, C] of a clip in its own voice."""
        return self.encoder(clip.heard[:1])[0]

    def says(self, speech: Tensor, seed: int = 0, sampling: Sampling | None = None) -> Tensor:
        """ARKit weights [T, 51] for speech features."""
        return self.codes.weights(sample(self.model, speech, seed, sampling))


def correlation(a: Tensor, b: Tensor) -> float:
    """Pearson's r."""
    return float(torch.corrcoef(torch.stack([a, b]))[0, 1])


def by_source(entries: list[EarClip], count: int, skipped: int = 0) -> dict[str, list[EarClip]]:
    """At most `count` held-out clips of each source, after `skipped` ones. Omits sources without clips."""
    sources = sorted({e.source for e in entries})
    groups = {s: [e for e in entries if e.source == s and e.held_out][skipped:][:count] for s in sources}
    return {source: group for source, group in groups.items() if group}


def agreement(speaker: Speaker, clips: dict[str, list[EarClip]], sampling: Sampling | None = None) -> dict:
    """r and slope of the lip gap, amplitude, and r of jawOpen, by source."""
    report = {}
    for source, group in clips.items():
        spoken = [speaker.says(speaker.heard(e), 0, sampling) for e in group]
        shown = [
            (landmarks_of(m), landmarks_of(e.motion.float())) for m, e in zip(spoken, group, strict=True)
        ]
        scores = feature_scores(shown)
        report[f"{source} gap r"], report[f"{source} slope"] = scores["gap r"], scores["gap slope"]
        report[f"{source} gap mm"] = 1e3 * float(torch.cat([lip_gap(m) for m, _ in shown]).std())
        pairs = [correlation(m[:, JAW], e.motion[:, JAW].float()) for m, e in zip(spoken, group, strict=True)]
        report[f"{source} jawOpen r"] = float(torch.tensor(pairs).nanmean())
    return report


def freetalk(arguments, clips: dict[str, list[EarClip]]) -> dict[str, float]:
    """r and slope of FreeTalk's lip gap on landmarks, and r of its chin with jawOpen, by source."""
    encoder, model = load_models(arguments.models)
    style = model.config.styles.index(model.config.default_style)
    report = {}
    for source, group in clips.items():
        spoken = []
        for e in group:
            with torch.no_grad():
                speech = encoder(e.heard[:1])[0]
            spoken.append(sample_motion(model, speech, neutral_affect(1, len(speech))[0], style))
        truth = [landmarks_of(e.motion.float()) for e in group]
        scores = feature_scores(list(zip(spoken, truth, strict=True)))
        report[f"{source} gap r"], report[f"{source} slope"] = scores["gap r"], scores["gap slope"]
        chins = [correlation(-m[:, 25], e.motion[:, JAW].float()) for m, e in zip(spoken, group, strict=True)]
        report[f"{source} chin against jawOpen r"] = float(torch.tensor(chins).nanmean())
    return report


def loudness(clips: dict[str, list[EarClip]]) -> dict[str, float]:
    """r of the level of each frame with the lip gap and with jawOpen."""
    report = {}
    for source, group in clips.items():
        gaps, jaws = [], []
        for e in group:
            level = e.mels[0].float().mean(1).unflatten(0, (-1, MEL_PER_FRAME)).mean(1)
            gaps.append(correlation(level, lip_gap(landmarks_of(e.motion.float()))))
            jaws.append(correlation(level, e.motion[:, JAW].float()))
        report[f"{source} gap r"] = float(torch.tensor(gaps).nanmean())
        report[f"{source} jawOpen r"] = float(torch.tensor(jaws).nanmean())
    return report


def seeds(speaker: Speaker, clips: list[EarClip], sampling: Sampling | None = None) -> dict[str, float]:
    """How much five seeds differ: deviation between them in mm, and r of their lip gaps."""
    upper, mouth, agreed = [], [], []
    for e in clips:
        speech = speaker.heard(e)
        shown = torch.stack([landmarks_of(speaker.says(speech, seed, sampling)) for seed in range(SEEDS)])
        apart = 1e3 * shown.unflatten(-1, (68, 3)).std(0).norm(dim=-1)
        upper.append(apart[:, UPPER].mean())
        gaps = lip_gap(shown)
        mouth.append(1e3 * gaps.std(0).mean())
        matrix = torch.corrcoef(gaps)
        agreed.append((matrix.sum() - SEEDS) / (SEEDS * (SEEDS - 1)))
    return {
        "brows and eyes mm": float(torch.stack(upper).mean()),
        "mouth opening mm": float(torch.stack(mouth).mean()),
        "gap r between seeds": float(torch.stack(agreed).mean()),
    }


def at_once(speaker: Speaker, clips: list[EarClip]) -> dict[str, float]:
    """Compares up to a minute sampled at once with the same sound in windows of two seconds.

    Returns r of the lip gap for both, and the drift of its mean.
    """
    speech = torch.cat([speaker.heard(e) for e in clips])[:LONG_FRAMES]
    truth = lip_gap(landmarks_of(torch.cat([e.motion.float() for e in clips])[:LONG_FRAMES]))
    whole = lip_gap(landmarks_of(speaker.says(speech)))
    parts = lip_gap(torch.cat([landmarks_of(speaker.says(p)) for p in speech.split(WINDOW_FRAMES)]))
    first, last = whole[: len(whole) // 3].mean(), whole[-(len(whole) // 3) :].mean()
    return {
        "seconds": len(speech) / speaker.model.config.fps,
        "r at once": correlation(whole, truth),
        "r in windows": correlation(parts, truth),
        "last third less first mm": 1e3 * float(last - first),
    }


def still(speaker: Speaker, clips: list[EarClip]) -> float:
    """RMS speed of landmarks that speech should not move, mm a second."""
    speeds = []
    for e in clips:
        shown = landmarks_of(speaker.says(speaker.heard(e))).unflatten(-1, (68, 3))[:, STILL]
        speeds.append(shown.diff(dim=0).norm(dim=-1).flatten())
    return 1e3 * speaker.model.config.fps * float(torch.cat(speeds).square().mean().sqrt())


def tell(name: str, row: dict[str, float]) -> None:
    """Prints one line."""
    print(f"{name}: " + ", ".join(f"{key} {value:.3f}" for key, value in row.items()), flush=True)


def from_landmarks(model: Denoiser, codes: Codes, clips, data: Path) -> dict[str, dict[str, float]]:
    """Error of the model that follows landmarks, as mean mm over vertices of ICT's face.

    Noise of each size in `OFF_MM` disturbs the landmarks of recordings, plain and with an emotion. Least
    squares and no motion are measured beside it.
    """
    modes = torch.from_numpy(load_ict(data, "face").mean.modes).float().flatten(1)
    random = torch.Generator().manual_seed(3)
    by_least_squares = torch.linalg.pinv(landmarks_of(torch.eye(len(modes))))
    distances = {name: {off: [] for off in OFF_MM} for name in ("by landmarks", "least squares", "no motion")}
    emotions = emotion_prototypes()
    for number, clip in enumerate([clip for group in clips.values() for clip in group]):
        for emotion, off in itertools.product((0.0, 1.0), OFF_MM):
            truth = (clip.motion.float() + emotion * emotions[number % len(emotions)]).clamp(0.0, 1.0)
            moved = landmarks_of(truth)
            moved = moved + 1e-3 * off * torch.randn(moved.shape, generator=random)
            predicted = codes.weights(sample(model, CM * moved))
            for name, weights in zip(
                distances, (predicted, moved @ by_least_squares, 0.0 * truth), strict=True
            ):
                apart = ((weights - truth) @ modes).unflatten(-1, (-1, 3)).norm(dim=-1)
                distances[name][off].append(1e3 * apart.mean().item())
    return {
        name: {f"vertices mm, landmarks off by {off}": mean(each) for off, each in rows.items()}
        for name, rows in distances.items()
    }


def held_out(arguments) -> dict[str, list[EarClip]]:
    """Held-out clips of the corpus folders if there are any, otherwise of the project's own sources."""
    entries = with_weights(list(ear.recorded(arguments, list(ear.LAYERS))), arguments)
    clips = by_source(entries, arguments.clips, arguments.skip)
    if not clips:
        folders = " ".join(str(path) for path in arguments.corpus)
        raise ValueError(
            f"--corpus {folders}: expected held-out clips (split val or test in clips.tsv), got none"
        )
    return clips


def main(line: list[str] | None = None) -> None:
    """EarClip of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", type=Path, default=shipped("facetalk_compact"))
    parser.add_argument("--head", type=Path, help="head.pt that --motion was trained with")
    parser.add_argument("--motion", type=Path, help="motion.pt instead of the folder's model")
    parser.add_argument(
        "--landmark-motion", type=Path, help="motion.pt of `--memory landmarks` instead of the folder's model"
    )
    parser.add_argument(
        "--runs", nargs="*", default=[], metavar="NAME=MOTION.PT", help="more runs to measure (table 2)"
    )
    parser.add_argument("--models", type=Path, help="folder of models; none: the embedded ones")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument(
        "--corpus", type=Path, nargs="*", default=[], help="corpus folders, instead of --data"
    )
    parser.add_argument("--clips", type=int, default=30, help="held-out clips of each source")
    parser.add_argument("--skip", type=int, default=0, help="held-out clips of each source to skip first")
    parser.add_argument("--temperature", type=float, help="temperature of every model, instead of its own")
    parser.add_argument("--steps", type=int, nargs="*", default=[1, 2, 4, 10, 25])
    arguments = parser.parse_args(line)
    torch.set_num_threads(1)
    encoder = load_ear(arguments.models / "ear" if arguments.models else SHIPPED_EAR)
    head, motions = (load_head(arguments.head), {}) if arguments.head else load_folder(arguments.model)
    model = load_motion(arguments.motion) if arguments.motion else motions["motion"]
    by_landmarks = motions.get("landmark_motion")
    if arguments.landmark_motion:
        by_landmarks = load_motion(arguments.landmark_motion)
    others = {name: load_motion(Path(path)) for name, _, path in (r.rpartition("=") for r in arguments.runs)}
    if arguments.temperature is not None:
        for one in (model, *others.values()):
            one.config.sampling.temperature = arguments.temperature
    speaker = Speaker(model, Codes(head), encoder)
    clips = held_out(arguments)
    first = next(clips[source] for source in ("grid_s1", *clips) if source in clips)
    if by_landmarks is not None and (arguments.landmark_motion or not arguments.corpus):
        for name, scores in from_landmarks(by_landmarks, speaker.codes, clips, arguments.data).items():
            tell(name, scores)
    tell("loudness", loudness(clips))
    tell("FreeTalk", freetalk(arguments, clips))
    usual = model.config.sampling
    silent = torch.zeros_like(speaker.heard(first[0]))
    quiet = lip_gap(landmarks_of(speaker.says(silent, 0, replace(usual, guidance=0.0))))
    print(f"no speech: lip gap's deviation {1e3 * quiet.std():.2f} mm")
    for w in GUIDANCES:
        tell(f"w {w}", agreement(speaker, clips, replace(usual, guidance=w)))
    for steps in arguments.steps:
        tell(f"{steps} steps", agreement(speaker, clips, replace(usual, steps=steps)))
    for r in (0.7, 1.0, 1.3):
        tell(f"vividness {r}", agreement(speaker, clips, replace(usual, vividness=r)))
    few = first[:10]
    tell("five seeds", seeds(speaker, few))
    tell("long sound", at_once(speaker, first))
    for name, run in others.items():
        other = Speaker(run, speaker.codes, encoder)
        scores = agreement(other, clips) | seeds(other, few) | {"still mm/s": still(other, few)}
        tell(name, scores)


if __name__ == "__main__":
    main()
