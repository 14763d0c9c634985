"""Makes the model `head_topology`: a head of clean quads shaped by ICT's coefficients and MakeHuman's traits.

    python -m training.head_topology.make --data ../shared/data

MakeHuman's base mesh (CC0), cut at the collar, is fitted to ICT FaceKit's mean face. Each vertex then moves
like the place of ICT's skin that it lies on. Traits (age, sex, weight, ancestry …) are MakeHuman's own
targets. Teeth, eyes, tongue, lashes and brows are our own shapes, which follow the skin or ICT's parts.
Nothing is trained, and the same command writes the same bytes.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import load_file
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from training import DATA, shipped
from training.align import similarity
from training.default_head import parts
from training.default_head.make import EYEBALLS, TEETH
from training.default_head.parts import Part
from training.flags import run_command
from training.head_topology import hair, teeth
from training.head_topology.fit import Fit, Target, Template, carried, cut, fit, shares
from training.head_topology.makehuman import MakeHuman
from training.head_topology.quads import normals
from training.head_topology.shape import neighbour_means
from training.landmarks.canonical import from_ict
from training.nn.checkpoint import write_model

STEP_M = 8e-6
"""Modes are stored as whole multiples of this length."""
EXTREME = 3.0
"""A slider applies its target in full at this value."""
ANCESTRIES = ("african", "asian", "caucasian")
SEXES = ("female", "male")
HELPERS = {
    "eye_left": "helper-l-eye",
    "eye_right": "helper-r-eye",
}
"""MakeHuman's group for each of our eyes. Traits shift and scale the eye like that group."""
UPPER_JAW, LOWER_JAW = [31, 33, 35, 50, 51, 52], [56, 57, 58]
BONES = {"teeth_upper": UPPER_JAW, "teeth_lower": LOWER_JAW, "tongue": LOWER_JAW}
"""Landmarks of the skin that teeth and tongue follow when traits move the jaws.

MakeHuman's own teeth are not used for this, because they move away from the skin by 6 mm.
"""
DETAILS = (
    ("nose depth", 1.0, ["nose/nose-scale-depth"]),
    ("nose breadth", 1.0, ["nose/nose-scale-horiz"]),
    ("chin", 1.0, ["chin/chin-prominent"]),
    ("jaw breadth", 1.0, ["chin/chin-width"]),
    ("ear size", 0.5, ["ears/l-ear-scale", "ears/r-ear-scale"]),
    ("ears off the head", 1.0, ["ears/l-ear-wing", "ears/r-ear-wing"]),
)
"""Name of each slider, the share of its targets at full strength, and MakeHuman's targets."""
MATERIALS = (
    "skin", "lips", "mouth", "sockets", "eye_white", "iris", "pupil", "teeth", "gums", "tongue",
    "lashes", "brows",
)  # fmt: skip
LIPS_REACH_CM = 2.5
THICK_CM = 0.9
"""The mouth's bag stays this far behind cheeks and chin, and less far near the lips."""
SOCKET_OVER_BALL = 1.04
EYE_CLEARANCE = 0.985
"""Size of our eyeball relative to ICT's. It is smaller, because the lids have some thickness."""


@dataclass
class Follower:
    """A part that follows the head.

    It moves either with the skin (`corners` and their weights `shares`, both `[P, 3]`), or by `moves`
    `[K, 4]`: a shift (three numbers) and growth about its middle.
    """

    part: Part
    corners: np.ndarray | None = None
    shares: np.ndarray | None = None
    moves: np.ndarray | None = None


