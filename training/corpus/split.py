"""Decides which stretches are held out. `tests/eval` on the Rust side follows the same rule.

* grid_s1: clips in sorted order of their names; those whose index is a multiple of 10 are held
  out (91 of 909: the first, the eleventh, …). Every clip counts, damaged ones too.
* facegood_zh: the end of every take. With T frames at 25 fps, frames from ⌊0.85 T⌋ on are held
  out, together with the sound from that time on. To measure the quality on a take that training never
  heard, train without it (`leave_clips`).
"""

GRID_EVERY = 10
FACEGOOD_TRAINING_SHARE = 0.85


def grid_held_out(names: list[str]) -> set[str]:
    """Held-out clips among all clip names of grid_s1."""
    return set(sorted(names)[::GRID_EVERY])


def leave_clips(entries, beginnings: list[str]) -> None:
    """Holds out the entries whose names begin with one of `beginnings`, to train without a whole take."""
    for entry in entries:
        entry.held_out = entry.held_out or any(entry.name.startswith(b) for b in beginnings)


def facegood_first_held_out(frames: int) -> int:
    """First held-out frame of a take of `frames` frames at 25 fps."""
    return int(FACEGOOD_TRAINING_SHARE * frames)
