"""Phones of speech without transcribed times, read by a trained speech encoder.

A first run of `training.speech.train` gives log-posteriors at 100 Hz. If the text is known (kerstin_de),
espeak-ng turns it into phones, which are aligned to the log-posteriors. If it is not (picovoice_en, more than
50 speakers), the likeliest sequence is used. Both use Viterbi's algorithm (1967).
"""

from pathlib import Path

import numpy as np
import torch

from training.corpus.aligned import Utterance, read_texts, read_unlabelled
from training.corpus.clip import MEL_PER_FRAME
from training.corpus.espeak import Espeak
from training.corpus.phones import PAUSE, SEGMENTS, Phone, split
from training.speech.compact import CompactConfig, CompactEncoder, normalise
from training.speech.log_mel import log_mel
from training.speech.targets import PhoneHead

HZ = 100.0
SWITCH_COST = 3.0
SKIP_COST = 6.0
LEAST_DECODED, LEAST_ALIGNED = -1.1, -2.2
"""A recording is used only if the mean log-posterior of its path exceeds this.

The first bound is for speech without text (`decode`), the second for known text (`align`).
"""


class PhoneReader:
    """The encoder of a finished run with its phone read-out."""

    def __init__(self, run: Path):
        saved = torch.load(run)
        config = CompactConfig(**saved["config"])
        self.encoder, self.head = CompactEncoder(config).eval(), PhoneHead(config.channels)
        for module, prefix in ((self.encoder, "encoder."), (self.head, "phones.")):
            state = {k.removeprefix(prefix): v for k, v in saved["state"].items() if k.startswith(prefix)}
            module.load_state_dict(state)

    @torch.no_grad()
    def log_posteriors(self, samples: np.ndarray) -> np.ndarray:
        """Log-posteriors of samples [S] at 100 Hz, [T, segments]: four passes, each one mel frame later."""
        mel = normalise(log_mel(torch.from_numpy(samples)))
        frames = len(mel) // MEL_PER_FRAME
        passes = []
        for shift in range(MEL_PER_FRAME):
            late = torch.cat([mel[shift:], mel[-1:].expand(shift, -1)])
            logits = self.head.readout(self.encoder(late[None])[0])
            passes.append(logits.log_softmax(dim=-1)[:frames])
        return torch.stack(passes, dim=1).flatten(0, 1).numpy()


def decode(log_p: np.ndarray) -> tuple[list[Phone], float]:
    """The likeliest segments if each change costs `SWITCH_COST`, and their mean log-posterior."""
    frames, classes = log_p.shape
    score, back = log_p[0].copy(), np.zeros((frames, classes), np.int32)
    for t in range(1, frames):
        best = int(score.argmax())
        moved = score[best] - SWITCH_COST
        back[t] = np.where(score >= moved, np.arange(classes), best)
        score = np.maximum(score, moved) + log_p[t]
    path = np.empty(frames, np.int32)
    path[-1] = score.argmax()
    for t in range(frames - 1, 0, -1):
        path[t - 1] = back[t, path[t]]
    return _runs(path, [SEGMENTS[i] for i in path]), float(log_p[np.arange(frames), path].mean())


def align(log_p: np.ndarray, sequence: list[str]) -> tuple[list[Phone], float]:
    """The segments of `sequence` in order, with optional pauses between them; one segment may be skipped."""
    states = [PAUSE]
    for segment in sequence:
        states += [segment, PAUSE] if segment != PAUSE else []
    emission = log_p[:, [SEGMENTS.index(s) for s in states]]
    frames, count = emission.shape
    score, back = np.full(count, -np.inf), np.zeros((frames, count), np.int32)
    score[:2] = emission[0, :2]
    price = np.array([0.0, 0.0, 0.0, SKIP_COST, SKIP_COST])
    for t in range(1, frames):
        moves = np.stack([np.concatenate([np.full(k, -np.inf), score])[:count] for k in range(5)])
        moves[2, 0::2] = -np.inf
        moves = moves - price[:, None]
        step = moves.argmax(axis=0)
        back[t] = np.arange(count) - step
        score = moves.max(axis=0) + emission[t]
    path = np.empty(frames, np.int32)
    path[-1] = count - 1 if score[-1] > score[-2] else count - 2
    for t in range(frames - 1, 0, -1):
        path[t - 1] = back[t, path[t]]
    return _runs(path, [states[i] for i in path]), float(emission[np.arange(frames), path].mean())


def _runs(path: np.ndarray, labels: list[str]) -> list[Phone]:
    edges = [0, *(np.flatnonzero(np.diff(path)) + 1).tolist(), len(path)]
    return [Phone(a / HZ, (b - a) / HZ, labels[a]) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def read_kerstin(data: Path, reader: PhoneReader, espeak: Espeak) -> list[Utterance]:
    """German of one woman: espeak-ng's phones for the text, timed by the recording."""
    texts = read_texts(data / "speech/kerstin_de")
    utterances = []
    for utterance in read_unlabelled(data, "kerstin_de"):
        if utterance.name not in texts:
            continue
        _, spoken = espeak.speak(texts[utterance.name], "de")
        sequence = [part for phone in spoken for _, _, part in split(phone)]
        phones, confidence = align(reader.log_posteriors(utterance.samples), sequence)
        if confidence > LEAST_ALIGNED:
            utterance.phones = phones
            utterances.append(utterance)
    return utterances


def read_picovoice(data: Path, reader: PhoneReader) -> list[Utterance]:
    """English of many speakers without text: only the recordings that the reader is sure of."""
    utterances = []
    for utterance in read_unlabelled(data, "picovoice_en"):
        utterance.phones, confidence = decode(reader.log_posteriors(utterance.samples))
        if confidence > LEAST_DECODED:
            utterances.append(utterance)
    return utterances
