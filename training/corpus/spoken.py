"""Speech without a face: recordings with known phones, and seventeen languages spoken by espeak-ng.

It teaches the ear in every voice. `training.corpus.ear` adds the motion of a co-articulation teacher (source
`taught`).
"""

from pathlib import Path

import torch

from training.corpus.aligned import Utterance, read_kathleen, read_kokoro, read_nathalie, read_texts
from training.corpus.bank import MEL_HZ, Entry
from training.corpus.clip import FPS, MEL_PER_FRAME, fit_frames
from training.corpus.phones import segment_track
from training.speech.log_mel import log_mel

SOURCE = "taught"
TEXTS = {"en-us": "kathleen_en", "en-gb-scotland": "kathleen_en", "de": "kerstin_de", "nl": "nathalie_nl"}
RECORDED = {"nathalie_nl": read_nathalie, "kathleen_en": read_kathleen, "kokoro": read_kokoro}


def texts_of(data: Path, language: str) -> list[str]:
    """Texts of recorded speech that espeak-ng says in a language in addition to its own sentences."""
    source = TEXTS.get(language)
    return list(read_texts(data / "speech" / source).values()) if source else []


def entry(utterance: Utterance) -> Entry:
    """One utterance ready for training, without motion. Its name starts with its source."""
    mel = log_mel(torch.from_numpy(utterance.samples))
    frames = max(len(utterance.samples) * int(FPS) // 16000, 1)
    phones = segment_track(utterance.phones, MEL_PER_FRAME * frames, MEL_HZ)
    still = torch.zeros(1, 204).expand(frames, 204)
    return Entry(
        f"{utterance.source}/{utterance.name}",
        SOURCE,
        utterance.held_out,
        fit_frames(mel, MEL_PER_FRAME * frames).half()[None],
        still,
        still,
        torch.from_numpy(phones),
    )
