"""Text strips for lip closures and words, which the artist may move, rename, delete and add.

Each strip stores its exact times, in seconds from the beginning of the sound, and the frames at
which it was placed. While it stays at these frames, the exact times count. After it has moved, its
new frames count. All strips are muted, since Blender would render them over the picture.

If the text is known, its words are one channel above the closures. A closure stores the word in
which it was heard. If the word is moved or stretched, the closure follows, unless the closure was
moved itself.
"""

from typing import NamedTuple

import numpy as np

from . import sequencer

# The name of the sound that a strip belongs to. Copies of a strip have it too.
_SOUND = "anyface_sound"
_SECONDS, _FRAMES = "anyface_seconds", "anyface_frames"
# The number of a word, on its own strip and on the closures in it.
_WORD, _IN_WORD = "anyface_word", "anyface_in_word"
LABEL = "MBP"
_LIP_LETTERS = frozenset("pbmPBM")
# Lips close this long before the sound of p, b or m begins, seconds.
_EARLY_S = 0.05
# A redo starts and ends this far outside the old and new times of a word, so that it is fully
# blended in at the word, seconds.
_MARGIN_S = 0.2


class _Times(NamedTuple):
    """The times of a strip now and when it was placed, seconds from the beginning of the sound."""

    now: tuple[float, float]
    was: tuple[float, float]

    @property
    def moved(self) -> bool:
        return self.now != self.was


def show(scene, source, closures: np.ndarray, words=()) -> int:
    """Adds a strip for each closure `[N, 2]`, seconds, of a sound; removes earlier strips.

    `source` is the sound, and `words` are start, end and label of each word of its text. Returns
    the number of closures.
    """
    clear(scene, source.name)
    channel = 1 + max((strip.channel for strip in sequencer.all_strips(scene)), default=0)
    labelled = [(start_s, end_s, LABEL) for start_s, end_s in closures]
    for strip in _row(scene, source, channel, labelled):
        number = _word_of(strip[_SECONDS], words)
        if number is not None:
            strip[_IN_WORD] = number
    for number, strip in enumerate(_row(scene, source, channel + 1, words)):
        strip[_WORD] = number
    return len(closures)


def _row(scene, source, channel: int, labelled) -> list:
    """Adds a strip for each start, end and label, so that none overlap."""
    fps, free, strips = scene.render.fps / scene.render.fps_base, -np.inf, []
    start = round(source.start_frame)
    for start_s, end_s, label in labelled:
        first, last = (round(source.start_frame + at * fps) for at in (start_s, end_s))
        first = int(max(first, free))
        free = last = max(last, first + 1)
        strip = sequencer.new_text(scene, label, channel, first, last)
        strip.text = label
        strip[_SOUND], strip[_SECONDS] = source.name, [float(start_s), float(end_s)]
        strip[_FRAMES] = [first - start, last - start]
        strips.append(strip)
    return strips


def _word_of(closure, words) -> int | None:
    """The number of the word that a closure lies in, preferably one with p, b or m; or None."""
    candidates = []
    for number, (start_s, end_s, label) in enumerate(words):
        shared_s = min(closure[1], end_s) - max(closure[0], start_s - _EARLY_S)
        if shared_s > 0.0:
            candidates.append((bool(_LIP_LETTERS.intersection(label)), shared_s, number))
    return max(candidates)[-1] if candidates else None


def clear(scene, name: str) -> None:
    """Removes the strips of a sound."""
    for strip in _of(scene, name):
        sequencer.outer_strips(scene.sequence_editor).remove(strip)


def read(scene, source) -> list[tuple[float, float, str]] | None:
    """Start, end (seconds) and text of each closure of a sound; None if the sound has no strips."""
    closures = [(*now, strip.text.strip()) for strip, now in _closures(scene, source)]
    return sorted(closures) or ([] if _of(scene, source.name) else None)


def follow(scene, source) -> None:
    """Moves closures along with their words, then stores where all strips are now."""
    fps, start = scene.render.fps / scene.render.fps_base, round(source.start_frame)
    for strip, now in _closures(scene, source):
        if now != _times(scene, source, strip).now:
            first, last = (round(at * fps) for at in now)
            sequencer.place(strip, start + first, start + max(last, first + 1))
        _settle(strip, now, start)
    for strip in _words(scene, source):
        _settle(strip, _times(scene, source, strip).now, start)


def stretch_of_words(scene, source) -> tuple[float, float] | None:
    """The frames around the old and new places of all moved words; None if none has moved."""
    moved = [_times(scene, source, strip) for strip in _words(scene, source)]
    ends_s = [at for times in moved if times.moved for at in (*times.now, *times.was)]
    if not ends_s:
        return None
    fps = scene.render.fps / scene.render.fps_base
    first, last = min(ends_s) - _MARGIN_S, max(ends_s) + _MARGIN_S
    return source.start_frame + np.floor(first * fps), source.start_frame + np.ceil(last * fps)


def _closures(scene, source) -> list[tuple]:
    """The strip of each closure, and its start and end in seconds once it follows its word."""
    words = {}
    for strip in _words(scene, source):
        words.setdefault(strip[_WORD], []).append(_times(scene, source, strip))
    closures = []
    for strip in _of(scene, source.name):
        if _WORD in strip:
            continue
        times, word = _times(scene, source, strip), words.get(strip.get(_IN_WORD), [])
        # If a word was copied, its closure could belong to either copy, so it stays.
        carried = len(word) == 1 and word[0].moved and not times.moved
        closures.append((strip, _carried(times.now, word[0]) if carried else times.now))
    return closures


def _carried(interval: tuple[float, float], word: _Times) -> tuple[float, float]:
    """Moves and stretches an interval, seconds, along with its word."""
    rate = (word.now[1] - word.now[0]) / max(word.was[1] - word.was[0], 1e-3)
    start_s, end_s = (max(0.0, word.now[0] + rate * (at - word.was[0])) for at in interval)
    return start_s, end_s


def _times(scene, source, strip) -> _Times:
    fps = scene.render.fps / scene.render.fps_base
    ends, was = [at - round(source.start_frame) for at in sequencer.ends(strip)], strip.get(_FRAMES)
    exact = tuple(strip[_SECONDS])
    if was is None or ends == list(was):
        return _Times(exact, exact)
    # Both come from frames, so that closures in a shifted word keep their length.
    return _Times(*(tuple(max(0.0, at / fps) for at in pair) for pair in (ends, was)))


def _settle(strip, now: tuple[float, float], start: int) -> None:
    """Stores the present times and frames of a strip as those at which it was placed."""
    strip[_SECONDS] = [float(at) for at in now]
    strip[_FRAMES] = [at - start for at in sequencer.ends(strip)]


def _words(scene, source) -> list:
    return [strip for strip in _of(scene, source.name) if _WORD in strip]


def apart(labelled: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """The same intervals without overlaps, since strips on two channels may overlap."""
    intervals, free = [], 0.0
    for start_s, end_s, label in labelled:
        if end_s > max(start_s, free):
            intervals.append((max(start_s, free), end_s, label or LABEL))
            free = end_s
    return intervals


def shows(strip) -> bool:
    """Whether a strip shows a closure or a word."""
    return strip.get(_SOUND) is not None


def _of(scene, name: str) -> list:
    strips = sequencer.all_strips(scene)
    return [strip for strip in strips if strip.type == "TEXT" and strip.get(_SOUND) == name]