def traits(makehuman: MakeHuman) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Displacement of the body by each slider, fully right and fully left, `[V, 3]` centimetres each."""
    target = makehuman.target

    def grown(sex: str, age: str, weight: str = "averageweight") -> np.ndarray:
        ancestry = sum(target(f"macrodetails/{name}-{sex}-{age}") for name in ANCESTRIES) / len(ANCESTRIES)
        return ancestry + target(f"macrodetails/universal-{sex}-{age}-averagemuscle-{weight}")

    def both(age: str, weight: str = "averageweight") -> np.ndarray:
        return sum(grown(sex, age, weight) for sex in SEXES) / len(SEXES)

    adult, man = both("young"), grown("male", "young")
    young = {name: [target(f"macrodetails/{name}-{sex}-young") for sex in SEXES] for name in ANCESTRIES}
    of_ancestry = {name: sum(both) / len(both) for name, both in young.items()}
    mean = sum(of_ancestry.values()) / len(ANCESTRIES)
    sliders = {
        "age": (both("old") - adult, both("child") - adult),
        "sex": (man - adult, adult - man),
        "weight": tuple(
            both("young", f"{extreme}weight") - adult + target(f"head/head-fat-{side}")
            for extreme, side in (("max", "incr"), ("min", "decr"))
        ),
    }
    for name, place in of_ancestry.items():
        sliders[name] = (place - mean, mean - place)

    for name, share, targets in DETAILS:
        sides = ([target(f"{one}-{side}") for one in targets] for side in ("incr", "decr"))
        sliders[name] = tuple(share * sum(side) for side in sides)
    return sliders


def straightened(moved: np.ndarray, body: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Removes from a displacement the shift, scaling and turn that it gives the body's vertices `face`."""
    back = similarity((body + moved)[face], body[face])
    return back(body + moved) - body


