"""Reports what a corpus folder holds, what is odd in it, and what it can train.

Errors stop training. Odd things do not, but are worth a look. Speech opens the lips, so the opening of the
inner lips follows the loudness of the sound. The lag with the best correlation reveals a shift. If the lag
changes from the first third of a clip to the last, sound and motion drift apart.
"""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from training.align import canonical_landmarks, similarity, stability
from training.corpus.checked import CorpusError
from training.corpus.clip import inner_gap
from training.corpus.folder import SOUNDS, CorpusFolder, Row
from training.corpus.folder_clips import INNER, loudness, observed, without_head
from training.corpus.tracks import SOUND_HZ, Track

LAG_HZ = 50.0
LONGEST_LAG_S = 0.6
SHIFT_S = 0.14
DRIFT_S = 0.1
DRIFT_FROM_S = 9.0
SURE_R = 0.3
"""A lag counts only if lip gap and loudness correlate by more than this at that lag."""
FACE_WIDTH_M = (0.09, 0.2)
"""Least and greatest distance of landmarks 0 and 16 on people, children included, in metres."""
LENGTH_S = 0.3
FROZEN_S = 0.2
LOST_SHARE = 0.05
LOUD_DBFS = -50.0
CLIPPED_SHARE = 1e-3
GREATEST_WEIGHT = 2.0


@dataclass
class Report:
    """Result of a check. `errors` and `odd` are sentences, `seconds` is by split, `kinds` counts clips."""

    errors: list[str] = field(default_factory=list)
    odd: list[str] = field(default_factory=list)
    seconds: Counter = field(default_factory=Counter)
    kinds: Counter = field(default_factory=Counter)
    emotions: Counter = field(default_factory=Counter)
    lags_s: list[float] = field(default_factory=list)
    speakers: set[str] = field(default_factory=set)
    head_moves: bool = False

    def sentences(self) -> list[str]:
        """The whole report."""
        parts = [f"{self.seconds[s] / 60:.1f} minutes {s}" for s in ("train", "val", "test")]
        kinds = ", ".join(f"{count} with {kind}" for kind, count in sorted(self.kinds.items()))
        lines = [f"{len(self.speakers)} speakers, {', '.join(parts)}; {kinds or 'nothing beside sound'}"]
        if self.emotions:
            lines.append("emotions: " + ", ".join(f"{n} {e}" for e, n in self.emotions.most_common()))
        if self.lags_s:
            lag = 1e3 * float(np.median(self.lags_s))
            lines.append(f"lips against sound: {lag:+.0f} ms in the median of {len(self.lags_s)} clips")
        lines += [f"ERROR {error}" for error in self.errors] + [f"odd: {odd}" for odd in self.odd]
        return lines + [f"can train: {', '.join(trains(self)) or 'nothing'}"]


def trains(report: Report) -> list[str]:
    """Which trainers can use the folder."""
    if report.errors or not report.seconds["train"]:
        return []
    trainers = []
    if any(report.kinds[kind] for kind in ("landmarks", "weights", "vertices")):
        trainers.append("systems.freetalk.train (sound to landmarks)")
    if report.kinds["vertices"] and not report.head_moves:
        trainers.append("systems.freetalk.stm.train (landmarks to mesh)")
    return trainers


def check(path: Path) -> Report:
    """Checks the whole folder. An error in one clip does not hide errors in the next."""
    report = Report()
    try:
        folder = CorpusFolder(path)
    except CorpusError as error:
        report.errors.append(str(error))
        return report
    report.head_moves = folder.head_moves
    for row in folder.rows:
        try:
            _check_clip(folder, row, report)
        except CorpusError as error:
            report.errors.append(str(error))
    _check_whole(folder, report)
    return report


