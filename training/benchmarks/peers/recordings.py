"""Recorded speech with the mouth's true motion. Peers are fitted to it, all predictors are judged on it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from training.corpus.action_units import runs
from training.corpus.aligned import Aligner, grid_words
from training.corpus.clip import FPS, Clip, inner_gap
from training.corpus.facegood import read_facegood
from training.corpus.grid import read_grid
from training.corpus.phones import Phone
from training.corpus.split import GRID_EVERY
from training.speech.log_mel import log_mel
from training.speech.strangers import loudness

FEATURES = ("gap", "width", "protrusion")
MM = 1000.0
CORNERS, MIDDLES = (48, 54), (51, 57)
FIT_CLIPS = 60
FIT_REMAINDER = 5
SAMPLES_PER_FRAME = 640
MELS_PER_FRAME = 4
LEAD_S = (0.04, 0.12)


@dataclass
class Recording:
    """Speech and the motion of its mouth: frame i is at second i / 25 of the sound.

    `samples` [S] at 16 kHz; `truth` [T, 3] mm, the `FEATURES`; `mel` [4 T, 64]; `judged` is the longest
    stretch of frames in which the tracker saw the face; `rest_mm` is the inner-lip gap of the face at rest;
    `text` and its `phones` are empty if the text is unknown.
    """

    name: str
    samples: np.ndarray
    truth: np.ndarray
    mel: torch.Tensor
    judged: slice
    rest_mm: float
    text: str
    phones: list[Phone]

    @property
    def level(self) -> torch.Tensor:
        """Loudness, [T] nepers."""
        return loudness(self.mel)

    def cut(self, first: int) -> "Recording":
        """The same recording, judged from frame `first` on."""
        return replace(self, judged=slice(max(first, self.judged.start), self.judged.stop))


def mouth_features(motion: np.ndarray, neutral: np.ndarray) -> np.ndarray:
    """The `FEATURES`, [T, 3] mm, of displacements [T, 68, 3] and a face at rest [68, 3], both in metres.

    Gap of the inner lips ‖62 − 66‖, width ‖48 − 54‖, protrusion (mean z of 51 and 57, from rest), as in
    `docs/measured/quality.md`.
    """
    left, right = (motion[:, n] + neutral[n] for n in CORNERS)
    width = np.linalg.norm(left - right, axis=1)
    forward = motion[:, list(MIDDLES), 2].mean(axis=1)
    return np.stack([inner_gap(motion, neutral), width, forward], axis=1) * MM


def recording(clip: Clip, name: str, text: str, phones: list[Phone]) -> Recording:
    """The recording of a corpus clip. Its sound is cut or padded with zeros to the length of the motion."""
    frames = len(clip.motion)
    room = frames * SAMPLES_PER_FRAME
    samples = np.pad(clip.samples[:room], (0, max(room - len(clip.samples), 0)))
    tracked_frames = torch.from_numpy(clip.weight.max(axis=1) > 0).int()
    first, end = max(runs(tracked_frames), key=lambda span: span[1] - span[0])
    return Recording(
        name=name,
        samples=samples,
        truth=mouth_features(clip.motion, clip.neutral),
        mel=log_mel(torch.from_numpy(samples))[: frames * MELS_PER_FRAME],
        judged=slice(first, end),
        rest_mm=float(inner_gap(np.zeros((1, 68, 3)), clip.neutral)[0] * MM),
        text=text,
        phones=phones,
    )


def grid(data: Path) -> tuple[list[Recording], list[Recording]]:
    """Sixty training clips of grid_s1, and the held-out ones; phones by pocketsphinx from the text."""
    clips = sorted(read_grid(data), key=lambda clip: clip.name)
    words, aligner = grid_words(data), Aligner()

    def of(chosen: list[Clip]) -> list[Recording]:
        texts = (" ".join(word for _, _, word in words[clip.name]) for clip in chosen)
        return [
            recording(c, c.name, t, aligner.align(c.samples, t)) for c, t in zip(chosen, texts, strict=True)
        ]

    return of(clips[FIT_REMAINDER::GRID_EVERY][:FIT_CLIPS]), of([clip for clip in clips if clip.held_out])


def facegood(data: Path) -> tuple[list[Recording], dict[str, int]]:
    """The whole takes, and the frame from which each is held out."""
    takes: dict[str, list[Clip]] = {}
    for clip in read_facegood(data):
        takes.setdefault(clip.name.split("/")[0], []).append(clip)
    whole, first = [], {}
    for name, parts in takes.items():
        parts = sorted(parts, key=lambda clip: clip.held_out)
        joined = {
            key: np.concatenate([getattr(p, key) for p in parts]) for key in ("samples", "motion", "weight")
        }
        whole.append(recording(replace(parts[0], **joined), name, "", []))
        first[name] = len(parts[0].motion)
    return whole, first


def closure_windows(phones: list[Phone]) -> list[tuple[float, float]]:
    """The windows in which lips have to meet for p, b and m: start and end in seconds.

    A window starts before the phone, by half of the preceding phone or pause (40 to 120 ms), and ends with
    the phone. Twin of `windows` in `tests/eval/src/quality/closures.rs`.
    """
    windows, before = [], None
    for phone in phones:
        if phone.label in ("P", "B", "M"):
            gap_s = phone.start_s - before.end_s if before else 0.0
            lead_s = gap_s if gap_s > 1e-3 else before.duration_s if before else 0.0
            windows.append((phone.start_s - float(np.clip(0.5 * lead_s, *LEAD_S)), phone.end_s))
        before = phone
    return windows


def smallest_gaps(gap: np.ndarray, windows: list[tuple[float, float]]) -> list[float]:
    """Smallest value of `gap` [T] within each window, in its unit. Windows without a frame are left out."""
    spans = [(max(int(np.ceil(a * FPS)), 0), int(np.floor(b * FPS)) + 1) for a, b in windows]
    return [float(gap[a:b].min()) for a, b in spans if a < min(b, len(gap))]
