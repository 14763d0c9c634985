"""Measures the phone recogniser and the alignment of texts on what `training.speech.train_phones` left out.

    python -m training.speech.evaluate_phones --model runs/phones

Beside every number of words stands the floor: letters spread evenly over the time of the true words,
whose first begin and last end are counted as right.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch

from training import shipped
from training.corpus.heard import Heard, load
from training.nn.checkpoint import read_model, restored
from training.speech.compact import load_encoder
from training.speech.letters import best_path, emissions, romanised, states_of, word_times
from training.speech.phones import CLASSES, COARSE, PhoneConfig, PhoneReadout, class_of_segment
from training.speech.train_phones import log_likelihood, rows_of

RATE_HZ = 100.0
FIRST_S = -0.02
WITHIN_S = (0.05, 0.1)


def read_phones(folder: Path) -> tuple[PhoneReadout, np.ndarray]:
    """The read-out and the table of letters of a model folder."""
    config, state = read_model(folder)
    config.pop("units")
    table = state.pop("table").double().numpy()
    return restored(PhoneReadout(PhoneConfig(**config)), state), table


@torch.no_grad()
def frame_scores(model: PhoneReadout, heard: list[Heard]) -> dict[str, float]:
    """Share of frames that get the right class, of all classes and of the coarser set."""
    coarse = torch.tensor([next(i for i, c in enumerate(COARSE) if s in c) for s in CLASSES])
    right, right_coarse = [], []
    for h in heard:
        wanted = rows_of(class_of_segment()[h.phones.long()])
        log_p = model(h.features[-1].float()[None])[0]
        said = wanted != 0
        right.append((log_p.argmax(dim=1) == wanted)[said])
        merged = torch.zeros(len(log_p), len(COARSE)).index_add(1, coarse, log_p.exp())
        right_coarse.append((merged.argmax(dim=1) == coarse[wanted])[said])
    return {"classes": _mean(right), "coarse": _mean(right_coarse)}


def _mean(parts) -> float:
    return float(torch.cat(parts).float().mean())


def align(model: PhoneReadout, table: np.ndarray, heard: Heard) -> dict[int, tuple[float, float]]:
    """Times of the words of an utterance, by their index."""
    words = [word for _, _, word in heard.words]
    states = states_of(words)
    likelihood = log_likelihood(model, heard.features[-1])
    path = best_path(emissions(likelihood, table, states), states.skip)
    return word_times(path, states, RATE_HZ, FIRST_S)


def spread_evenly(heard: Heard) -> dict[int, tuple[float, float]]:
    """The floor: letters spread evenly from the true begin of the first word to the end of the last."""
    begin, end = heard.words[0][0], heard.words[-1][1]
    lengths = np.array([max(1, len(romanised(word))) for _, _, word in heard.words])
    edges = begin + (end - begin) * np.concatenate([[0], np.cumsum(lengths)]) / lengths.sum()
    return {i: (edges[i], edges[i + 1]) for i in range(len(lengths))}


def word_scores(found: list[dict], heard: list[Heard]) -> dict[str, float]:
    """Median error of the boundaries of words in ms, and the share within 50 and 100 ms."""
    errors = []
    for times, h in zip(found, heard, strict=True):
        for index, (start, end, _) in enumerate(h.words):
            if index in times:
                errors += [times[index][0] - start, times[index][1] - end]
    far = np.abs(errors)
    shares = {f"within {1000 * x:.0f} ms": float(np.mean(far <= x)) for x in WITHIN_S}
    return {"median ms": 1000 * float(np.median(far)), **shares, "words": len(errors) // 2}


def measure(model: PhoneReadout, table: np.ndarray, every: list[Heard]) -> dict:
    """Scores of all that is held out, by source."""
    report = {}
    held_out = [h for h in every if h.held_out]
    for source in sorted({h.source for h in held_out}):
        chosen = [h for h in held_out if h.source == source]
        row = {}
        if chosen[0].phones is not None:
            row["frames"] = frame_scores(model, chosen)
        if chosen[0].words:
            row["words"] = word_scores([align(model, table, h) for h in chosen], chosen)
            row["evenly"] = word_scores([spread_evenly(h) for h in chosen], chosen)
        if row:
            report[source] = row
    return report


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--model", type=Path, default=shipped("phones"))
    parser.add_argument("--encoder", type=Path, default=shipped("compact_speech"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--minutes", type=float, default=3.0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    encoder = load_encoder(arguments.encoder)
    every = load(arguments.data, arguments.cache, encoder, arguments.minutes)
    for source, row in measure(*read_phones(arguments.model), every).items():
        print(source, json.dumps(row))


if __name__ == "__main__":
    main()
