"""Measures EmoFace's branches and its Mesh Attention on held-out actors.

    python -m training.systems.emoface.evaluate --data ../shared/data

Measures the shipped model, or the runs and model folders that `--run` names. A model performs every sentence
of emodb_de's held-out actors from rest, with the emotion of its own voice. No faces of these recordings
exist, so the truth is the teacher's face with the labelled emotion. Then the model performs the same sentence
with the emotion of another recording. Errors are in mm on the template: √LVE over the vertices around the
lips, √EVE over those above the middle of the nose (metrics as in `docs/measuring.md`). Nothing is random.
`--limit 100` reads fewer training clips and all held-out ones, and takes minutes less.

    python -m training.systems.emoface.evaluate --corpus DIR --run runs/emoface/emoface.pt

This command scores held-out clips of a corpus folder instead, against their own vertices (`folder_scores`).
The command line names the encoders as in training. If the run trained its encoders, those in its folder
`models` are used instead.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from training import shipped
from training.corpus.emodb import SOURCE as EMODB
from training.corpus.emotion_weights import with_emotion
from training.corpus.faces import load_ict
from training.losses import lip_gap
from training.systems.cafe_talk.train import lips_met
from training.systems.emoface import folder_scores
from training.systems.emoface.clips import load_clips
from training.systems.emoface.emotion_encoder import HEARD_EMOTIONS
from training.systems.emoface.folder_scores import face_of, regions
from training.systems.emoface.model import CONFIGS, EmoFace, FaceMotion
from training.systems.emoface.rows import Spoken, mixture
from training.systems.emoface.train import parser as training_parser
from training.systems.emoface.train import performed, together

TAUGHT = 8
"""Number of sentences on which `taught` measures the emotions."""
SAME_M = 1e-6
"""A vertex of the template and one of ICT's face are the same if they lie closer than this."""
CROSSED = 3
"""Most recordings of other emotions that each sentence is combined with."""


@dataclass
class Judged:
    """A model with `modes` [51, D] in metres, and the numbers of its `lips` and `upper` vertices."""

    model: EmoFace
    modes: Tensor
    lips: np.ndarray
    upper: np.ndarray

    def truth(self, clip: Spoken, emotion: Spoken | None = None) -> Tensor:
        """True displacements [T, V, 3] in metres for the clip's speech.

        They show the clip's own labelled emotion, or that of another clip.
        """
        one = emotion or clip
        frames = len(clip)
        emotion, share = mixture(one).expand(frames, -1), torch.full((frames,), one.share)
        spoken = clip.weights.float()
        return (with_emotion(spoken, emotion, share, lips_met(spoken)) @ self.modes).unflatten(-1, (-1, 3))

    def metres(self, motion: Tensor) -> Tensor:
        """[1, T, D] in units of the model → [T, V, 3] metres."""
        return motion[0].unflatten(-1, (-1, 3)) * self.model.config.scale_m


def opened(run: Path, data: Path) -> Judged:
    """Loads the emoface.pt of a run, or a model folder.

    Looks the template's vertices up in ICT's face. A template that is chosen again may number them otherwise.
    """
    model, saved = face_of(run)
    vertices, face = saved["vertices"].double().numpy(), load_ict(data, "face").mean
    apart, chosen = cKDTree(face.vertices).query(vertices)
    if apart.max() > SAME_M:
        raise ValueError(f"{run}: expected vertices of ICT's face, got one {1e3 * apart.max():.3g} mm off")
    modes = torch.from_numpy(face.modes[:, chosen]).float().flatten(1)
    return Judged(model, modes, *regions(vertices, np.array(model.config.landmarks)))


def largest_mm(predicted: Tensor, truth: Tensor, among: np.ndarray) -> float:
    """Mean over frames of the largest squared error among some vertices, mm²."""
    apart = ((predicted - truth)[:, among] * 1e3).pow(2).sum(dim=-1)
    return float(apart.max(dim=1).values.mean())


