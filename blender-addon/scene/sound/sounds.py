"""What is heard as text strips above the sound, which the artist may move, rename, delete and add.

A strip keeps the exact times of what it shows, in seconds from the begin of the sound, beside the
frames at which it was put: while it stays there these times hold, else its frames do. All are
muted: Blender would render them over the picture.

Where the text is known its words stand one channel above the closures. A closure knows the word
that it was heard in: where the word goes, or grows, the closure goes along, unless it was moved
itself.
"""

from typing import NamedTuple

import numpy as np

from . import sequencer

# What a strip belongs to: the name of its sound. Copies of a strip bring it along.
_SOUND = "anyface_sound"
_SECONDS, _FRAMES = "anyface_seconds", "anyface_frames"
# The number of a word, on its own strip and on the closures in it.
_WORD, _IN_WORD = "anyface_word", "anyface_in_word"
LABEL = "MBP"
_LIP_LETTERS = frozenset("pbmPBM")
# Lips close before the sound of p, b and m begins, seconds.
_EARLY_S = 0.05
# Beyond the old and the new place of a word, so that its closures lie where a redo has blended in.
_MARGIN_S = 0.2


class _Times(NamedTuple):
    """Where a strip is and where it was put, seconds from the begin of the sound."""

    now: tuple[float, float]
    was: tuple[float, float]

    @property
    def moved(self) -> bool:
        return self.now != self.was


def show(scene, source, closures: np.ndarray, words=()) -> int:
    """Puts a strip for each interval `[N, 2]`, seconds, of the sound `source`; earlier ones go.

    `words` holds start, end and label of each word of its text. Returns the number of intervals.
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
    """Strips for start, end and label, one behind the other."""
    fps, free, strips = scene.render.fps / scene.render.fps_base, -np.inf, []
    start = round(source.start_frame)
    for start_s, end_s, label in labelled:
        first, last = (round(source.start_frame + at * fps) for at in (start_s, end_s))
        first = int(max(first, free))
        free = last = max(last, first + 1)
        strip = sequencer.new_text(scene, label, channel, first, last)
        strip.text, strip.mute = label, True
        strip[_SOUND], strip[_SECONDS] = source.name, [float(start_s), float(end_s)]
        strip[_FRAMES] = [first - start, last - start]
        strips.append(strip)
    return strips


def _word_of(closure, words) -> int | None:
    """The number of the word that an interval is heard in: one with p, b or m before others."""
    candidates = []
    for number, (start_s, end_s, label) in enumerate(words):
        shared_s = min(closure[1], end_s) - max(closure[0], start_s - _EARLY_S)
        if shared_s > 0.0:
            candidates.append((bool(_LIP_LETTERS.intersection(label)), shared_s, number))
    return max(candidates)[-1] if candidates else None


def clear(scene, name: str) -> None:
    """Takes the strips of a sound away."""
    for strip in _of(scene, name):
        sequencer.outer_strips(scene.sequence_editor).remove(strip)


def read(scene, source) -> list[tuple[float, float, str]] | None:
    """Start and end in seconds, and the text, of each closure of a sound; None without strips."""
    closures = [(*now, strip.text.strip()) for strip, now in _closures(scene, source)]
    return sorted(closures) or ([] if _of(scene, source.name) else None)


def follow(scene, source) -> None:
    """Lets closures go where their words went; from then on all are where they were put."""
    fps, start = scene.render.fps / scene.render.fps_base, round(source.start_frame)
    for strip, now in _closures(scene, source):
        if now != _times(scene, source, strip).now:
            first, last = (round(at * fps) for at in now)
            sequencer.place(strip, start + first, start + max(last, first + 1))
        _settle(strip, now, start)
    for strip in _words(scene, source):
        _settle(strip, _times(scene, source, strip).now, start)


def stretch_of_words(scene, source) -> tuple[float, float] | None:
    """The frames between which words have moved, their old places too; None where none has."""
    moved = [_times(scene, source, strip) for strip in _words(scene, source)]
    ends_s = [at for times in moved if times.moved for at in (*times.now, *times.was)]
    if not ends_s:
        return None
    fps = scene.render.fps / scene.render.fps_base
    first, last = min(ends_s) - _MARGIN_S, max(ends_s) + _MARGIN_S
    return source.start_frame + np.floor(first * fps), source.start_frame + np.ceil(last * fps)


def _closures(scene, source) -> list[tuple]:
    """Each closure's strip, and its start and end in seconds where its word is now."""
    words = {}
    for strip in _words(scene, source):
        words.setdefault(strip[_WORD], []).append(_times(scene, source, strip))
    closures = []
    for strip in _of(scene, source.name):
        if _WORD in strip:
            continue
        times, word = _times(scene, source, strip), words.get(strip.get(_IN_WORD), [])
        # Of a word that was copied nobody knows which of the two the closure is in.
        carried = len(word) == 1 and word[0].moved and not times.moved
        closures.append((strip, _carried(times.now, word[0]) if carried else times.now))
    return closures


def _carried(interval: tuple[float, float], word: _Times) -> tuple[float, float]:
    """Times in a word, seconds, where the word is now."""
    rate = (word.now[1] - word.now[0]) / max(word.was[1] - word.was[0], 1e-3)
    start_s, end_s = (max(0.0, word.now[0] + rate * (at - word.was[0])) for at in interval)
    return start_s, end_s


def _times(scene, source, strip) -> _Times:
    fps = scene.render.fps / scene.render.fps_base
    ends, was = [at - round(source.start_frame) for at in sequencer.ends(strip)], strip.get(_FRAMES)
    exact = tuple(strip[_SECONDS])
    if was is None or ends == list(was):
        return _Times(exact, exact)
    # Frames against frames: a word that is shifted keeps the lengths of what is in it.
    return _Times(*(tuple(max(0.0, at / fps) for at in pair) for pair in (ends, was)))


def _settle(strip, now: tuple[float, float], start: int) -> None:
    """Where a strip is becomes where it was put."""
    strip[_SECONDS] = [float(at) for at in now]
    strip[_FRAMES] = [at - start for at in sequencer.ends(strip)]


def _words(scene, source) -> list:
    return [strip for strip in _of(scene, source.name) if _WORD in strip]


def apart(labelled: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """The same intervals, each behind the one before: strips of two channels may overlap."""
    intervals, free = [], 0.0
    for start_s, end_s, label in labelled:
        if end_s > max(start_s, free):
            intervals.append((max(start_s, free), end_s, label or LABEL))
            free = end_s
    return intervals


def shows(strip) -> bool:
    """True for a strip that shows what is heard in a sound."""
    return strip.get(_SOUND) is not None


def _of(scene, name: str) -> list:
    strips = sequencer.all_strips(scene)
    return [strip for strip in strips if strip.type == "TEXT" and strip.get(_SOUND) == name]
