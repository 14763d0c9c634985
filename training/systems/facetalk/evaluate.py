"""Measures FaceTalk's head on ICT identities and takes that training never drew, and on MakeHuman.

    python -m training.systems.facetalk.evaluate --head runs/facetalk_head/head.pt

Reads a run's head.pt or an exported folder. A distance is that from a point of the true face to the field's
zero surface, estimated by one Newton step. `--parts` chooses what is measured.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from training import shipped
from training.corpus.faces import CHANNELS, load_makehuman
from training.corpus.heads import COEFFICIENTS, FACE_VERTICES, IctHeads, drawn_places, vertex_normals
from training.corpus.poses import LIDS, Poses
from training.systems.facetalk.expression_loss import lid_pairs, lip_pairs
from training.systems.facetalk.fit_codes import SequenceFit, fit_free, fit_identity, fit_sequence
from training.systems.facetalk.head import Head
from training.systems.facetalk.stored import load_head_and_motions

UNSEEN_SEED = 9_000_000
"""Offset of the seeds of evaluation. Training uses small seeds, so it never draws the same numbers."""
LIPS_M = 8e-3
FITTED_POINTS = 5000
POSES_OF_EACH = 20
MOVED_MM = 0.5
CLOUD_POINTS, NOISE_M = 5000, 5e-4


def unseen(count: int) -> Tensor:
    """Random coefficients [count, 100] that training never drew."""
    return torch.randn(count, COEFFICIENTS, generator=torch.Generator().manual_seed(UNSEEN_SEED))


def to_surface(head: Head, points: Tensor, normals: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
    """Distances [P] in mm of points [P, 3] from the surface of `z` [Z], and cosines of normals [P]."""
    x = (points / head.config.scale_m)[None].requires_grad_()
    s = head.identity(x, z[None])
    slope = torch.autograd.grad(s.sum(), x)[0][0]
    distance = s[0].abs() / slope.norm(dim=1).clamp_min(0.3)
    return 1e3 * head.config.scale_m * distance.detach(), F.cosine_similarity(slope, normals, dim=1).detach()


def face_points(heads: IctHeads, vertices: Tensor, count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Draws points by area on the face of one head [V, 3], with normals."""
    face = heads.triangles[(heads.triangles < FACE_VERTICES).all(1)]
    return drawn_by_area(vertices, face, count, seed)