def _check_clip(folder: CorpusFolder, row: Row, report: Report) -> None:
    samples = folder.sound(row)
    report.seconds[row.split] += len(samples) / SOUND_HZ
    report.speakers.add(row.speaker)
    report.emotions[row.emotion] += 1
    odd = [*sound_oddities(samples), *label_oddities(row)]
    phones = folder.phones(row)
    if phones is not None:
        report.kinds["phones"] += 1
        if phones and phones[-1].end_s > len(samples) / SOUND_HZ + LENGTH_S:
            odd.append(f"phones end at {phones[-1].end_s:.2f} s, the sound at {len(samples) / SOUND_HZ:.2f}")
    for kind in ("landmarks", "vertices", "weights"):
        track = getattr(folder, kind)(row)
        if track is not None:
            report.kinds[kind] += 1
            odd += [f"{kind}: {text}" for text in time_oddities(track, len(samples) / SOUND_HZ)]
            if kind == "weights":
                odd += weight_oddities(track)
    track = observed(folder, row)
    if track is not None and track.tracked_frames.sum() > 2:
        odd += _face_oddities(folder, row, track, samples, report)
    report.odd += [f"{row.clip}: {text}" for text in odd]


def _face_oddities(folder: CorpusFolder, row: Row, track: Track, samples, report: Report) -> list[str]:
    shape = track.values[track.tracked_frames].mean(axis=0) if track.neutral is None else track.neutral
    odd = shape_oddities(shape)
    gap = inner_gap(track.values, np.zeros((68, 3)))
    lags = [lag_of(gap, track, samples, span) for span in ((0.0, 1.0), (0.0, 0.34), (0.66, 1.0))]
    whole, first, last = lags
    if whole is not None:
        report.lags_s.append(whole)
        if abs(whole) > SHIFT_S:
            odd.append(f"lips come {abs(whole):.2f} s {'after' if whole > 0 else 'before'} the sound")
    long_enough = len(samples) / SOUND_HZ >= DRIFT_FROM_S
    if long_enough and None not in (first, last) and abs(last - first) > DRIFT_S:
        odd.append(f"drifts: lips {first:+.2f} s against the sound at first, {last:+.2f} s in the end")
    if not folder.head_moves and not track.names and turned_degrees(track, shape) > 3.0:
        odd.append(f"head turns by {turned_degrees(track, shape):.0f} degrees, corpus.json says it is still")
    return odd


def label_oddities(row: Row) -> list[str]:
    """Labels that name an emotion but give it intensity 0."""
    if row.emotion not in ("neutral", "unknown") and row.intensity == 0.0:
        return [f"emotion {row.emotion} with intensity 0 is trained as neutral"]
    return []


def sound_oddities(samples: np.ndarray) -> list[str]:
    """Silence and clipping."""
    level = 10.0 * np.log10(float((samples.astype(float) ** 2).mean()) + 1e-12)
    clipped = float((np.abs(samples) > 0.999).mean())
    odd = [f"sound is silent ({level:.0f} dBFS)"] if level < LOUD_DBFS else []
    return odd + ([f"{clipped:.1%} of the samples are clipped"] if clipped > CLIPPED_SHARE else [])


def time_oddities(track: Track, sound_s: float) -> list[str]:
    """Motion and sound of different lengths, lost frames, and frames that repeat."""
    step = float(np.median(np.diff(track.seconds)))
    odd, length = [], track.seconds[-1] + step
    if abs(length - sound_s) > LENGTH_S:
        odd.append(f"lasts {length:.2f} s, the sound {sound_s:.2f} s")
    lost = 1.0 - float(track.tracked_frames.mean())
    if lost > LOST_SHARE:
        odd.append(f"{lost:.0%} of the frames are lost")
    gaps = np.flatnonzero(np.diff(track.seconds) > 1.8 * step)
    if len(gaps):
        missing = int(sum(round(d / step) - 1 for d in np.diff(track.seconds)[gaps]))
        odd.append(f"{missing} frames lost, the first after {track.seconds[gaps[0]]:.2f} s")
    flat = np.asarray(track.values).reshape(len(track.values), -1)
    still = np.r_[False, (flat[1:] == flat[:-1]).all(axis=1)]
    if still[1:].all():
        return [*odd, "nothing moves"]
    frozen = longest_run(still & (np.abs(flat).sum(axis=1) > 0)) * step
    return [*odd, f"stands still for {frozen:.2f} s"] if frozen > FROZEN_S else odd


def weight_oddities(track: Track) -> list[str]:
    """Weights in percent, and negative ones."""
    top, bottom = float(track.values.max()), float(track.values.min())
    if top > GREATEST_WEIGHT:
        return [f"weights reach {top:.0f}: expected 0 to 1 (divide percent by 100)"]
    return [f"weights fall to {bottom:.2f}: expected 0 to 1"] if bottom < -0.3 else []


