"""Generates on a rig, undoes, lists controls and cancels in a real window (see test_window)."""

from test_heads import voice  # noqa: F401 - a fixture
from test_window import MORE, photographs, screen  # noqa: F401 - fixtures

# The jaw bone moves the part below the mouth, the lip bone moves the upper lip, and the head bone
# holds the rest.
RIG = """
import mathutils
ob = bpy.data.objects["Head"]
data = bpy.data.armatures.new("Rig")
rig = bpy.data.objects.new("Rig", data)
bpy.context.scene.collection.objects.link(rig)
rig.matrix_world = ob.matrix_world
window, area, region, _ = area_of('VIEW_3D')
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for name, head, tail in (("head", (0, 0, 0), (0, 0.1, 0)),
                             ("jaw", (0, 0, 0.0), (0, -0.09, 0.08)),
                             ("lip", (0, -0.045, 0.08), (0, -0.045, 0.1))):
        bone = data.edit_bones.new(name)
        bone.head, bone.tail = head, tail
        if name != "head":
            bone.parent = data.edit_bones["head"]
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.objects.active = ob
groups = {name: ob.vertex_groups.new(name=name) for name in ("head", "jaw", "lip")}
for vertex in ob.data.vertices:
    x, y, z = vertex.co
    jaw = min(max((-0.052 - y) / 0.01, 0.0), 1.0) * min(max((z - 0.0) / 0.04, 0.0), 1.0)
    away = (vertex.co - mathutils.Vector((0, -0.045, 0.08))).length
    lip = (1 - jaw) * max(0.0, 1.0 - away / 0.02)
    for name, weight in (("jaw", jaw), ("lip", lip), ("head", 1 - jaw - lip)):
        groups[name].add([vertex.index], weight, "REPLACE")
ob.modifiers.new("Armature", "ARMATURE").object = rig
ob.anyface.mode = "controls"
bpy.ops.ed.undo_push(message="rig")
answer = True
"""
ACTION = "bpy.data.objects['Rig'].animation_data and bpy.data.objects['Rig'].animation_data.action"


def test_a_rig_is_listed_speaks_is_undone_and_stopped(screen, photographs):  # noqa: F811
    assert screen.ask(RIG)
    screen.press("anyface.generate")
    screen.wait(f"({ACTION}) and not running()")
    screen.ask("bpy.context.scene.frame_set(50)")
    screen.hand("sleep", "0.5")
    screen.photograph(photographs / "1_rig_controls.png")
    report = screen.ask("answer = bpy.data.objects['Head'].anyface.report")
    assert "controls of the rig show" in report
    screen.hand("mousemove", 400, 400, "key", "ctrl+z")
    screen.wait(f"not ({ACTION})")
    screen.ask(MORE.format(True))
    screen.hand("sleep", "0.5")
    screen.scroll(5)
    screen.press("anyface.controls_find")
    screen.wait("len(bpy.data.objects['Head'].anyface_controls.rows) and not running()")
    rows = screen.ask("answer = [r.name for r in bpy.data.objects['Head'].anyface_controls.rows]")
    assert sorted(rows) == ["jaw", "lip"]
    screen.hand("sleep", "3")
    screen.photograph(photographs / "2_list.png")
    screen.scroll(4)
    screen.press("anyface.generate")
    screen.wait("running()", 20)
    screen.hand("mousemove", 400, 400, "key", "Escape")
    screen.wait("not running()", 20)
    assert not screen.ask(f"answer = bool({ACTION})")
