"""The rig of a face, and which of its bones and numbers may move it."""

from dataclasses import dataclass

import bpy

from ...core import control_names
from ...core.errors import AnyfaceError
from . import control_kinds
from .control_kinds import COLLECTIONS, Control

BONE, NUMBER = "BONE", "NUMBER"
# Bones with these prefixes are moved by other bones.
_INNER = ("DEF-", "ORG-", "MCH-", "VIS-", "VIS_", "WGT-")


@dataclass(frozen=True)
class Source:
    """A bone of a data-block, by its name, or a number, by its data path.

    If `sided`, its two directions may do different things, because it drives something.
    """

    kind: str
    block: bpy.types.ID
    name: str
    sided: bool = False

    @property
    def label(self) -> str:
        """The name that the artist knows: the bone, or the property."""
        if self.kind == BONE or not self.name.endswith("]"):
            return self.name
        owner, _, last = self.name.rpartition("[")
        return last.strip("]\"'") if last[0] in "\"'" else f"{owner} {'XYZW'[int(last[:-1])]}"

    @property
    def key(self) -> tuple:
        """The key that distinguishes it from other sources."""
        return self.kind, self.block.name, self.name

    def controls(self, reach: float) -> list[Control]:
        """Its controls. Bones without limits move up to `reach` from rest."""
        if self.kind == NUMBER:
            controls = [control_kinds.number(self.block, self.name)]
        else:
            bone = self.block.pose.bones.get(self.name)
            if bone is None:
                return []
            controls = [control_kinds.location(self.block, bone, reach)]
            controls.append(control_kinds.rotation(self.block, bone))
        return [control for control in controls if control is not None and control.indices]


def rig_of(ob):
    """The armature that moves `ob`: in its modifiers, among its parents, or read by its drivers."""
    candidates = [m.object for m in ob.modifiers if m.type == "ARMATURE" and m.object is not None]
    parent = ob.parent
    while parent is not None:
        candidates.append(parent)
        parent = parent.parent
    candidates += [target for _, target, _ in _targets(_blocks(ob, None))]
    return next((other for other in candidates if getattr(other, "type", "") == "ARMATURE"), None)


def has_any(ob) -> bool:
    """Whether anything may move the face `ob`."""
    return rig_of(ob) is not None or any(True for _ in _targets(_blocks(ob, None)))


def propose(ob, rig, left_alone: list[str]) -> list[Source]:
    """Sources that may move the face `ob`: first those that drivers read, then bones of `rig`.

    `rig` may be None. The bones are those in a list of names that fits, or else all visible ones.
    Names in `left_alone` are left out.
    """
    sources = {source.key: source for source in _driving(ob, rig)}
    if rig is not None:
        free = [bone for bone in rig.pose.bones if not _follows(bone)]
        visible = [bone.name for bone in free if _is_seen(rig, bone)]
        _, named = control_names.guess([bone.name for bone in free])
        for name in named or visible:
            source = Source(BONE, rig, name, name in _acting(rig))
            sources.setdefault(source.key, source)
    return [source for source in sources.values() if source.name not in left_alone]


def of_preset(rig, preset: str) -> list[Source]:
    """The bones of `rig` that a list of names contains."""
    names = control_names.fitting(preset, [bone.name for bone in rig.pose.bones])
    return [Source(BONE, rig, name, name in _acting(rig)) for name in names]


def find(kind: str, id_type: str, block: str, name: str, sided: bool) -> Source:
    """The source that a stored row names; raises `AnyfaceError("input")` where it is gone."""
    data_block = getattr(bpy.data, COLLECTIONS.get(id_type, "objects")).get(block)
    if kind == NUMBER:
        there = data_block is not None and _leads(data_block, name)
    else:
        there = (
            data_block is not None
            and data_block.type == "ARMATURE"
            and name in data_block.pose.bones
        )
    if not there:
        raise AnyfaceError("input", f"{block} has no {name} any more: press Find Controls")
    return Source(kind, data_block, name, sided)


def _leads(block, path: str) -> bool:
    """Whether a data path leads somewhere."""
    try:
        block.path_resolve(path)
    except ValueError:
        return False
    return True


def _driving(ob, rig) -> list[Source]:
    """The sources that the drivers of a face and its rig read."""
    sources = []
    for variable, block, target in _targets(_blocks(ob, rig)):
        if block.id_type not in COLLECTIONS:
            continue
        if variable.type == "SINGLE_PROP":
            sources.append(_of_path(block, target.data_path))
        elif target.bone_target:
            sources.append(Source(BONE, block, target.bone_target, True))
        elif variable.type == "TRANSFORMS" and target.transform_type.startswith("LOC_"):
            axis = "XYZ".index(target.transform_type[-1])
            sources.append(Source(NUMBER, block, f"location[{axis}]", True))
    return [source for source in sources if source is not None]


def _of_path(block, path: str) -> Source | None:
    for bone in block.pose.bones if path.startswith("pose.bones[") else ():
        prefix = bone.path_from_id() + "."
        if path.startswith((prefix + "location", prefix + "rotation")):
            return Source(BONE, block, bone.name, True)
    return Source(NUMBER, block, path, True)


def _blocks(ob, rig) -> list:
    blocks = [ob, ob.data, ob.data.shape_keys]
    blocks += [rig, rig.data] if rig is not None else []
    return [block for block in blocks if block is not None]


def _targets(blocks: list):
    """Each variable of each driver, with the data-block that it reads, and its target."""
    for block in blocks:
        animation = block.animation_data
        for curve in animation.drivers if animation is not None else ():
            for variable in curve.driver.variables:
                for target in variable.targets:
                    if target.id is not None:
                        yield variable, target.id, target


def _acting(rig) -> set[str]:
    """Bones whose transform plays an action on other bones, through Action constraints."""
    every = [c for bone in rig.pose.bones for c in bone.constraints if c.type == "ACTION"]
    return {constraint.subtarget for constraint in every}


def _follows(bone) -> bool:
    """Whether a bone copies all transforms of another, so its own channels have no effect."""
    return any(
        c.type == "COPY_TRANSFORMS"
        and not c.mute
        and c.influence == 1.0
        and getattr(c, "mix_mode", "REPLACE") == "REPLACE"
        for c in bone.constraints
    )


def _is_seen(rig, bone) -> bool:
    if bone.name.startswith(_INNER) or getattr(bone, "hide", False) or bone.bone.hide:
        return False
    collections = bone.bone.collections
    return not len(collections) or any(c.is_visible_effectively for c in collections)
