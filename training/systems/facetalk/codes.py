"""Computes identity codes in closed form: principal components of ICT's whole heads and of each region.

The global code comes from the directions of the coefficients that move the surface furthest. A region's code
comes from the remaining directions that move the region furthest, where the blend weights of its anchor
weight the vertices. ICT's modes are symmetric or antisymmetric, so the global directions are too. The code of
a left region is the code of the right region on the mirrored head.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from training.corpus.heads import COEFFICIENTS, FACE_VERTICES, IctHeads
from training.systems.facetalk.head import DIRECTIONS, Head
from training.systems.facetalk.identity import numbers

SAMPLES = 600
ELSEWHERE = 0.2
"""Factor on the weight of a vertex that is not part of the face."""
MARGIN_M = 0.01


@dataclass
class Modes:
    """A linear model of aligned heads: they are nearly `mean + c · modes`.

    mean [V, 3]; modes [100, V, 3]; sign [100], by which a mirror multiplies each mode; area [V] of each
    vertex, reduced off the face.
    """

    mean: Tensor
    modes: Tensor
    sign: Tensor
    area: Tensor


def linear_modes(heads: IctHeads) -> Modes:
    """Fits the modes to random heads by least squares, since alignment makes heads a little nonlinear."""
    random = torch.Generator().manual_seed(11)
    coefficients = torch.randn(SAMPLES // 2, COEFFICIENTS, generator=random)
    coefficients = torch.cat([coefficients, -coefficients])
    vertices = heads.canonical(coefficients)[0]
    mean = vertices.mean(0)
    modes = torch.linalg.lstsq(coefficients, (vertices - mean).flatten(1)).solution.unflatten(1, (-1, 3))
    flip = torch.tensor([-1.0, 1.0, 1.0])
    partner = torch.cdist(heads.mean * flip, heads.mean).argmin(1)
    original = heads.identity.unflatten(1, (-1, 3))
    sign = (original * (original[:, partner] * flip)).sum((1, 2)).sign()
    corners = heads.opened[heads.triangles]
    area = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1)
    weight = torch.zeros(len(mean)).index_add(0, heads.triangles.flatten(), area.repeat_interleave(3))
    weight[FACE_VERTICES:] *= ELSEWHERE
    return Modes(mean, modes, sign, weight / weight.sum())


def directions(modes: Modes, weight: Tensor, left: Tensor, count: int, split: bool) -> tuple[Tensor, Tensor]:
    """The `count` unit directions [count, 100] that move vertices furthest, and their mean squared movement.

    `left` [100, 100] projects onto the directions that remain. `weight` [V] weights the vertices. `split`
    separates symmetric from antisymmetric directions.
    """
    flat = (modes.modes * weight.sqrt()[:, None]).flatten(1)
    gram = (left @ (flat @ flat.T) @ left).double()
    if split:
        gram = gram * (modes.sign[:, None] == modes.sign)
    value, vector = torch.linalg.eigh(gram)
    order = value.argsort(descending=True)[:count]
    return vector[:, order].T.float(), value[order].float()


@torch.no_grad()
def set_codes(head: Head, heads: IctHeads) -> dict[str, float]:
    """Fills the maps from coefficients to codes and from codes to landmarks, and the mirror signs.

    Returns for each region how many mm of its movement the codes leave unexplained.
    """
    config, modes = head.config, linear_modes(heads)
    whole = directions(modes, modes.area, torch.eye(COEFFICIENTS), config.global_code, True)[0]
    whole = whole * whole.gather(1, whole.abs().argmax(1, keepdim=True)).sign()
    random = torch.Generator().manual_seed(12)
    coefficients = torch.randn(SAMPLES, COEFFICIENTS, generator=random)
    vertices = heads.canonical(coefficients)[0] / config.scale_m
    places = vertices[:, heads.landmarks].flatten(1)
    known = torch.cat([coefficients @ whole.T, torch.ones(SAMPLES, 1)], 1)
    solved = torch.linalg.lstsq(known, places).solution
    head.identity.landmarks.weight.copy_(solved[:-1].T)
    head.identity.landmarks.bias.copy_(solved[-1])
    head.identity.mirror.copy_((whole.square() * modes.sign).sum(1).sign())
    anchors = head.identity.landmarks.bias.unflatten(0, (-1, 3))[None]
    blend = head.identity.blend(modes.mean[None] / config.scale_m, anchors[:, numbers(config)])[0]
    left = torch.eye(COEFFICIENTS) - whole.T @ whole
    rows, report = [whole], {}
    for number in range(config.anchors + 1):
        mirrored = number < 2 * len(config.pairs) and number % 2 == 1
        if mirrored:
            rows.append(rows[-1] * modes.sign)
            continue
        weight = modes.area * blend[:, number]
        local_rows, _ = directions(modes, weight, left, config.local_code, False)
        rows.append(local_rows)
        span = torch.cat([whole, local_rows])
        flat = (modes.modes * weight.sqrt()[:, None]).flatten(1) / weight.sum().sqrt()
        over = flat - span.T @ (span @ flat)
        report[f"anchor {number} mm"] = 1e3 * over.square().sum().sqrt().item()
    weight = torch.cat(rows)
    head.identity_code.weight.copy_(weight)
    head.identity_code.bias.zero_()
    return report


@torch.no_grad()
def set_directions(head: Head, heads: IctHeads) -> None:
    """Sets the sliders' directions, which move the surface furthest.

    Each has the sign that makes its named measure grow.
    """
    modes = linear_modes(heads)
    rows, reach = directions(modes, modes.area, torch.eye(COEFFICIENTS), DIRECTIONS, True)
    names = named(modes, heads, rows)
    signs = torch.tensor([sign for _, sign in names])
    head.principal.directions.copy_(signs[:, None] * rows)
    head.config.directions = [
        {"name": name, "reach_mm": round(1e3 * float(squared) ** 0.5, 2)}
        for (name, _), squared in zip(names, reach, strict=True)
    ]


def set_bounds(head: Head, heads: IctHeads) -> None:
    """Sets the box that contains many random heads, with a margin."""
    random = torch.Generator().manual_seed(12)
    vertices = heads.canonical(torch.randn(SAMPLES, COEFFICIENTS, generator=random))[0]
    low, high = vertices.amin((0, 1)) - MARGIN_M, vertices.amax((0, 1)) + MARGIN_M
    head.config.bounds_m = [[round(float(x), 3) for x in low], [round(float(x), 3) for x in high]]


def measures(vertices: Tensor, landmarks: Tensor) -> dict[str, Tensor]:
    """Tape measures of heads [B, V, 3] in metres, [B] each."""
    at = vertices[:, landmarks]

    def apart(a: int, b: int) -> Tensor:
        return (at[:, a] - at[:, b]).norm(dim=1)

    top = vertices[..., 1].amax(1)
    return {
        "face width": apart(1, 15),
        "jaw width": apart(5, 11),
        "chin width": apart(7, 9),
        "chin height": apart(57, 8),
        "chin forward": at[:, 8, 2] - at[:, 27, 2],
        "face height": apart(27, 8),
        "nose length": apart(27, 33),
        "nose width": apart(31, 35),
        "nose forward": at[:, 30, 2] - at[:, 33, 2],
        "mouth width": apart(48, 54),
        "lip height": apart(51, 62) + apart(66, 57),
        "eye distance": apart(39, 42),
        "eye width": apart(36, 39),
        "brow height": at[:, [19, 24], 1].mean(1) - at[:, 27, 1],
        "forehead height": top - at[:, 27, 1],
        "head depth": vertices[..., 2].amax(1) - vertices[..., 2].amin(1),
        "cheek depth": at[:, [3, 13], 2].mean(1) - at[:, 27, 2],
        "left and right": (at[:, 8, 0] + at[:, 30, 0] + at[:, 27, 0]) / 3.0,
    }


def named(modes: Modes, heads: IctHeads, rows: Tensor) -> list[tuple[str, float]]:
    """Names each direction [N, 100] after the measure that changes most along it.

    Each measure's change is relative to its variation between heads. The returned sign makes the measure
    grow. Each name is used only once.
    """
    random = torch.Generator().manual_seed(13)

    def people(coefficients: Tensor) -> dict[str, Tensor]:
        vertices = modes.mean + torch.einsum("bk,kvc->bvc", coefficients, modes.modes)
        return measures(vertices, heads.landmarks)

    varies = {
        name: value.std() for name, value in people(torch.randn(200, COEFFICIENTS, generator=random)).items()
    }
    names: list[tuple[str, float]] = []
    for row in rows:
        change = {n: ((v[0] - v[1]) / varies[n]).item() for n, v in people(torch.stack([row, -row])).items()}
        used = {name for name, _ in names}
        name = max((n for n in change if n not in used), key=lambda n: abs(change[n]))
        names.append((name, 1.0 if change[name] >= 0.0 else -1.0))
    return names