def lips_together(template: Template, points: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Corrects displacements `[K, V, 3]` so that the rims of the lips keep their distance.

    MakeHuman's ancestries would part the lips.
    """
    rim = template.rims[0]
    turn = rim.index(int(template.landmarks[64]))
    upper, lower = rim[: turn + 1], [rim[0], *rim[:turn:-1], rim[turn]]
    fixes = np.zeros_like(moved)
    for one, other in ((upper, lower), (lower, upper)):
        here, there = shares(points[one]), shares(points[other])
        across = np.interp(here, there, np.arange(len(there)))
        low = np.minimum(across.astype(int), len(there) - 2)
        part = (across - low)[None, :, None]
        partner = (1 - part) * moved[:, np.array(other)[low]] + part * moved[:, np.array(other)[low + 1]]
        fixes[:, one] = 0.5 * (partner - moved[:, one])
    far = cKDTree(points[rim]).query(points)[0] > LIPS_REACH_CM
    strength = np.where(far, 1.0, 0.0)
    strength[rim] = 10.0
    laplacian = template.mesh.laplacian()
    system = laplacian.T @ laplacian + sparse.diags(strength + 1e-9)
    solve = splu(system.tocsc()).solve
    return moved + np.stack([solve(strength[:, None] * fix) for fix in fixes])


def moves_of(points: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Sums up displacements `[K, N, 3]` as `[K, 4]`: a shift, and growth about the middle."""
    away = points - points.mean(0)
    growth = np.einsum("knd,nd->k", moved, away) / (away**2).sum()
    return np.c_[moved.mean(1), growth]


def under_skin(template: Template, fitted: Fit) -> np.ndarray:
    """Places `[V, 3]`, with the mouth's bag pushed back so far that cheeks and chin are thick enough."""
    points, inside = fitted.points.copy(), template.mouth
    outward = normals(points, template.mesh.triangles)
    over = fitted.over[:, :6]
    depth = np.einsum("vkd,vkd->vk", points[over] - points[:, None], outward[over]).min(1)
    from_rim = cKDTree(points[template.rims[0]]).query(points)[0]
    target_depth = np.clip(THICK_CM * (from_rim - 0.3) / 1.0, 0.0, THICK_CM)
    push = np.where(inside, np.maximum(target_depth - depth, 0.0), 0.0)
    goal = points - push[:, None] * outward[over].mean(1)
    laplacian = template.mesh.laplacian()
    firm = np.where(inside, 0.3, 1e3)
    system = (laplacian.T @ laplacian + sparse.diags(firm)).tocsc()
    return points + splu(system).solve(firm[:, None] * (goal - points))


def off_balls(points: np.ndarray, sockets: np.ndarray, balls: list[Part]) -> np.ndarray:
    """Pushes the sockets outwards where they would cut into the eyeballs."""
    points = points.copy()
    for ball in balls:
        centre, radius = parts.fit_sphere(ball.points)
        away = points - centre
        far = np.linalg.norm(away, axis=1)
        within = sockets & (far < SOCKET_OVER_BALL * radius) & (away[:, 2] < 0.6 * radius)
        points[within] = centre + away[within] * (SOCKET_OVER_BALL * radius / far[within])[:, None]
    return points


def face_materials(template: Template, points: np.ndarray) -> np.ndarray:
    """The number in `MATERIALS` of each quad of the skin, `[Q]`."""
    outer = template.mesh.loop(template.landmarks[48:60].tolist(), points)
    within = template.mesh.behind(outer, int(template.landmarks[62]))
    mouth = template.mouth.copy()
    mouth[template.rims[0]] = True
    within[outer] = True
    quads = template.mesh.faces
    kinds = np.zeros(len(quads), int)
    kinds[within[quads].all(1)] = MATERIALS.index("lips")
    kinds[mouth[quads].all(1)] = MATERIALS.index("mouth")
    sockets = template.sockets.copy()
    sockets[template.rims[1] + template.rims[2]] = True
    kinds[sockets[quads].all(1)] = MATERIALS.index("sockets")
    return kinds


def eye_parts(neutral: np.ndarray) -> list[Part]:
    """Both eyeballs, a little smaller than ICT's."""
    balls = [parts.eye(name, neutral[a : b + 1]) for name, (a, b) in EYEBALLS.items()]
    for ball in balls:
        middle, _ = parts.fit_sphere(ball.points)
        ball.points = middle + EYE_CLEARANCE * (ball.points - middle)
    return balls


def rigid_parts(neutral: np.ndarray) -> list[tuple[Part, slice]]:
    """Eyes, teeth and tongue, each with the ICT vertices that it follows."""
    rows = {name: slice(a, b + 1) for name, (a, b) in {**EYEBALLS, **TEETH}.items()}
    upper, lower = (neutral[rows[name]] for name in TEETH)
    upper_parts = [
        *eye_parts(neutral),
        teeth.row("teeth_upper", upper, True),
        teeth.row("teeth_lower", lower, False),
    ]
    return [(part, rows[part.name]) for part in upper_parts] + [(parts.tongue(lower), rows["teeth_lower"])]


def hairs(template: Template, points: np.ndarray, eyes: list[Part]) -> list[Follower]:
    """Lashes and brows."""
    skin, marks, hair_parts = hair.Skin(points, template.mesh.triangles), template.landmarks, []
    rims = [("left", [42, 43, 44, 45, 46, 47]), ("right", [39, 38, 37, 36, 41, 40])]
    for (side, rim), eye in zip(rims, eyes, strict=True):
        centre, _ = parts.fit_sphere(eye.points)
        upper, lower = ([rim[n] for n in corners] for corners in ((0, 1, 2, 3), (0, 5, 4, 3)))
        lines = [way(template, marks[line], points) for line in (upper, lower)]
        hair_parts.append(hair.lashes(f"lashes_{side}", *lines, centre))
    for side, numbers in (("left", range(22, 27)), ("right", range(21, 16, -1))):
        hair_parts.append(hair.brow(f"brow_{side}", skin, points[marks[list(numbers)]]))
    return [Follower(part, *skin.under(part.points)) for part in hair_parts]


def way(template: Template, vertices: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Places along the rim, on the shortest path through `vertices`."""
    ends = list(zip(vertices, vertices[1:], strict=False))
    numbers = [v for a, b in ends for v in template.mesh.path(int(a), int(b), points)[:-1]]
    return points[[*numbers, int(vertices[-1])]]


def faces_of(followed: list[Follower], first: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Triangles as faces `[F, 4]` that repeat their last corner, and the materials of the faces."""
    faces, kinds = [], []
    for follower in followed:
        for material, triangles in follower.part.faces.items():
            faces.append(triangles[:, [0, 1, 2, 2]] + first)
            kinds.append(np.full(len(triangles), MATERIALS.index(material)))
        first += len(follower.part.points)
    return faces, kinds


def encode_modes(faces: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """Encodes modes `[K, S, 3]`, given in steps, as `[K, 3, S]`.

    Each vertex stores what it adds to the mean of its earlier neighbours. The mean is taken over the
    rounded values already stored, so that no vertex is off by more than half a step.
    """
    means = neighbour_means(faces, modes.shape[1])
    added, stored = np.zeros_like(modes), np.zeros_like(modes)
    for vertex in range(modes.shape[1]):
        row = slice(*means.indptr[vertex : vertex + 2])
        mean = np.einsum("n,knd->kd", means.data[row], stored[:, means.indices[row]])
        added[:, vertex] = np.round(modes[:, vertex] - mean)
        stored[:, vertex] = mean + added[:, vertex]
    return added.transpose(0, 2, 1)


def part_config(part: Part) -> dict:
    """The entry of a part in the config."""
    faces = sum(len(of_material) for of_material in part.faces.values())
    return {"name": part.name, "vertices": len(part.points), "faces": faces}


def uv_of(body, template: Template) -> np.ndarray:
    """MakeHuman's texture coordinates of the skin, `[Q, 4, 2]`, scaled to fit the unit square."""
    places = body.uv[body.uv_quads[template.faces]]
    low, high = places.min((0, 1)), places.max((0, 1))
    return (places - low) / (high - low).max()


def build(data: Path) -> tuple[dict[str, np.ndarray], dict]:
    """The arrays and the config of the model."""
    ict = load_file(data / "faces/ict_facekit.safetensors")
    neutral, moved = ict["neutral"].astype(np.float64), ict["identity"].astype(np.float64)
    target = Target(neutral, ict["triangles"], ict["polygons"], ict["landmarks68"])
    makehuman = MakeHuman()
    body = makehuman.body
    template = cut(body, load_file(data / "faces/makehuman_head.safetensors"), target)
    fitted: Fit = fit(template, target)
    points = under_skin(template, fitted)
    points = off_balls(points, template.sockets, eye_parts(neutral))
    sliders = traits(makehuman)
    face = template.vertices[~(template.mouth | template.sockets) & (template.start[:, 1] > -6)]
    details = [name for name, _, _ in DETAILS]
    both = [
        (side if name in details else straightened(side, body.points, face)) / EXTREME
        for name, pair in sliders.items()
        for side in pair
    ]
    turned = np.stack(both) @ np.asarray(template.onto.rotation).T * float(template.onto.scale)
    with_traits = lips_together(template, points, turned[:, template.vertices])
    skin = np.concatenate([carried(template, fitted, moved), with_traits])
    rigid, followed = rigid_parts(neutral), []
    for part, rows in rigid:
        if part.name in HELPERS:
            helper = body.groups[HELPERS[part.name]]
            by_trait = moves_of(template.onto(body.points[helper]), turned[:, helper])
        else:
            bone = template.landmarks[BONES[part.name]]
            by_trait = moves_of(points[bone], with_traits[:, bone])
        moves = np.concatenate([moves_of(neutral[rows], moved[:, rows]), by_trait])
        followed.append(Follower(part, moves=moves))
    followed += hairs(template, points, [part for part, _ in rigid[:2]])
    places = np.concatenate([points, *(follower.part.points for follower in followed)])
    part_faces, part_kinds = faces_of(followed, len(points))
    kinds = face_materials(template, points)
    order = np.argsort(kinds, kind="stable")
    state = {
        "positions": from_ict(places),
        "modes": encode_modes(template.mesh.faces, skin * 0.01 / STEP_M),
        "faces": np.concatenate([template.mesh.faces[order], *part_faces]),
        "materials": np.concatenate([kinds[order], *part_kinds]),
        "uv": uv_of(body, template)[order],
        "landmarks": template.landmarks,
    }
    for follower in followed:
        name = follower.part.name
        if follower.moves is not None:
            state[f"{name}.moves"] = follower.moves * [0.01, 0.01, 0.01, 1.0]
        else:
            state |= {f"{name}.corners": follower.corners, f"{name}.shares": follower.shares}
    config = {
        "name": "head_topology",
        "step_m": STEP_M,
        "skin_vertices": len(points),
        "skin_faces": len(template.mesh.faces),
        "traits": list(sliders),
        "materials": list(MATERIALS),
        "parts": [part_config(follower.part) for follower in followed],
    }
    return state, config


def main(data: Path = DATA, out: Path | None = None) -> None:
    """Entry of the command."""
    state, config = build(data)
    tensors = {name: torch.from_numpy(np.ascontiguousarray(value)).float() for name, value in state.items()}
    exact = tuple(name for name in tensors if name != "modes")
    print(write_model(out or shipped("head_topology"), tensors, config, exact))
    print(
        f"{len(state['positions'])} vertices, {len(state['faces'])} faces, {config['skin_vertices']} of skin"
    )


if __name__ == "__main__":
    run_command(main)
