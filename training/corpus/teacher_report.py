"""What the teacher is worth on clips that its fit never saw."""

import json
from pathlib import Path

import numpy as np

from training.corpus.aligned import read_librivox, read_nathalie
from training.corpus.clip import FPS, Clip, inner_gap
from training.corpus.phones import Phone, bilabials
from training.corpus.teacher import Teacher

CLOSED_SHARE = 0.15


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


def closed_spans(gap: np.ndarray, phones: list[Phone]) -> list[bool]:
    """For each p, b and m: does the gap [T] fall under 15 % of its own 95th percentile inside?"""
    limit, seconds = CLOSED_SHARE * np.quantile(gap, 0.95), np.arange(len(gap)) / FPS
    inside = [gap[(seconds >= start) & (seconds <= end)] for start, end in bilabials(phones)]
    return [bool(span.min() < limit) for span in inside if len(span)]


def lip_gap_scores(motions: list[np.ndarray], clips: list[tuple[Clip, list[Phone]]]) -> dict[str, float]:
    """Made against recorded inner-lip gap, and how often each closes for p, b and m."""
    made = [m[:, 62, 1] - m[:, 66, 1] for m in motions]
    true = [c.motion[:, 62, 1] - c.motion[:, 66, 1] for c, _ in clips]
    a, b = np.concatenate(made), np.concatenate(true)
    rates = [
        np.mean([hit for (_, p), gap in zip(clips, gaps, strict=True) for hit in closed_spans(gap, p)])
        for gaps in (made, true)
    ]
    return {
        "r_pooled": correlation(a, b),
        "r_clip": float(np.mean([correlation(x, y) for x, y in zip(made, true, strict=True)])),
        "lag_frames": best_lag(a, b),
        "std_ratio": float(a.std() / b.std()),
        "bias_mm": float((a - b).mean() * 1e3),
        "closure": float(rates[0]),
        "closure_recorded": float(rates[1]),
    }


def other_scores(motions: list[np.ndarray], clips: list[tuple[Clip, list[Phone]]]) -> dict[str, float]:
    """Mean r per clip of other measures, and lip error in millimetres."""

    def mean_r(measure):
        pairs = [(measure(m), measure(c.motion)) for m, (c, _) in zip(motions, clips, strict=True)]
        return float(np.mean([correlation(x, y) for x, y in pairs]))

    errors = [
        np.linalg.norm((m - c.motion)[:, 48:68], axis=2).max(axis=1)
        for m, (c, _) in zip(motions, clips, strict=True)
    ]
    return {
        "width_r": mean_r(lambda m: m[:, 54, 0] - m[:, 48, 0]),
        "chin_r": mean_r(lambda m: -m[:, 8, 1]),
        "lip_error_mm": float(np.concatenate(errors).mean() * 1e3),
    }


def closure_elsewhere(teacher: Teacher, data: Path) -> dict[str, float]:
    """Share of p, b and m that close in speech without recorded motion."""
    found = {}
    for source, utterances in (("nathalie_nl", read_nathalie(data)), ("librivox_en", read_librivox(data))):
        hits = []
        for utterance in utterances:
            motion = teacher.motion(utterance.phones, len(utterance.samples) // 640)
            hits += closed_spans(motion[:, 62, 1] - motion[:, 66, 1], utterance.phones)
        found[f"closure_{source}"] = float(np.mean(hits))
    return found


def report(data: Path, out: Path, clips: list[tuple[Clip, list[Phone]]], fitted: Path) -> None:
    """Prints what the fit is worth, as it is and clear; saves `report.json` and a picture."""
    teachers = {"fitted": Teacher.load(fitted, clear=False), "clear": Teacher.load(fitted)}
    results = {}
    for name, teacher in teachers.items():
        motions = [teacher.motion(phones, len(clip.motion)) for clip, phones in clips]
        results[name] = lip_gap_scores(motions, clips) | other_scores(motions, clips)
        results[name] |= closure_elsewhere(teacher, data)
        print(name, "  ".join(f"{key} {value:.3f}" for key, value in results[name].items()))
    (out / "report.json").write_text(json.dumps(results, indent=1) + "\n")
    plot(teachers, clips[:: max(len(clips) // 4, 1)][:4], out / "gap.png")


def plot(teachers: dict[str, Teacher], clips: list[tuple[Clip, list[Phone]]], path: Path) -> None:
    """Gap of fit, clear speech and recording with the phones below."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(clips), 1, figsize=(15, 3.6 * len(clips)), squeeze=False)
    for axis, (clip, phones) in zip(axes[:, 0], clips, strict=True):
        seconds = np.arange(len(clip.motion)) / FPS
        axis.plot(
            seconds,
            (inner_gap(clip.motion, clip.neutral) - inner_gap(0 * clip.motion, clip.neutral)) * 1e3,
            "k",
        )
        for name, teacher in teachers.items():
            motion = teacher.motion(phones, len(clip.motion))
            axis.plot(seconds, (motion[:, 62, 1] - motion[:, 66, 1]) * 1e3, label=f"{name}, mm")
        for phone in phones:
            axis.text((phone.start_s + phone.end_s) / 2, -1.2, phone.label, ha="center", fontsize=8)
            axis.axvline(phone.start_s, color="0.9")
        axis.set_title(clip.name)
        axis.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=60)
    plt.close(figure)