def branches(judged: Judged, clips: list[Spoken]) -> dict[str, tuple[float, float]]:
    """√LVE and √EVE of the whole, of each branch, of their sum and of no motion."""
    sums: dict[str, list[tuple[float, float]]] = {}
    for clip in clips:
        truth, whole = judged.truth(clip), performed(judged.model, clip)
        alone = {
            layer: getattr(performed(judged.model, clip, layer), layer) for layer in ("content", "emotion")
        }
        rows = {
            "no motion": torch.zeros_like(truth),
            "content branch": judged.metres(alone["content"]),
            "emotion branch": judged.metres(alone["emotion"]),
            "their sum": judged.metres(whole.content + whole.emotion),
            "under the mask": judged.metres(whole.motion),
        }
        for name, values in rows.items():
            errors = largest_mm(values, truth, judged.lips), largest_mm(values, truth, judged.upper)
            sums.setdefault(name, []).append(errors)
    return {name: tuple(np.sqrt(np.mean(values, axis=0))) for name, values in sums.items()}


@torch.no_grad()
def emotion_of(judged: Judged, clip: Spoken, other: Spoken) -> FaceMotion:
    """Performs a sentence with the emotion of another recording, stretched to the sentence's length."""
    inputs = together([clip], judged.model.config, len(clip))
    at = np.linspace(0.2 * (len(other) - 1), len(other) - 1, len(clip)).round().astype(int)
    inputs.emotion = other.emotion[at].float()[None]
    return judged.model.perform(inputs)


