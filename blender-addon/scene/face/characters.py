"""Three characters to try Anyface on, with skin and hair.

Their shapes come from the library's parametric head. Hair is a copy of the scalp, moved outwards,
and skin is a procedural shader.
"""

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.native_head import Heads, MadeHead, Recipe
from . import made_head, sample_head

BROWS, NOSE_TIP, EYES = slice(17, 27), 30, (slice(36, 42), slice(42, 48))
MOUTH = slice(48, 68)
"""The mouth's landmarks among the 68."""
EDGE_M = 0.03
"""Hair lies flat at its border and reaches its full thickness this many metres from it."""
SUNK_M = 0.0015
"""The border of the hair lies this many metres under the skin, so that nobody sees it."""


@dataclass(frozen=True)
class Character:
    """A recipe for a character.

    `traits` have the names of `Heads.directions`; colours are linear RGB. Hair is up to `hair_m`
    thick. `hairline` is where hair begins on the way from brows (0) to crown (1).
    """

    name: str
    seed: int
    traits: dict[str, float]
    skin: tuple[float, float, float]
    hair: tuple[float, float, float]
    iris: tuple[float, float, float]
    hair_m: float
    hairline: float
    nape: float
    """Height at which hair ends behind the ears: 0 at the eyes, 1 at the mouth."""
    eye_scale: float = 1.0
    freckles: float = 0.0
    bun_m: float = 0.0
    """Extra thickness of the hair at the back of the crown, in metres."""


CHARACTERS = {
    "WOMAN": Character(
        "Young Woman", 10, {"sex": -2.0, "age": -0.5, "mouth width": 0.5},
        (0.62, 0.36, 0.26), (0.12, 0.038, 0.014), (0.10, 0.22, 0.16), 0.028, 0.42, 1.2,
        freckles=0.5, bun_m=0.045,
    ),
    "MAN": Character(
        "Old Man", 3, {"sex": 2.0, "age": 2.6, "african": 0.6},
        (0.36, 0.18, 0.11), (0.42, 0.36, 0.28), (0.06, 0.035, 0.02), 0.010, 0.80, 1.0,
    ),
    "CARTOON": Character(
        "Big Eyes", 9, {"age": -1.6, "sex": -0.4, "nose breadth": -1.5, "nose forward": -1.0},
        (0.70, 0.42, 0.31), (0.55, 0.19, 0.05), (0.06, 0.24, 0.42), 0.040, 0.46, 1.1,
        eye_scale=1.4, freckles=0.8,
    ),
}  # fmt: skip


def make(heads: Heads, key: str) -> MadeHead:
    """The head of a character, without its hair."""
    character = CHARACTERS[key]
    names = heads.directions()
    changes = [0.0] * len(names)
    for name, value in character.traits.items():
        changes[names.index(name)] = value
    head = heads.make(Recipe(character.seed, changes=tuple(changes)))
    return replace(head, positions=with_large_eyes(head, character.eye_scale))


def dress(ob, head: MadeHead, key: str, height: float) -> None:
    """Gives the object of `head` its landmarks and colours, and hair as a child object."""
    character = CHARACTERS[key]
    ob.name = ob.data.name = character.name
    made_head.keep_landmarks(ob, head)
    colour(ob, character)
    hair(ob, head, character, height)


def with_large_eyes(head: MadeHead, scale: float) -> np.ndarray:
    """Positions `[V, 3]` with eyes, lids, lashes and sockets enlarged about the centre of each
    eye."""
    if scale == 1.0:
        return head.positions
    positions = head.positions.astype(np.float64)
    marks = positions[head.landmark_vertices]
    grown = positions.copy()
    for eye in EYES:
        centre = marks[eye].mean(axis=0)
        width = np.ptp(marks[eye][:, 0])
        away = np.linalg.norm((positions - centre) / width, axis=1)
        share = np.exp(-((away / 1.2) ** 2.6))
        grown += share[:, None] * (scale - 1.0) * (positions - centre)
    return grown


