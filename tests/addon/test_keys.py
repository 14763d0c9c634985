"""Takes are written without losing anything that belongs to the artist."""

import bpy
import numpy as np
import pytest

from figures import basis, everything, grid, motion, own_keys, shape

START, SCENE_FPS, FRAMES = 11, 24.0, 30


@pytest.fixture
def make_take(addon):
    """`make_take(ob, mode)`: a take of random smooth motion, and its displacements."""

    def make(ob, mode="basis", seed=0, frames=FRAMES, fps=24.0):
        moved = motion(frames, len(ob.data.vertices), seed=seed)
        take = addon("core.take")
        if mode == "frames":
            return take.Take(fps, 5.0, mode, take.Frames(moved)), moved
        return take.Take(fps, 5.0, mode, basis(take, moved)), moved

    return make


def rest(ob):
    points = np.empty(len(ob.data.vertices) * 3, dtype=np.float32)
    ob.data.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


@pytest.mark.parametrize("mode", ["basis", "frames"])
def test_every_frame_shows_its_displacement(addon, make_take, mode):
    ob = grid()
    take, moved = make_take(ob, mode)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    base = rest(ob)
    for t in (0, 1, 7, FRAMES - 1):
        assert np.abs(shape(ob, START + t) - base - moved[t]).max() < 3e-5
    assert np.abs(shape(ob, START - 10) - base).max() < 1e-6
    assert np.abs(shape(ob, START + FRAMES + 10) - base).max() < 1e-6


def test_frames_lie_in_scene_time_at_other_rates(addon, make_take):
    ob = grid()
    take, moved = make_take(ob, fps=30.0)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    assert np.abs(shape(ob, START + 10 * 24 / 30) - rest(ob) - moved[10]).max() < 3e-5
    assert np.abs(shape(ob, START + 5 * 24 / 30) - rest(ob) - moved[5]).max() < 3e-5


def test_artists_keys_still_add_up(addon, make_take):
    ob = grid()
    own_keys(ob, "Smile", "Frown")
    before = shape(ob, START + 3)
    take, moved = make_take(ob)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    assert np.abs(shape(ob, START + 3) - before - moved[3]).max() < 3e-5


def artist_nothing(ob):
    """A plain mesh."""


def artist_keys(ob):
    own_keys(ob, "Smile", "Frown")
    ob.active_shape_key_index = 1


def artist_action(ob):
    shape_keys = own_keys(ob, "Smile", "Frown")
    block = shape_keys.key_blocks["Smile"]
    block.value = 0.2
    block.keyframe_insert("value", frame=1)
    block.value = 0.9
    block.keyframe_insert("value", frame=40)


def artist_driver(ob):
    shape_keys = own_keys(ob, "Smile")
    driver = shape_keys.key_blocks["Smile"].driver_add("value").driver
    driver.expression = "0.5"


def artist_nla(ob):
    artist_action(ob)
    animation = ob.data.shape_keys.animation_data
    track = animation.nla_tracks.new()
    track.strips.new("Take", 1, animation.action)
    animation.action = None


def artist_shared_mesh(ob):
    artist_action(ob)
    other = bpy.data.objects.new("Twin", ob.data)
    bpy.context.scene.collection.objects.link(other)


def artist_shared_action(ob):
    artist_action(ob)
    other = grid("Other")
    own_keys(other, "Smile")
    action = ob.data.shape_keys.animation_data.action
    other.data.shape_keys.animation_data_create().action = action


def artist_modifiers(ob):
    artist_keys(ob)
    ob.modifiers.new("Subdivision", "SUBSURF")
    ob.modifiers.new("Mirror", "MIRROR")


def artist_hidden(ob):
    artist_keys(ob)
    ob.hide_viewport = ob.hide_render = True
    ob.hide_set(True)


def artist_edit_mode(ob):
    artist_keys(ob)
    bpy.ops.object.mode_set(mode="EDIT")


ARTISTS = [
    artist_nothing,
    artist_keys,
    artist_action,
    artist_driver,
    artist_nla,
    artist_shared_mesh,
    artist_shared_action,
    artist_modifiers,
    artist_hidden,
    artist_edit_mode,
]


@pytest.mark.parametrize("artist", ARTISTS)
def test_remove_leaves_the_file_as_it_was(addon, make_take, artist):
    ob = grid()
    artist(ob)
    bpy.context.scene.frame_set(5)
    before = everything()
    for seed in (0, 1):
        take, _ = make_take(ob, seed=seed)
        addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
        bpy.context.scene.frame_set(5)
        assert everything() != before
    assert addon("scene.takes.remove").remove(ob)
    bpy.context.scene.frame_set(5)
    assert everything() == before
    assert not addon("scene.takes.remove").remove(ob)