def crossed(judged: Judged, clips: list[Spoken]) -> dict[str, float]:
    """How often a face shows the other recording's labelled emotion, and how its lips follow its own take.

    The teacher makes this sentence's face for each of the seven emotions. A face counts as the emotion whose
    teacher's face is nearest in the mean over vertices and frames. So our own tables judge this, not people.
    The lips are compared by r of the lip gap.
    """
    right, heard, agreement = [], [], []
    for n, clip in enumerate(clips):
        own_take = performed(judged.model, clip)
        others = [c for c in clips if c.name[:2] == clip.name[:2] and c.label != clip.label]
        for other in others[n % 7 :: max(1, len(others) // CROSSED)][:CROSSED]:
            mixed_take = emotion_of(judged, clip, other)
            motion = judged.metres(mixed_take.motion)
            label = {
                f: Spoken("", "", True, [], clip.emotion, clip.weights, f, other.share)
                for f in HEARD_EMOTIONS
            }
            apart = {
                f: float((motion - judged.truth(clip, one)).norm(dim=-1).mean()) for f, one in label.items()
            }
            right.append(min(apart, key=apart.get) == other.label)
            shares = other.emotion[len(other) // 2 :, -len(HEARD_EMOTIONS) :].float().mean(dim=0)
            heard.append(HEARD_EMOTIONS[int(shares.argmax())] == other.label)
            agreement.append(_gap_r(judged, own_take, mixed_take))
    return {
        "face of the other recording's emotion": float(np.mean(right)),
        "where the encoder classifies that right": float(np.mean(np.array(right)[np.array(heard)])),
        "classified right": float(np.mean(heard)),
        "lip gap r with the own take": float(np.mean(agreement)),
    }


def _gap_r(judged: Judged, one: FaceMotion, two: FaceMotion) -> float:
    at = judged.model.config.landmarks
    gaps = [lip_gap(judged.metres(x.motion)[:, at].flatten(1)).numpy() for x in (one, two)]
    return float(np.corrcoef(*gaps)[0, 1])


def taught(judged: Judged, clips: list[Spoken]) -> dict[str, tuple[float, float]]:
    """How strongly each taught emotion shows when its mean features are the input.

    Compares the offset from the neutral face with the teacher's offset, both averaged over the frames of a
    clip. Returns the slope by least squares, and the cosine.
    """
    out = {}
    neutral = [_under_label(judged, clip, HEARD_EMOTIONS[0]) for clip in clips]
    for emotion in HEARD_EMOTIONS[1:]:
        pairs = []
        for clip, (neutral_motion, truth) in zip(clips, neutral, strict=True):
            predicted, meant = _under_label(judged, clip, emotion)
            pairs.append((predicted - neutral_motion, meant - truth))
        predicted, meant = (torch.cat([pair[k].flatten() for pair in pairs]) for k in (0, 1))
        along = predicted @ meant
        out[emotion] = float(along / (meant @ meant)), float(along / (predicted.norm() * meant.norm()))
    return out


@torch.no_grad()
def _under_label(judged: Judged, clip: Spoken, emotion: str) -> tuple[Tensor, Tensor]:
    """Mean faces [V, 3] in metres, predicted and true, of a sentence with the given emotion."""
    inputs = together([clip], judged.model.config, len(clip))
    inputs.emotion = judged.model.prototypes[HEARD_EMOTIONS.index(emotion)].expand(1, len(clip), -1)
    label = Spoken("", "", True, [], clip.emotion, clip.weights, emotion)
    return judged.metres(judged.model.perform(inputs).motion).mean(dim=0), judged.truth(clip, label).mean(
        dim=0
    )


def recorded(judged: Judged, clips: list[Spoken]) -> dict[str, float]:
    """√LVE in mm on held-out clips of recorded neutral speech."""
    out = {}
    for source in sorted({c.source for c in clips}):
        errors = []
        for clip in (c for c in clips if c.source == source):
            predicted = judged.metres(performed(judged.model, clip).motion)
            errors.append(largest_mm(predicted, judged.truth(clip), judged.lips))
        out[source] = float(np.sqrt(np.mean(errors)))
    return out


def masks(judged: Judged, clips: list[Spoken]) -> dict[str, float]:
    """Mean of w over frames at the mouth, the jaw and the eyes: the paper's figure 4 in three numbers."""
    at = judged.model.config.landmarks
    regions = {"mouth": at[48:], "jaw": at[4:13], "eyes and brows": at[17:27] + at[36:48]}
    mask = torch.stack([performed(judged.model, clip).mask[0].mean(dim=0) for clip in clips]).mean(dim=0)
    return {name: float(mask[places].mean()) for name, places in regions.items()}


def parser() -> argparse.ArgumentParser:
    """Command line: the flags of training, plus the runs to measure and the number of clips."""
    parser = training_parser()
    parser.description = __doc__.splitlines()[0]
    parser.add_argument(
        "--run",
        type=Path,
        action="append",
        help="emoface.pt or model folder, by default the shipped one; may be repeated",
    )
    parser.add_argument(
        "--clips", type=int, default=1000, help="most emotional clips to measure, evenly drawn"
    )
    return parser


def main() -> None:
    """Command line."""
    arguments = parser().parse_args()
    torch.set_num_threads(arguments.threads)
    runs = arguments.run or [shipped("emoface_compact")]
    if arguments.corpus:
        for run in runs:
            print(run)
            for line in folder_scores.lines(run, arguments):
                print(f"  {line}")
        return
    held_out = [c for c in load_clips(arguments, CONFIGS[arguments.config]()) if c.held_out]
    emotional = [c for c in held_out if c.source == EMODB]
    emotional = emotional[:: max(1, len(emotional) // arguments.clips)][: arguments.clips]
    spoken = [c for s in ("grid_s1", "facegood_zh") for c in [c for c in held_out if c.source == s][:24]]
    for run in runs:
        judged = opened(run, arguments.data)
        parameters = sum(x.numel() for x in judged.model.parameters())
        print(f"{run}: {parameters / 1e6:.2f} million parameters, {len(emotional)} acted sentences")
        for name, (lips, upper) in branches(judged, emotional).items():
            print(f"  {name:16s} √LVE {lips:.2f} mm, √EVE {upper:.2f} mm")
        for name, (slope, cosine) in taught(judged, emotional[:: max(1, len(emotional) // TAUGHT)]).items():
            print(f"  {name:16s} slope {slope:.2f}, cosine {cosine:.2f}")
        for numbers in (recorded(judged, spoken), masks(judged, emotional), crossed(judged, emotional)):
            print("  " + ", ".join(f"{name} {value:.3f}" for name, value in numbers.items()))


if __name__ == "__main__":
    main()
