"""Measures the phone recogniser and the alignment of texts on the speech held out by the training.

    python -m training.speech.evaluate_phones --model runs/phones

Each score of words comes with a baseline, `evenly`: it spreads the letters evenly from the true start of the
first word to the true end of the last. Those two boundaries count as right. `training.speech.train_phones`
trains the model.
"""

import json
from pathlib import Path

import numpy as np
import torch

from training import DATA, shipped
from training.corpus.action_units import runs
from training.corpus.heard import Heard, load
from training.flags import run_command
from training.nn.checkpoint import read_model, restored
from training.speech.ear import Ear
from training.speech.letters import best_path, emissions, romanised, states_of, word_times
from training.speech.phones import CLASSES, COARSE, PhoneConfig, PhoneReadout, class_of_segment
from training.speech.train_phones import log_likelihood, rows_of

PHONES = shipped("phones")
RATE_HZ = 100.0
FIRST_S = -0.02
WITHIN_S = (0.04, 0.1)
CONTACTS = {"p b m": "pbm", "f v": "fv", "rounded": "uwyʊoɔ", "th": "θð", "s z sh": "szʃʒ"}
"""Groups of classes that a viewer sees on the lips."""
SURE, NEAR_S = 0.5, 0.04
"""Probability from which a group counts as heard, and by how many seconds its times may be off."""


def read_phones(folder: Path) -> tuple[PhoneReadout, np.ndarray]:
    """Loads the read-out and the table of letters from a model folder."""
    config, state = read_model(folder)
    config.pop("units")
    table = state.pop("table").double().numpy()
    return restored(PhoneReadout(PhoneConfig(**config)), state), table


@torch.no_grad()
def frame_scores(model: PhoneReadout, heard: list[Heard]) -> dict[str, float]:
    """Share of spoken frames that get the right class, among all classes and in the coarser set."""
    coarse = torch.tensor([next(i for i, c in enumerate(COARSE) if s in c) for s in CLASSES])
    right, right_coarse = [], []
    for h in heard:
        true_classes = rows_of(class_of_segment()[h.phones.long()])
        log_p = model(h.features[-1].float()[None])[0]
        said = true_classes != 0
        right.append((log_p.argmax(dim=1) == true_classes)[said])
        merged = torch.zeros(len(log_p), len(COARSE)).index_add(1, coarse, log_p.exp())
        right_coarse.append((merged.argmax(dim=1) == coarse[true_classes])[said])
    return {"classes": _mean(right), "coarse": _mean(right_coarse)}


@torch.no_grad()
def contact_scores(model: PhoneReadout, heard: list[Heard]) -> dict[str, dict[str, float]]:
    """Precision and recall of the sounds that a viewer sees on the lips, by group of classes, and false ones
    a minute. A run of rows over `SURE` is one sound; it is true if a phone of the group lies within `NEAR_S`.
    """
    report = {}
    for name, signs in CONTACTS.items():
        said = met = shown = true = seconds = 0
        columns = [index for index, sign in enumerate(CLASSES) if sign in signs]
        for h in heard:
            classes = rows_of(class_of_segment()[h.phones.long()])
            is_said = torch.isin(classes, torch.tensor(columns))
            is_shown = model(h.features[-1].float()[None])[0].exp()[:, columns].sum(dim=1) > SURE
            said_runs, shown_runs = runs(is_said.int()), runs(is_shown.int())
            said, shown = said + len(said_runs), shown + len(shown_runs)
            met += _overlaps(said_runs, is_shown)
            true += _overlaps(shown_runs, is_said)
            seconds += len(classes) / RATE_HZ
        report[name] = {
            "precision": true / max(shown, 1), "recall": met / max(said, 1), "said": said,
            "false a minute": 60.0 * (shown - true) / max(seconds, 1e-9),
        }  # fmt: skip
    return report


def _overlaps(spans: list[tuple[int, int]], other: torch.Tensor) -> int:
    """How many spans of rows lie within `NEAR_S` of a row of `other` [T] bool."""
    near = round(NEAR_S * RATE_HZ)
    return sum(bool(other[max(first - near, 0) : end + near].any()) for first, end in spans)


def _mean(parts) -> float:
    return float(torch.cat(parts).float().mean())


def align(model: PhoneReadout, table: np.ndarray, heard: Heard) -> dict[int, tuple[float, float]]:
    """Start and end in seconds of the words of an utterance, by word index."""
    words = [word for _, _, word in heard.words]
    states = states_of(words)
    likelihood = log_likelihood(model, heard.features[-1])
    path = best_path(emissions(likelihood, table, states), states.skip)
    return word_times(path, states, RATE_HZ, FIRST_S)


def spread_evenly(heard: Heard) -> dict[int, tuple[float, float]]:
    """The baseline: spreads letters evenly from the true start of the first word to the end of the last."""
    begin, end = heard.words[0][0], heard.words[-1][1]
    lengths = np.array([max(1, len(romanised(word))) for _, _, word in heard.words])
    edges = begin + (end - begin) * np.concatenate([[0], np.cumsum(lengths)]) / lengths.sum()
    return {i: (edges[i], edges[i + 1]) for i in range(len(lengths))}


def word_scores(predicted_times: list[dict], heard: list[Heard]) -> dict[str, float]:
    """Median error of word boundaries in ms, and the share of boundaries within 50 and 100 ms."""
    errors = []
    for times, h in zip(predicted_times, heard, strict=True):
        for index, (start, end, _) in enumerate(h.words):
            if index in times:
                errors += [times[index][0] - start, times[index][1] - end]
    far = np.abs(errors)
    shares = {f"within {1000 * x:.0f} ms": float(np.mean(far <= x)) for x in WITHIN_S}
    return {"median ms": 1000 * float(np.median(far)), **shares, "words": len(errors) // 2}


def measure(model: PhoneReadout, table: np.ndarray, every: list[Heard]) -> dict:
    """Scores of all held-out utterances, by source."""
    report = {}
    held_out = [h for h in every if h.held_out]
    for source in sorted({h.source for h in held_out}):
        chosen = [h for h in held_out if h.source == source]
        row = {}
        if chosen[0].phones is not None:
            row["frames"] = frame_scores(model, chosen)
            row["contacts"] = contact_scores(model, chosen)
        if chosen[0].words:
            row["words"] = word_scores([align(model, table, h) for h in chosen], chosen)
            row["evenly"] = word_scores([spread_evenly(h) for h in chosen], chosen)
        if row:
            report[source] = row
    return report


def main(
    data: Path = DATA,
    model: Path = PHONES,
    cache: Path = Path("runs/cache"),
    minutes: float = 3.0,
) -> None:
    """Command line."""
    torch.set_num_threads(1)
    every = load(data, cache, Ear(), minutes)
    for source, row in measure(*read_phones(model), every).items():
        print(source, json.dumps(row))


if __name__ == "__main__":
    run_command(main)
