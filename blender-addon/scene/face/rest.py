"""Where objects would stand if every armature were in its rest pose, without posing anything.

A face with an Armature modifier is read as it was modelled, not as it is posed. Other objects of
the face that hang on a bone (teeth, eyes) must therefore be moved back to where they are at rest.
"""

import numpy as np

# Constraints that tie an object to a bone in the way a parent does.
_HOLDING = {"CHILD_OF", "ARMATURE"}


def world(ob) -> np.ndarray:
    """`ob.matrix_world` `[4, 4]` as it would be in the rest pose."""
    return back(ob) @ _array(ob.matrix_world)


def back(ob, visited=()) -> np.ndarray:
    """The matrix `[4, 4]` that moves `ob` in the world from where it is posed to where it rests.

    `visited` holds the objects that hang on `ob`. Constraints may form a cycle, and the search ends
    when it comes back to one of them.
    """
    holder, bone = _holder(ob)
    if holder is None or holder in visited:
        return np.eye(4)
    visited = (*visited, ob)
    if not bone:
        return back(holder, visited)
    pose = holder.pose.bones[bone]
    here = _array(holder.matrix_world)
    # A bone is at matrix_local at rest and at matrix when posed, both in the armature's space.
    turn = _array(pose.bone.matrix_local) @ np.linalg.pinv(_array(pose.matrix))
    return back(holder, visited) @ here @ turn @ np.linalg.pinv(here)


def _holder(ob) -> tuple:
    """The object that carries `ob`, and the name of the bone that does.

    The name is "" if the whole object carries `ob`. The result is (None, "") if nothing does.
    """
    for constraint in ob.constraints:
        if constraint.type in _HOLDING and not constraint.mute and constraint.influence > 0.99:
            targets = constraint.targets if constraint.type == "ARMATURE" else [constraint]
            for target in targets:
                if target.target is not None:
                    return target.target, _bone(target.target, target.subtarget)
    if ob.parent is None:
        return None, ""
    return ob.parent, _bone(ob.parent, ob.parent_bone) if ob.parent_type == "BONE" else ""


def _bone(armature, name: str) -> str:
    return name if armature.pose is not None and name in armature.pose.bones else ""


def _array(matrix) -> np.ndarray:
    return np.array(matrix, dtype=np.float64)