@pytest.mark.parametrize("artist", ARTISTS)
def test_a_take_changes_nothing_of_the_artists(addon, make_take, artist):
    ob = grid()
    artist(ob)
    bpy.context.scene.frame_set(5)
    before = everything()
    take, _ = make_take(ob)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    bpy.context.scene.frame_set(5)
    ours = ("Anyface", "anyface", "eval_time")
    copied = artist in (artist_shared_mesh, artist_shared_action)
    after = set(everything())
    for row in before:
        # User counts and custom properties of the keys change, and copies have other names.
        if copied or row.startswith(("shape_keys", "meshes", "actions")):
            continue
        if row.startswith("  action None") or row.startswith(("  slot None", "  no animation")):
            continue
        assert row in after or any(word in row for word in ours), row
    for name in ("Smile", "Frown"):
        block = ob.data.shape_keys.key_blocks.get(name)
        assert block is None or not np.isnan(block.value)


def test_frames_mode_leaves_the_file_as_it_was(addon, make_take):
    ob = grid()
    before = everything()
    take, _ = make_take(ob, "frames")
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    assert not ob.data.shape_keys.use_relative
    addon("scene.takes.remove").remove(ob)
    assert everything() == before


def test_frames_mode_refuses_a_mesh_with_own_keys(addon, make_take):
    ob = grid()
    own_keys(ob, "Smile")
    before = everything()
    take, _ = make_take(ob, "frames")
    with pytest.raises(addon("core.errors").AnyfaceError, match="choose New Keys"):
        addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    assert everything() == before


def test_modes_replace_each_other(addon, make_take):
    ob = grid()
    before = everything()
    for mode in ("basis", "frames", "basis"):
        take, moved = make_take(ob, mode)
        addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
        assert np.abs(shape(ob, START + 4) - rest(ob) - moved[4]).max() < 3e-5
    bpy.context.scene.frame_set(1)
    addon("scene.takes.remove").remove(ob)
    assert everything() == before


def test_a_renamed_key_and_later_work_stay_at_rest(addon, make_take):
    ob = grid()
    take, _ = make_take(ob)
    before = rest(ob)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    blocks = ob.data.shape_keys.key_blocks
    blocks["Anyface.002"].name = "Kept"
    ob.shape_key_add(name="Later", from_mix=False)
    addon("scene.takes.remove").remove(ob)
    assert [block.name for block in ob.data.shape_keys.key_blocks] == ["Basis", "Kept", "Later"]
    assert ob.data.shape_keys.animation_data is None
    assert np.array_equal(shape(ob, START + 4), before)


def test_changed_copies_are_not_thrown_away(addon, make_take):
    ob = grid()
    artist_shared_mesh(ob)
    take, _ = make_take(ob)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    ob.data.vertex_colors.new(name="Painted")
    addon("scene.takes.remove").remove(ob)
    assert "Painted" in ob.data.attributes
    assert ob.data != bpy.data.objects["Twin"].data


def test_names_that_the_artist_took_are_left_alone(addon, make_take):
    ob = grid()
    own_keys(ob, "Anyface.001")
    before = everything()
    take, moved = make_take(ob)
    start = shape(ob, START + 2)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    assert np.abs(shape(ob, START + 2) - start - moved[2]).max() < 3e-5
    bpy.context.scene.frame_set(1)
    addon("scene.takes.remove").remove(ob)
    assert everything() == before


def test_a_take_survives_saving_and_loading(addon, make_take, tmp_path):
    ob = grid()
    own_keys(ob, "Smile")
    bpy.context.scene.frame_set(1)
    before = everything()
    take, _ = make_take(ob)
    addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    moved = shape(ob, START + 6)
    path = str(tmp_path / "shot.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    ob = bpy.data.objects["Head"]
    assert np.abs(shape(ob, START + 6) - moved).max() < 1e-6
    bpy.context.scene.frame_set(1)
    addon("scene.takes.remove").remove(ob)
    assert everything() == before


def test_a_changed_mesh_is_refused(addon, make_take):
    ob = grid()
    take, _ = make_take(grid("Other", side=5))
    with pytest.raises(addon("core.errors").AnyfaceError, match="expected 25 vertices, got 144"):
        addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
    assert ob.data.shape_keys is None


def test_linked_meshes_are_refused_in_words(addon, make_take, tmp_path):
    grid()
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, target):
        target.objects = ["Head"]
    ob = bpy.data.objects["Head"]
    bpy.context.scene.collection.objects.link(ob)
    take, _ = make_take(ob)
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"linked from.*make.*local"):
        addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)


def test_a_hundred_takes_leave_nothing_behind(addon, make_take):
    ob = grid(side=6)
    artist_action(ob)
    bpy.context.scene.frame_set(5)
    before = everything()
    for seed in range(100):
        take, _ = make_take(ob, seed=seed, frames=8)
        addon("scene.takes.keys").write(ob, take, START, SCENE_FPS)
        addon("scene.takes.remove").remove(ob)
    bpy.context.scene.frame_set(5)
    assert everything() == before
