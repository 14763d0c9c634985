"""The loss of the deformations: exact pairs of canonical and posed points, and contact of lips and lids."""

from dataclasses import dataclass

import torch
from torch import Tensor

from training.corpus.heads import FACE_VERTICES, IctHeads, vertex_normals
from training.corpus.poses import LIDS, Poses
from training.systems.facetalk.head import Head

CODES = 5e-5
STEEP_M = 1e-3
"""Length of an error in metres at which its square adds as much to the loss as the length itself. With plain
lengths the model did not learn rare poses at all.
"""
GAPS = 4.0
TOGETHER_M, APART_M = 1.5e-3, 3e-3
MAX_PAIRS = 200
ABOUT_M = 0.02
FAR_SHARE = 0.15
STILL_M = 0.02
"""Points of the volume farther from the skin than this (metres) do not move."""
BACKWARD_POINTS, BACKWARD_AWAY_M = 0.5, 1.5e-3


@dataclass
class Batch:
    """Training data for both directions: `B` heads and poses."""

    z: Tensor
    weights: Tensor
    canonical: Tensor
    posed: Tensor
    normals: Tensor


def lip_pairs(heads: IctHeads) -> Tensor:
    """Pairs of upper and lower lip vertices that meet at rest but not in the canonical pose, [N, 2]."""
    return meeting(heads, heads.mean, heads.landmarks[48:])


def lid_pairs(heads: IctHeads) -> Tensor:
    """Pairs of lid vertices that meet when the eyes are shut but not in the canonical pose, [N, 2]."""
    return meeting(heads, heads.mean + heads.modes[LIDS].sum(0), heads.landmarks[36:48])


def meeting(heads: IctHeads, shut: Tensor, landmarks: Tensor) -> Tensor:
    """Pairs (upper, lower) of vertices near landmarks that coincide in the pose `shut` [V, 3].

    In the canonical pose they are apart.
    """
    near = torch.cdist(heads.mean[:FACE_VERTICES], heads.mean[landmarks]).amin(1) < ABOUT_M
    rows = near.nonzero()[:, 0]
    together = torch.cdist(shut[rows], shut[rows])
    opened = torch.cdist(heads.opened[rows], heads.opened[rows])
    a, b = ((together < TOGETHER_M) & (opened > APART_M)).nonzero().T
    higher = heads.opened[rows[a], 1] > heads.opened[rows[b], 1]
    return torch.stack([rows[a[higher]], rows[b[higher]]], 1)


def steep(length: Tensor, scale: float) -> Tensor:
    """Mean of the lengths plus their scaled squares. Beyond `STEEP_M` the squares weigh more."""
    return (length + length.square() * (scale / STEEP_M)).mean()


class ExpressionLoss:
    """Holds poses and the pairs of lips and lids; computes the loss of one batch."""

    def __init__(self, heads: IctHeads, poses: Poses):
        self.heads, self.poses = heads, poses
        self.lips, self.lids = lip_pairs(heads), lid_pairs(heads)
        print(f"pairs of vertices: {len(self.lips)} of lips, {len(self.lids)} of lids")

    def __call__(self, head: Head, pool, count: int, points: int, exact: bool, cycle: bool, random):
        """Returns the loss of one batch and its parts.

        If `exact`, places on the mean head come from the triangles, not from the identity field. If `cycle`,
        the backward field starts at the points that the forward field returns, not at the true posed points.
        """
        heads, scale = self.heads, head.config.scale_m
        device = head.identity_code.weight.device
        chosen = pool.draw(count)
        weights = self.poses.draw(count, random)
        canonical, normals = pool.vertices[chosen], pool.normals[chosen]
        sizes = pool.scales[chosen][:, None, None]
        posed = canonical + sizes * ((weights - heads.rest) @ heads.modes.flatten(1)).unflatten(1, (-1, 3))
        turned = vertex_normals(posed, heads.triangles)
        rows = torch.randint(0, len(heads.places), (points,), generator=random)
        places = heads.places[rows]
        pairs = [p[torch.randint(0, len(p), (MAX_PAIRS,), generator=random)] for p in (self.lips, self.lids)]
        ends = torch.cat(pairs).T.flatten()
        with torch.no_grad():
            z = head.identity_code(pool.coefficients[chosen].to(device))
            anchors = head.identity.anchors(z)
        here = torch.cat([heads.at(canonical, normals, places), canonical[:, ends]], 1) / scale
        there = torch.cat([heads.at(posed, turned, places), posed[:, ends]], 1) / scale
        here, there = here.to(device), there.to(device)
        if exact:
            on_mean = heads.at(heads.opened[None], heads.normals[None], places)
            place = (torch.cat([on_mean, heads.opened[None, ends]], 1) / scale).to(device)
        else:
            with torch.no_grad():
                place = head.place(here, z)
        far = (self._far(random) / scale).to(device)
        code = head.expression(weights.to(device))
        joined = torch.cat([place, far.expand(len(place), -1, -1)], 1)
        moved = head.forward_field.move(joined, z, anchors, code)
        still = moved[:, place.shape[1] :]
        error = here + moved[:, : place.shape[1]] - there
        upper, lower = error[:, points:].chunk(2, 1)
        length = error.norm(dim=-1)
        forward, gap = steep(length, scale), (upper - lower).norm(dim=-1).mean()
        most = int(BACKWARD_POINTS * points)
        close = (places.away.abs() <= BACKWARD_AWAY_M).nonzero()[:, 0][:most].to(device)
        start = (here + moved[:, : place.shape[1]]).detach()[:, close] if cycle else there[:, close]
        with torch.no_grad():
            start_places = head.place(start, z)
        back = start + head.backward_field.move(start_places, z, anchors, code) - here[:, close]
        backward = back.norm(dim=-1)
        total = (
            forward
            + GAPS * gap
            + still.norm(dim=-1).mean()
            + steep(backward, scale)
            + CODES * code.square().mean()
        )
        mm = 1e3 * scale
        rest = (weights == 0.0).all(1).to(device)
        lips, lids = (upper - lower).norm(dim=-1).split(MAX_PAIRS, 1)
        report = {
            "forward mm": mm * length[:, :points].mean().item(),
            "lips and lids mm": mm * length[:, points:].mean().item(),
            "lips' gap mm": mm * lips.mean().item(),
            "lids' gap mm": mm * lids.mean().item(),
            "backward mm": mm * backward.mean().item(),
            "still mm": mm * still.norm(dim=-1).mean().item(),
        }
        if rest.any():
            report["gap at rest mm"] = mm * lips[rest].mean().item()
        return total, report

    def _far(self, random: torch.Generator) -> Tensor:
        volume = self.heads.volume
        far = (volume.distance > STILL_M).nonzero()[:, 0]
        return volume.points[far[torch.randint(0, len(far), (100,), generator=random)]]
