"""Random heads for training: human, warped, stylised, in costume, or never human; torn, remeshed, dressed."""

import numpy as np

from training.landmarks import adorn, render, samples
from training.landmarks.adorn import BROWS
from training.landmarks.characters import character
from training.landmarks.covers import covered
from training.landmarks.samples import Faces, Head
from training.landmarks.stepped import stepped
from training.landmarks.stylise import EYES, company, smoothed, stylise

COVERED, STEPPED = {"human": 0.06, "stylised": 0.4, "costume": 0.35, "character": 0.1}, 0.16
"""Share of heads of each kind that get covered eyes (`covers`).

`STEPPED` is the share of all heads that get a surface in steps (`stepped`).
"""

KINDS = ("human", "stylised", "costume", "character")
SHARES = (0.5, 0.16, 0.16, 0.18)
"""Share of each of `KINDS`.

The kinds are people, their caricatures (`stylise`), heads with things stuck on and features melted away
(`adorn`), and heads made of clay (`characters`).
"""

COSTUMES = (
    (adorn.muzzle, 0.25),
    (adorn.eyeballs, 0.4),
    (adorn.rims, 0.3),
    (adorn.brows, 0.3),
    (adorn.glasses, 0.15),
    (adorn.beard, 0.2),
    (adorn.fringe, 0.2),
    (adorn.side_ears, 0.35),
)


def random_head(
    rng: np.random.Generator, faces: Faces, identities: np.ndarray, makehuman_share: float
) -> Head:
    """One head. `identities`: `[n, 100]` coefficients to choose from."""
    kind = str(rng.choice(KINDS, p=SHARES))
    head = bare_head(rng, faces, identities, makehuman_share, kind)
    styled = kind != "human"
    steps = rng.random() < STEPPED
    if steps:
        head = stepped(rng, head)
    if rng.random() < COVERED[kind]:
        more = covered(rng, head)
        head = more if face_is_visible(more) else head
    if rng.random() < (0.2 if styled else 0.4):
        head = samples.tear(rng, head)
    if not steps and rng.random() < 0.4:
        head = low_poly(rng, head, LEAST_TRIANGLES[kind]) if styled else samples.remesh(rng, head)
    for _ in range(4):
        dressed = samples.dress(rng, head)
        if styled or rng.random() < 0.25:
            dressed = company(rng, dressed)
        if face_is_visible(dressed):
            return dressed
    return head


def bare_head(rng: np.random.Generator, faces: Faces, identities, makehuman_share: float, kind: str) -> Head:
    """A head of one of `KINDS`, not torn and without company."""
    if kind == "character":
        return samples.warp(rng, character(rng), rng.choice([0.0, 0.5, 1.0]))
    is_makehuman = rng.random() < makehuman_share
    if is_makehuman:
        head = faces.makehuman_head(rng)
    else:
        head = faces.ict_head(rng, identities[rng.integers(len(identities))])
    if kind == "stylised" or (kind == "costume" and rng.random() < 0.6):
        head = stylise(rng, head)
    elif rng.random() < 0.15:
        head = smoothed(head, int(rng.integers(3, 15)))
    if kind == "costume":
        head = costumed(rng, head)
    if is_makehuman or kind == "stylised" or rng.random() < 0.75:
        head = samples.warp(rng, head, rng.choice([0.5, 1.0, 2.0]))
    return head


def costumed(rng: np.random.Generator, head: Head) -> Head:
    """Melts away the nose, an eye or a brow at times, and sticks things on. The face stays visible."""
    marks = head.landmarks
    eye, brow = int(rng.integers(2)), int(rng.integers(2))
    for centre, sigma, chance in (
        (marks[[29, 30, 33]].mean(0), 0.018, 0.3),
        (marks[EYES[eye]].mean(0), 0.016, 0.1),
        (marks[BROWS[brow]].mean(0), 0.02, 0.1),
    ):
        if rng.random() < chance:
            head = adorn.melted(rng, head, centre, sigma)
    for add, chance in COSTUMES:
        if rng.random() < chance:
            more = add(rng, head)
            head = more if face_is_visible(more) else head
    return head


HIDDEN = {"mouth": (slice(48, 68), 0.2), "eyes": (slice(36, 48), 0.35), "inner": (slice(17, 68), 0.35)}
"""Landmarks of each part. The face counts as visible if less than this share of them is covered."""


def face_is_visible(head: Head) -> bool:
    """Whether the face is visible from the front, in spite of the things that the head wears."""
    marks, inner = head.landmarks, head.landmarks[17:]
    middle = inner.mean(0)
    half = 1.1 * np.abs(inner - middle)[:, :2].max()
    points, triangles = head.points.astype(np.float32), head.triangles.astype(np.int32)
    buffer = render.depth_buffer(points, triangles, *middle[:2].astype(np.float32), np.float32(half), 64)
    column, row = np.clip((render.to_window(marks, middle, half).T * 64).astype(int), 0, 63)
    hidden = buffer[row, column] > marks[:, 2] + 0.015
    return all(hidden[region].mean() < most for region, most in HIDDEN.values())


LEAST_TRIANGLES = {"stylised": 500, "costume": 900, "character": 900}
"""Fewest triangles that `low_poly` leaves a head of each kind.

With fewer the features vanish, and things stuck on need triangles too.
"""


def low_poly(rng: np.random.Generator, head: Head, least: int) -> Head:
    """Remeshes the head to a triangulation as coarse as that of game characters."""
    most = min(9000, len(head.triangles))
    target = np.exp(rng.uniform(np.log(least), np.log(max(most, least + 1))))
    return samples.remesh(rng, head, target=float(target), gentle=True)
