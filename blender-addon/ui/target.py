"""The object and the sequencer that the panel shows."""

from ..core import key_names
from ..scene import outputs
from ..scene.face.mesh import LANDMARKS_PROPERTY

# Words in the names of heads, the best one first.
_HEADS = ("head", "face", "body")
# A mesh with this many keys of known names is a face.
_KNOWN_KEYS = 3


def target(context):
    """The character that the panel shows; None if that is no mesh.

    It is the picked object, or else the active object, or the head of an active armature.
    """
    picked = context.scene.anyface.character
    shown = picked if is_there(picked) else context.object
    if shown is not None and shown.type == "ARMATURE":
        shown = _head_of(shown, context.scene)
    return shown if shown is not None and shown.type == "MESH" else None


def _head_of(armature, scene):
    """The mesh on an armature that is most likely its face, or None."""
    meshes = [ob for ob in scene.objects if ob.type == "MESH" and _hangs_on(ob, armature)]
    return max(meshes, key=_likeness, default=None)


def _hangs_on(ob, armature) -> bool:
    if ob.parent == armature:
        return True
    return any(m.type == "ARMATURE" and m.object == armature for m in ob.modifiers)


def _likeness(ob) -> tuple:
    """How much a mesh looks like a face: by take, landmarks, known keys, name, size."""
    blocks = ob.data.shape_keys.key_blocks if ob.data.shape_keys is not None else ()
    known = len(key_names.guess([block.name for block in blocks])[1]) if blocks else 0
    name = ob.name.lower()
    word = next((-at for at, word in enumerate(_HEADS) if word in name), -len(_HEADS))
    signs = outputs.has_take(ob), LANDMARKS_PROPERTY in ob, known >= _KNOWN_KEYS
    return *signs, word, len(ob.data.vertices)


class OfFace:
    """An operator that works on the character; stands before `Operator`."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """False if the operator cannot work; Blender shows the reason."""
        reason = cls.why_not(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    @classmethod
    def why_not(cls, context) -> str:
        """The reason why the operator cannot work now, or ""."""
        return "" if target(context) is not None else "Pick a face mesh"


def is_there(ob) -> bool:
    """False for None, and for a deleted object that only a pointer still keeps in the file."""
    return ob is not None and len(ob.users_scene) > 0


def sequencer_scene(context):
    """The scene whose strips are heard; since Blender 5.0 it may differ from the active scene."""
    return getattr(context, "sequencer_scene", None) or context.scene
