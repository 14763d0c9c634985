"""EmoFace's layers and model: spirals by hand, the convolution against loops, kept keys against all keys."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import torch

from training import shipped
from training.corpus.faces import CHANNELS
from training.export import export
from training.nn.biased_attention import BiasedSelfAttention, periodic_positions, temporal_bias
from training.nn.checkpoint import save
from training.nn.spiral_conv import SpiralConv3D, spirals
from training.systems.emoface import evaluate
from training.systems.emoface.folder_scores import face_of
from training.systems.emoface.model import EmoFace, Inputs, debug_config
from training.tests.test_parity import SHARED, needs_shared


def grid(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """A flat sheet facing +z, vertex number x + width·y."""
    points = np.array([[x, y, 0.0] for y in range(height) for x in range(width)])
    triangles = []
    for x, y in itertools.product(range(width - 1), range(height - 1)):
        a = x + width * y
        triangles += [[a, a + 1, a + width + 1], [a, a + width + 1, a + width]]
    return points, np.array(triangles)


def test_a_spiral_starts_at_the_top_and_turns_against_the_clock():
    points, triangles = grid(3, 3)
    # The middle of the sheet: its neighbours are 0, 1, 3, 5, 7, 8; the topmost are 7 and 8, of which 8 has
    # the larger x. Against the clock from there: 7, 3, 0, 1, 5.
    assert spirals(points, triangles, 7, 1)[4].tolist() == [4, 8, 7, 3, 0, 1, 5]
    assert spirals(points, triangles, 4, 2)[4].tolist() == [4, 7, 0, 5]


def test_a_border_fills_its_spiral_with_the_next_ring_and_then_the_nearest():
    points, triangles = grid(2, 2)
    assert spirals(points, triangles, 4, 1)[0].tolist() == [0, 3, 2, 1]
    # Two sheets that no edge joins: when the own one is used up, the nearest of the other follow.
    far = np.concatenate([points, points + [1.5, 0.0, 0.0]])
    both = np.concatenate([triangles, triangles + 4])
    assert spirals(far, both, 6, 1)[1].tolist()[4:] == [4, 6]


def test_a_tetrahedron_has_one_spiral_whatever_the_order_of_its_triangles():
    points = np.array([[0.0, 1, 0], [1, -1, 0], [-1, -1, 0], [0, 0, 1]])
    triangles = np.array([[0, 3, 1], [0, 2, 3], [3, 2, 1], [0, 1, 2]])
    rows = spirals(points, triangles, 4, 1)
    assert rows[3].tolist()[:2] == [3, 0]
    turned = np.roll(triangles[[2, 0, 3, 1]], 1, axis=1)
    assert np.array_equal(rows, spirals(points, turned, 4, 1))


def test_a_vertex_without_triangles_is_named():
    points, triangles = grid(2, 2)
    with pytest.raises(ValueError, match="none at vertex 4"):
        spirals(np.concatenate([points, [[9.0, 9, 9]]]), triangles, 3, 1)


def test_the_convolution_equals_four_loops_and_its_split_form():
    points, triangles = grid(4, 3)
    torch.manual_seed(0)
    conv = SpiralConv3D(spirals(points, triangles, 5, 2), 3, 2, delta=3)
    in_time, on_surface = torch.randn(2, 6, 3), torch.randn(12, 3)
    x = in_time[:, :, None] + on_surface
    slow = torch.zeros(2, 6, 12, 2)
    for b, t, v, d in itertools.product(range(2), range(6), range(12), range(3)):
        if t + d - 2 >= 0:
            gathered = x[b, t + d - 2, conv.spirals[v]]
            slow[b, t, v] += torch.einsum("ki,kio->o", gathered, conv.weight[d])
    slow += conv.bias
    assert torch.allclose(conv(x), slow, atol=1e-5)
    assert torch.allclose(conv.of_sum(in_time, on_surface), slow, atol=1e-5)


def test_the_bias_is_as_written_out():
    bias = temporal_bias(4, 2, period=2, look_back=3)
    first = torch.tensor([[0.0, 1, 1, 1], [-0.0, 0, 1, 1], [-1, 0, 0, 1], [1, -1, 0, 0]])
    hidden = torch.tensor([[0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 0, 1], [1, 0, 0, 0]], dtype=torch.bool)
    # ⌊1/2⌋ = 0 and ⌊2/2⌋ = 1 periods behind; the slope of the first of two heads is 1/16.
    expected = torch.tensor([[0.0, 0, 0, 0], [0, 0, 0, 0], [-1, 0, 0, 0], [0, -1, 0, 0]]) / 16
    assert first.shape == hidden.shape
    assert torch.equal(bias[0], expected.masked_fill(hidden, -torch.inf))


def test_positions_come_again_after_a_period():
    rows = periodic_positions(0, 12, 8, period=5)
    assert torch.equal(rows[:5], rows[5:10])
    assert torch.equal(periodic_positions(7, 2, 8, 5), rows[7:9])


def test_kept_keys_equal_recomputing_everything():
    torch.manual_seed(1)
    attention = BiasedSelfAttention(16, 4, period=5, look_back=12).eval()
    x, cache = torch.randn(1, 60, 16), []
    with torch.no_grad():
        rows = torch.cat([attention.step(x[:, t : t + 1], cache) for t in range(60)], dim=1)
        assert torch.allclose(rows, attention(x), atol=1e-6)
    assert len(cache) == 12


def model() -> EmoFace:
    """A debug model with last layers that say something."""
    points, triangles = grid(10, 9)
    torch.manual_seed(2)
    config = debug_config(len(points))
    face = EmoFace(config, spirals(points, triangles, config.kernel, config.dilation)).eval()
    for branch in (face.content, face.emotion):
        torch.nn.init.normal_(branch.motion_out.weight, std=0.05)
    return face


def inputs(face: EmoFace, frames: int) -> Inputs:
    """Random features of one row."""
    config = face.config
    return Inputs(
        torch.randn(1, frames, config.speech.channels),
        torch.randn(1, frames, config.emotion_channels),
        torch.tensor([1]),
        torch.linspace(0.0, 1.5, frames)[None],
    )


def test_a_new_model_leaves_the_template_at_rest():
    points, triangles = grid(10, 9)
    config = debug_config(len(points))
    face = EmoFace(config, spirals(points, triangles, config.kernel, config.dilation))
    assert not face.perform(inputs(face, 5)).motion.any()


def test_performing_equals_the_parallel_pass_on_what_was_performed():
    face = model()
    request = inputs(face, 20)
    performed = face.perform(request)
    before = torch.cat([torch.zeros_like(performed.motion[:, :1]), performed.motion[:, :-1]], dim=1)
    with torch.no_grad():
        again = face(before, request)
    for part in ("motion", "content", "emotion", "mask"):
        assert torch.allclose(getattr(again, part), getattr(performed, part), atol=1e-5)


def test_emotion_reaches_the_emotion_branch_and_the_mask_alone():
    face = model()
    request = inputs(face, 8)
    other = Inputs(request.content, torch.randn_like(request.emotion), request.style, request.level)
    before = torch.randn(1, 8, 3 * face.config.vertices)
    with torch.no_grad():
        one, two = face(before, request), face(before, other)
    assert torch.equal(one.content, two.content)
    assert not torch.allclose(one.emotion, two.emotion)
    assert not torch.allclose(one.mask, two.mask)


def test_a_model_folder_performs_as_the_run_that_it_was_exported_from(tmp_path: Path):
    face = model()
    points, triangles = grid(10, 9)
    template = {"vertices": torch.from_numpy(points), "triangles": torch.from_numpy(triangles)}
    save(tmp_path / "emoface.pt", face, **template, spirals=face.mesh_attention.conv.spirals)
    folder = export("emoface", tmp_path, run=tmp_path / "emoface.pt")[0]
    request = inputs(face, 20)
    of_run, of_folder = (face_of(path)[0].perform(request) for path in (tmp_path / "emoface.pt", folder))
    assert torch.equal(of_run.motion, face.perform(request).motion)
    assert torch.allclose(of_folder.motion, of_run.motion, atol=0.01 * of_run.motion.abs().max().item())


@needs_shared
def test_the_shipped_template_moves_by_the_modes_of_the_vertices_that_it_has():
    judged = evaluate.opened(shipped("emoface_compact"), SHARED / "data")
    assert judged.model.config.vertices == 2000
    jaw = judged.modes.unflatten(1, (-1, 3))[CHANNELS.index("jawOpen")]
    at = judged.model.config.landmarks
    assert jaw[at[8], 1] < -5e-3 and jaw[at[57], 1] < -5e-3
    assert jaw[at[17:27]].abs().max() < 1e-3
    assert set(at[48:]) <= set(judged.lips.tolist()) and set(at[17:27]) <= set(judged.upper.tolist())