def drawn_by_area(vertices: Tensor, triangles: Tensor, count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Draws points [count, 3] by area on triangles [F, 3], with normals."""
    random = torch.Generator().manual_seed(seed)
    corners = vertices[triangles]
    cross = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    places = drawn_places(cross.norm(dim=1), count, random)
    a, b, c = corners[places.triangle].unbind(1)
    points = a + places.share[:, 1:2] * (b - a) + places.share[:, 2:] * (c - a)
    return points, F.normalize(cross[places.triangle], dim=1)


def identity(head: Head, heads: IctHeads, _data: Path, count: int) -> None:
    """Measures heads with the known coefficients and with fitted ones, and the mean head."""
    coefficients = unseen(count)
    vertices = heads.canonical(coefficients)[0]
    distances: dict[str, list[tuple[Tensor, Tensor]]] = {"known code": [], "fitted": [], "mean head": []}
    for number in range(count):
        points, normals = face_points(heads, vertices[number], FITTED_POINTS, UNSEEN_SEED + number)
        landmarks = vertices[number, heads.landmarks]
        fitted = fit_identity(head, points, landmarks)
        fresh = face_points(heads, vertices[number], FITTED_POINTS, UNSEEN_SEED + 100 + number)
        for name, c in (("known code", coefficients[number]), ("fitted", fitted),
                        ("mean head", torch.zeros(COEFFICIENTS))):  # fmt: skip
            distances[name].append(to_surface(head, *fresh, head.identity_code(c).detach()))
    for name, rows in distances.items():
        show(f"ICT, {count} unseen, {name}", rows)
    moved = coefficients @ head.principal.directions.T
    print("spread of the principal directions' coefficients", moved.std().item())


def makehuman(head: Head, _heads: IctHeads, data: Path, _count: int) -> None:
    """Measures a face of a kind that training never saw. Its own mode opens its jaw."""
    face = load_makehuman(data)
    opened = torch.from_numpy(
        face.vertices + head.config.open_jaw * face.modes[CHANNELS.index("jawOpen")]
    ).float()
    triangles = torch.from_numpy(face.triangles)
    skin = triangles[outer(opened, triangles, torch.from_numpy(face.landmarks))]
    points, normals = drawn_by_area(opened, skin, FITTED_POINTS, UNSEEN_SEED)
    landmarks = opened[torch.from_numpy(face.landmarks)]
    c = fit_identity(head, points, landmarks, iterations=12)
    z = head.identity_code(c).detach()
    fresh = drawn_by_area(opened, skin, FITTED_POINTS, UNSEEN_SEED + 1)
    print(f"MakeHuman: coefficients up to {c.abs().max():.1f}")
    show("MakeHuman, fitted coefficients", [to_surface(head, *fresh, z)])
    for stay in (0.3, 0.03):
        free = fit_free(head, points, z, 200, stay)
        show(f"MakeHuman, z_id free, stay {stay}", [to_surface(head, *fresh, free)])
    show("MakeHuman, mean head", [to_surface(head, *fresh, head.identity_code.bias.detach())])


def outer(vertices: Tensor, triangles: Tensor, landmarks: Tensor) -> Tensor:
    """Which triangles are the front of the face, [F] bool.

    They lie within 3 cm of a landmark and face away from the middle of the head. Triangles in the mouth's bag
    or the eyes' pockets are left out: those behind landmarks of mouth and eyes and within 12 mm of them as
    seen from the front.
    """
    corners = vertices[triangles]
    centre = corners.mean(1)
    normal = F.normalize(
        torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=1
    )
    at = vertices[landmarks]
    near = torch.cdist(centre, at).amin(1) < 0.03
    middle = at[27:].mean(0) - torch.tensor([0.0, 0.0, 0.07])
    facing = (normal * F.normalize(centre - middle, dim=1)).sum(1) > 0.0
    holes = torch.cat([at[36:48], at[60:68]])
    flat = torch.cdist(centre[:, :2], holes[:, :2])
    behind = holes[flat.argmin(1), 2] - centre[:, 2]
    inside = (flat.amin(1) < 0.012) & (behind > 2e-3)
    return near & facing & ~inside


def show(name: str, rows: list[tuple[Tensor, Tensor]]) -> None:
    """Prints the mean distance, its 95 % quantile and the mean cosine of the normals."""
    distance, cosine = torch.cat([r[0] for r in rows]), torch.cat([r[1] for r in rows])
    print(
        f"{name}: {distance.mean():.2f} mm (95 % {distance.quantile(0.95):.2f}), normals {cosine.mean():.3f}"
    )


@torch.no_grad()
def expression(head: Head, heads: IctHeads, data: Path, count: int) -> None:
    """Measures both deformations on unseen identities.

    The poses come from held-out takes, then from single shapes.
    """
    random = torch.Generator().manual_seed(UNSEEN_SEED + 1)
    poses = Poses(data, held_out=True)
    kinds = {"facegood_zh": poses.captured, "grid_s1": poses.tracked}
    sets = {name: rows[torch.randint(0, len(rows), (count * POSES_OF_EACH,), generator=random)]
            for name, rows in kinds.items()}  # fmt: skip
    for names in (["cheekPuff"], ["cheekSquintLeft", "cheekSquintRight"], ["jawOpen"]):
        row = torch.zeros(1, len(CHANNELS))
        row[0, [CHANNELS.index(n) for n in names]] = 1.0
        sets[names[0]] = row.expand(count, -1)
    coefficients = unseen(count)
    canonical, scales = heads.canonical(coefficients)
    z = head.identity_code(coefficients)
    marks = heads.opened[heads.landmarks[48:]]
    lips = torch.cdist(heads.opened[:FACE_VERTICES], marks).amin(1) < LIPS_M
    size = head.config.scale_m
    for name, weights in sets.items():
        rows: dict[str, list[Tensor]] = {"no motion": [], "forward": [], "backward": [], "there and back": []}
        for number, part in enumerate(weights.split(len(weights) // count)):
            skin = canonical[number, :FACE_VERTICES]
            modes = scales[number] * heads.modes[:, :FACE_VERTICES]
            at_rest = skin - torch.einsum("m,mvc->vc", heads.rest, modes)
            truth = at_rest + torch.einsum("bm,mvc->bvc", part, modes)
            one = z[number : number + 1].expand(len(part), -1)
            code = head.expression(part)
            anchors = head.identity.anchors(one)
            place = head.place(skin[None] / size, one[:1])
            predicted = skin + size * head.forward_field.move(place, one, anchors, code)
            rows["no motion"].append((at_rest - truth).norm(dim=-1))
            rows["forward"].append((predicted - truth).norm(dim=-1))
            few = torch.arange(0, FACE_VERTICES, 7)
            back = size * head.canonical(truth[:4, few] / size, one[:4], code[:4])
            rows["backward"].append((back - skin[few]).norm(dim=-1))
            again = size * head.canonical(predicted[:4, few] / size, one[:4], code[:4])
            rows["there and back"].append((again - skin[few]).norm(dim=-1))
        for kind, errors in rows.items():
            error = 1e3 * torch.cat(errors)
            at_lips = lips if error.shape[1] == FACE_VERTICES else lips[::7]
            print(f"{name}, {kind}: mean {error.mean():.2f} mm, lips {error[:, at_lips].mean():.2f} mm")


@torch.no_grad()
def shapes(head: Head, heads: IctHeads, _data: Path, count: int) -> None:
    """Measures each ARKit shape at weight 1, from rest.

    Prints how much of the true motion the field makes, and the error of vertices that the shape moves by more
    than half a millimetre.
    """
    canonical, scales = heads.canonical(unseen(count))
    z, size = head.identity_code(unseen(count)), head.config.scale_m
    skin = canonical[:, :FACE_VERTICES] / size
    rest = head.posed(skin, z, head.expression(torch.zeros(count, len(CHANNELS))))
    for number, name in enumerate(CHANNELS):
        code = head.expression(torch.eye(len(CHANNELS))[number].expand(count, -1))
        predicted = 1e3 * size * (head.posed(skin, z, code) - rest)
        truth = 1e3 * scales[:, None, None] * heads.modes[number, :FACE_VERTICES]
        moved = truth.norm(dim=-1) > MOVED_MM
        share = (predicted * truth).sum() / truth.square().sum()
        off, way = (x.norm(dim=-1)[moved].mean() for x in (predicted - truth, truth))
        print(f"{name}: {share:.2f} of the true motion, error {off:.2f} mm of {way:.2f}")


@torch.no_grad()
def closure(head: Head, heads: IctHeads, _data: Path, count: int) -> None:
    """Measures the gaps of lips at rest and of shut lids, moved there from the canonical pose.

    A gap is that of pairs of vertices along the true surface's normal. It is printed beside the gap of the
    mesh itself. A negative gap means that they have crossed.
    """
    rest, shut = torch.zeros(len(CHANNELS)), torch.zeros(len(CHANNELS))
    shut[LIDS] = 1.0
    canonical, scales = heads.canonical(unseen(count))
    z, size = head.identity_code(unseen(count)), head.config.scale_m
    for name, pairs, weights in (
        ("lips at rest", lip_pairs(heads), rest),
        ("lids shut", lid_pairs(heads), shut),
    ):
        moved = torch.einsum("m,mvc->vc", weights - heads.rest, heads.modes)
        truth = canonical + scales[:, None, None] * moved
        normals = vertex_normals(truth, heads.triangles)
        upper, lower = pairs.T
        code = head.expression(weights.expand(count, -1))
        both = torch.cat([upper, lower])
        predicted = size * head.posed(canonical[:, both] / size, z, code)
        a, b = predicted.split(len(upper), 1)
        along = F.normalize(normals[:, lower] - normals[:, upper], dim=-1)
        gap = 1e3 * ((a - b) * along).sum(-1)
        mesh_gap = 1e3 * ((truth[:, upper] - truth[:, lower]) * along).sum(-1)
        error = (gap - mesh_gap).abs()
        print(
            f"{name}, {len(upper)} pairs: gap {gap.mean():.2f} mm, the mesh's {mesh_gap.mean():.2f}; differs "
            f"by {error.mean():.2f} mm in the mean, 95 % {error.quantile(0.95):.2f}, most {error.max():.2f}"
        )


def sequences(head: Head, heads: IctHeads, data: Path, count: int) -> None:
    """Fits noisy point clouds from stretches of held-out takes, by eq. 16 and frame by frame.

    The codes mapped from the true weights, and rest, are measured beside them.
    """
    poses = Poses(data, held_out=True)
    random = torch.Generator().manual_seed(UNSEEN_SEED + 2)
    coefficients = unseen(count)
    canonical, scales = heads.canonical(coefficients)
    fit = SequenceFit()
    alone = replace(fit, group=1, shared=0)
    errors: dict[str, list[Tensor]] = {}
    for number in range(count):
        first = int(torch.randint(0, len(poses.captured) - fit.group, (1,), generator=random))
        weights = poses.captured[first : first + fit.group]
        moved = torch.einsum("bm,mvc->bvc", weights - heads.rest, heads.modes)
        posed = canonical[number] + scales[number] * moved
        points = [face_points(heads, v, CLOUD_POINTS, UNSEEN_SEED + number) for v in posed]
        clouds = [p + NOISE_M * torch.randn(p.shape, generator=random) for p, _ in points]
        with torch.no_grad():
            z = head.identity_code(coefficients[number])
            rest = head.expression(torch.zeros(1, len(CHANNELS)))[0]
        rows = {
            "eq. 16": fit_sequence(head, clouds, z, fit, rest),
            "frame by frame": fit_sequence(head, clouds, z, alone, rest),
            "mapped weights": head.expression(weights).detach(),
            "rest": rest.expand(len(weights), -1),
        }
        skin = canonical[number, :FACE_VERTICES]
        for name, codes in rows.items():
            with torch.no_grad():
                x = torch.stack([p for p, _ in points]) / head.config.scale_m
                s = head(x, z.expand(len(x), -1), codes).abs() * head.config.scale_m
                predicted = head.config.scale_m * head.posed(
                    (skin / head.config.scale_m).expand(len(codes), -1, -1), z.expand(len(codes), -1), codes
                )
            errors.setdefault(f"{name}: surface mm", []).append(1e3 * s.mean())
            errors.setdefault(f"{name}: jerk mm", []).append(
                1e3 * predicted.diff(n=3, dim=0).norm(dim=-1).mean()
            )
            apart = (predicted - posed[:, :FACE_VERTICES]).norm(dim=-1).mean()
            errors.setdefault(f"{name}: vertices mm", []).append(1e3 * apart)
    for name, values in errors.items():
        print(f"sequences, {name} {torch.stack(values).mean():.3f}")


MEASURES = {
    "identity": identity,
    "makehuman": makehuman,
    "expression": expression,
    "closure": closure,
    "shapes": shapes,
    "sequences": sequences,
}


def main() -> None:
    """Entry of the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--head", type=Path, default=shipped("facetalk_compact"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--cache", type=Path, default=Path("runs/cache"))
    parser.add_argument("--heads", type=int, default=10)
    parts = list(MEASURES)
    parser.add_argument("--parts", nargs="*", choices=parts, default=parts[:5])
    arguments = parser.parse_args()
    head = load_head_and_motions(arguments.head)[0]
    heads = IctHeads(arguments.data, arguments.cache, head.config.open_jaw)
    for part in arguments.parts:
        MEASURES[part](head, heads, arguments.data, arguments.heads)


if __name__ == "__main__":
    main()