def hair(ob, head: MadeHead, character: Character, height: float) -> None:
    """Adds hair: a cap over the scalp, as an object that follows `ob`."""
    positions = head.positions.astype(np.float64)
    marks = positions[head.landmark_vertices]
    number = head.material_names.index("skin")
    faces = np.array([f for f, m in zip(head.faces, head.materials, strict=True) if m == number])
    inside = scalp(positions, marks, character)
    cap_faces = faces[inside[faces].all(axis=1)]
    used, corners = np.unique(cap_faces, return_inverse=True)
    cap_faces = corners.reshape(cap_faces.shape)
    points, normals = positions[used], vertex_normals(positions, faces)[used]
    share = np.clip(distance_to_border(points, cap_faces) / EDGE_M, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    points = points + normals * (share * thickness(points, marks, character) - SUNK_M)[:, None]
    upright = sample_head.standing(points, height, positions)
    material = hair_material(character)
    data = sample_head.smooth_mesh(
        f"{character.name} Hair",
        upright,
        made_head.polygons(cap_faces),
        [material],
        np.zeros(len(cap_faces), np.int32),
    )
    cap = bpy.data.objects.new(data.name, data)
    for collection in ob.users_collection:
        collection.objects.link(cap)
    cap.parent = ob
    smooth = cap.modifiers.new("Smooth", "SUBSURF")
    smooth.levels = smooth.render_levels = 1


def scalp(positions: np.ndarray, marks: np.ndarray, character: Character) -> np.ndarray:
    """Whether each vertex of `positions` `[V, 3]` carries hair, `[V]`.

    Hair grows above a line that runs over the forehead, above the ears and along the nape.
    """
    crown = positions[:, 1].max()
    brow = marks[BROWS][:, 1].max()
    eyes = np.mean([marks[eye][:, 1].mean() for eye in EYES])
    mouth = marks[MOUTH][:, 1].mean()
    middle = np.array(
        [0.0, (crown + eyes) / 2.0, (positions[:, 2].min() + marks[NOSE_TIP, 2]) / 2.0]
    )
    turn = np.degrees(np.arctan2(np.abs(positions[:, 0]), positions[:, 2] - middle[2]))
    front = brow + character.hairline * (crown - brow)
    over_ears = eyes + 0.75 * (brow - eyes) + 0.006
    nape = eyes + character.nape * (mouth - eyes)
    line = np.interp(
        turn,
        [0.0, 35.0, 62.0, 102.0, 122.0, 180.0],
        [front, front - 0.004, over_ears, over_ears, nape, nape],
    )
    return positions[:, 1] > line


def vertex_normals(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The normals `[V, 3]` of a mesh of quads."""
    a, b, c, d = (positions[faces[:, k]] for k in range(4))
    of_faces = np.cross(c - a, d - b)
    normals = np.zeros_like(positions)
    for k in range(4):
        np.add.at(normals, faces[:, k], of_faces)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def distance_to_border(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The distance of each vertex to the nearest vertex on the border, `[V]`."""
    edges = np.sort(np.concatenate([faces[:, [k, (k + 1) % 4]] for k in range(4)]), axis=1)
    pairs, count = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0, return_counts=True)
    border = points[np.unique(pairs[count == 1])]
    return np.array([np.linalg.norm(border - point, axis=1).min() for point in points])


def thickness(points: np.ndarray, marks: np.ndarray, character: Character) -> np.ndarray:
    """How far hair stands off the scalp, metres, `[V]`.

    It is thicker on the crown than at the sides, and wavy.
    """
    brow, crown = marks[BROWS][:, 1].max(), points[:, 1].max()
    height = np.clip((points[:, 1] - brow) / (crown - brow), 0.0, 1.0)
    turn = np.arctan2(points[:, 0], points[:, 2])
    locks = np.sin(9.0 * turn + 60.0 * points[:, 1]) * np.cos(5.0 * turn)
    bun = np.array([0.0, brow + 0.75 * (crown - brow), points[:, 2].min()])
    near = np.exp(-((np.linalg.norm(points - bun, axis=1) / 0.045) ** 2))
    return character.hair_m * (0.35 + 0.65 * height) * (1.0 + 0.2 * locks) + character.bun_m * near


def colour(ob, character: Character) -> None:
    """Sets the character's colours and shaders on the materials of its head."""
    for slot in ob.material_slots:
        name = slot.material.name.lower()
        shader = next(n for n in slot.material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
        if "skin" in name:
            skin(slot.material, shader, character)
        elif "lip" in name:
            tone = np.array(character.skin) * [1.0, 0.62, 0.66]
            shader.inputs["Base Color"].default_value = (*tone, 1.0)
            shader.inputs["Roughness"].default_value = 0.35
        elif "iris" in name:
            shader.inputs["Base Color"].default_value = (*character.iris, 1.0)
            shader.inputs["Roughness"].default_value = 0.05
        elif "brow" in name or "lash" in name:
            dark = np.array(character.hair) * (0.5 if "brow" in name else 0.1)
            shader.inputs["Base Color"].default_value = (*dark, 1.0)
        elif any(word in name for word in ("eye", "pupil", "cornea", "teeth", "tongue")):
            shader.inputs["Roughness"].default_value = 0.08


def skin(material, shader, character: Character) -> None:
    """Adds freckles and patches to the colour, pores to the bump, and subsurface scattering."""
    tree = material.node_tree
    new, link = tree.nodes.new, tree.links.new
    place = new("ShaderNodeTexCoord")

    def noise(scale: float, detail: float):
        node = new("ShaderNodeTexNoise")
        node.inputs["Scale"].default_value, node.inputs["Detail"].default_value = scale, detail
        link(place.outputs["Object"], node.inputs["Vector"])
        return node.outputs[0]

    def ramp(value, low: float, high: float, first, second):
        node = new("ShaderNodeValToRGB")
        link(value, node.inputs[0])
        ends = node.color_ramp.elements
        ends[0].position, ends[1].position = low, high
        ends[0].color, ends[1].color = (*first, 1.0), (*second, 1.0)
        return node.outputs[0]

    tone = np.array(character.skin)
    blush = tone * [1.05, 0.80, 0.78]
    base = ramp(noise(3.0, 2.0), 0.35, 0.7, tone, blush)
    spots = ramp(
        noise(70.0, 1.0),
        0.66,
        0.72,
        (1.0, 1.0, 1.0),
        1.0 - character.freckles * (1.0 - np.array([0.72, 0.52, 0.42])),
    )
    mix = new("ShaderNodeMix")
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    mix.inputs[0].default_value = 1.0
    link(base, mix.inputs[6])
    link(spots, mix.inputs[7])
    link(mix.outputs[2], shader.inputs["Base Color"])
    bump = new("ShaderNodeBump")
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.12, 0.01
    link(noise(160.0, 3.0), bump.inputs["Height"])
    link(bump.outputs[0], shader.inputs["Normal"])
    shader.inputs["Roughness"].default_value = 0.48
    shader.inputs["Subsurface Weight"].default_value = 0.12
    shader.inputs["Subsurface Radius"].default_value = (0.06, 0.02, 0.01)


def hair_material(character: Character):
    """A hair material: stretched noise in colour and bump looks like strands."""
    material = bpy.data.materials.new(f"{character.name} Hair")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    shader = next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED")
    place, stretch, strands, tint, bump = (
        tree.nodes.new(kind)
        for kind in (
            "ShaderNodeTexCoord",
            "ShaderNodeMapping",
            "ShaderNodeTexNoise",
            "ShaderNodeValToRGB",
            "ShaderNodeBump",
        )
    )
    stretch.inputs["Scale"].default_value = (60.0, 9.0, 5.0)
    strands.inputs["Scale"].default_value = 1.6
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.6, 0.04
    ends = tint.color_ramp.elements
    ends[0].position, ends[1].position = 0.3, 0.75
    ends[0].color, ends[1].color = (*(0.55 * np.array(character.hair)), 1.0), (*character.hair, 1.0)
    link = tree.links.new
    link(place.outputs["Object"], stretch.inputs["Vector"])
    link(stretch.outputs[0], strands.inputs["Vector"])
    link(strands.outputs[0], tint.inputs[0])
    link(strands.outputs[0], bump.inputs["Height"])
    link(tint.outputs[0], shader.inputs["Base Color"])
    link(bump.outputs[0], shader.inputs["Normal"])
    shader.inputs["Roughness"].default_value = 0.42
    return material