def shape_oddities(shape: np.ndarray) -> list[str]:
    """A wrong unit, or left and right exchanged. `shape` [68, 3] metres."""
    width = float(np.linalg.norm(shape[16] - shape[0]))
    low, high = FACE_WIDTH_M
    if not low <= width <= high:
        guess = next((u for u, s in (("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("m", 100.0), ("m", 1e3))
                      if low <= width * s <= high), "another")  # fmt: skip
        return [f"face is {width:.3g} m wide, expected {low} to {high}: unit is {guess}?"]
    upright, mirrored = fit_error(shape), fit_error(shape * [-1.0, 1.0, 1.0])
    if mirrored < 0.7 * upright:
        distances = f"{1e3 * upright:.0f} mm off as it is, {1e3 * mirrored:.0f} in the mirror"
        return [f"left and right are exchanged, in space or in the landmarks' numbers ({distances})"]
    return []


def fit_error(shape: np.ndarray) -> float:
    """RMS distance [m] of the steady landmarks to the canonical ones after the best similarity."""
    goal, weight = canonical_landmarks()[INNER], stability()[INNER]
    rest = goal - similarity(shape[INNER], goal, weight / weight.sum())(shape[INNER])
    return float(np.sqrt((rest**2).sum(axis=1).mean()))


def lag_of(gap: np.ndarray, track: Track, samples: np.ndarray, span: tuple[float, float]) -> float | None:
    """Seconds by which the lips lag the sound within `span` (shares of the clip); None if it is unclear."""
    last = min(track.seconds[-1], len(samples) / SOUND_HZ)
    times = np.arange(span[0] * last, span[1] * last, 1.0 / LAG_HZ)
    if len(times) < 2 * LAG_HZ * LONGEST_LAG_S:
        return None
    opening = np.interp(times, track.seconds[track.tracked_frames], gap[track.tracked_frames])
    level = np.maximum(loudness(samples, times), -60.0)
    reach = int(LONGEST_LAG_S * LAG_HZ)
    lags = np.arange(-reach, reach + 1)
    scores = [correlation(opening[max(k, 0) : len(opening) + min(k, 0)],
                          level[max(-k, 0) : len(level) + min(-k, 0)]) for k in lags]  # fmt: skip
    best = int(np.argmax(scores))
    return float(lags[best] / LAG_HZ) if scores[best] > SURE_R else None


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's r; 0 where one is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = np.sqrt((a**2).sum() * (b**2).sum())
    return float((a * b).sum() / size) if size > 0 else 0.0


def turned_degrees(track: Track, shape: np.ndarray) -> float:
    """The head's rotation in degrees: its 95 % quantile over the frames."""
    _, turns = without_head(track.values[track.tracked_frames], shape)
    cosine = (np.trace(turns, axis1=1, axis2=2) - 1.0) / 2.0
    return float(np.degrees(np.quantile(np.arccos(cosine.clip(-1.0, 1.0)), 0.95)))


def longest_run(flags: np.ndarray) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(int), 0]))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _check_whole(folder: CorpusFolder, report: Report) -> None:
    if not any(row.split == "train" for row in folder.rows):
        expected = "one clip or more with split train"
        report.errors.append(str(CorpusError(folder.path / "clips.tsv", None, expected, "none")))
    elif not any(row.held_out for row in folder.rows):
        report.odd.append("no clip is held out (split val or test): nothing tells how well training went")
    known = {row.clip for row in folder.rows}
    for kind in ("audio", "landmarks", "weights", "vertices", "phones"):
        for path in sorted((folder.path / kind).glob("*")):
            clip = path.name if path.is_dir() else path.stem
            if clip not in known and (kind != "audio" or path.suffix in SOUNDS):
                report.odd.append(f"{kind}/{path.name} belongs to no row of clips.tsv")
    if not any(report.kinds[kind] for kind in ("landmarks", "weights", "vertices")) and not report.errors:
        expected = "landmarks, weights or vertices of one clip or more"
        report.errors.append(str(CorpusError(folder.path, None, expected, "sound alone")))
