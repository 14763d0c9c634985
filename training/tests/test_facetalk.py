"""FaceTalk's head: mirrored anchors, blending, closed-form codes, fits, and what is exported comes back."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from training.corpus.heads import Places, drawn_places, neck_rim, vertex_normals, winding_number
from training.export import export
from training.nn.checkpoint import save as save_model
from training.nn.checkpoint import write_model
from training.systems.facetalk.config import CONFIGS, debug_config
from training.systems.facetalk.fit_codes import SequenceFit, fit_identity, fit_sequence
from training.systems.facetalk.head import COEFFICIENTS, Head
from training.systems.facetalk.motion import Denoiser, landmark_config
from training.systems.facetalk.motion import debug_config as debug_motion
from training.systems.facetalk.network import Network, encode, encoded
from training.systems.facetalk.stored import EXACT, joined, load_folder, load_head
from training.systems.facetalk.train import save, uneven


def points(count: int) -> torch.Tensor:
    return 0.3 * torch.randn(1, count, 3, generator=torch.Generator().manual_seed(1))


def made_head(size: float = 0.05) -> Head:
    torch.manual_seed(0)
    head = Head(debug_config())
    with torch.no_grad():
        for name, parameter in head.named_parameters():
            if ".out" in name and "template" not in name:
                parameter.add_(size * torch.randn_like(parameter))
    return head


def test_paper_sizes():
    config = CONFIGS["paper"]()
    assert (config.anchors, config.identity_code) == (39, 1344)
    config = CONFIGS["compact"]()
    assert (config.anchors, config.identity_code) == (21, 384)


def test_a_mirrored_code_moves_the_mirrored_point_the_mirrored_way():
    head = made_head()
    config = head.config
    identity = head.identity
    identity.mirror.copy_(torch.tensor([1.0, -1.0, 1.0, -1.0, -1.0, 1.0]))
    z = torch.randn(1, config.identity_code)
    global_code, local = identity.codes(z)
    swap = [n ^ 1 for n in range(2 * len(config.pairs))]
    swap += list(range(2 * len(config.pairs), config.anchors + 1))
    other = torch.cat([global_code * identity.mirror, local[:, swap].flatten(1)], 1)
    places = torch.randn(1, config.anchors, 3)
    places[:, 2 * len(config.pairs) :] = torch.tensor([0.0, 9.0, 0.0])
    flip = torch.tensor([-1.0, 1.0, 1.0])
    places[:, 1 : 2 * len(config.pairs) : 2] = places[:, : 2 * len(config.pairs) : 2] * flip
    places = 0.2 * places
    x = (places[0, : 2 * len(config.pairs)].repeat(50, 1) + 0.2 * points(200)[0])[None]
    identity.anchors = lambda z: places
    weight = identity.blend(x, places)
    only_pairs = (weight[..., 2 * len(config.pairs) :] == 0.0).all(2)[0]
    assert only_pairs.sum() > 10
    there = identity.to_mean(x, z)[0, only_pairs]
    mirror = identity.to_mean(x * flip, other)[0, only_pairs] * flip
    assert there.abs().max() > 1e-3
    torch.testing.assert_close(there, mirror, atol=1e-5, rtol=1e-4)


def test_weights_of_the_blend_sum_to_one_and_many_are_zero():
    head, x = made_head(), points(300)
    weight = head.identity.blend(x, torch.rand(1, head.config.anchors, 3))
    torch.testing.assert_close(weight.sum(-1), torch.ones(1, 300))
    assert (weight == 0.0).float().mean() > 0.3


def test_the_canonical_pose_has_the_code_zero():
    head = made_head()
    weights = torch.zeros(1, len(head.config.channels))
    assert head.expression(weights).abs().max() > 0.0
    weights[0, head.config.channels.index("jawOpen")] = head.config.open_jaw
    assert head.expression(weights).abs().max() == 0.0


def test_heads_of_a_batch_do_not_mix():
    head, x = made_head(), points(40).repeat(2, 1, 1)
    z = head.identity_code(torch.randn(2, COEFFICIENTS))
    expression = torch.randn(2, head.config.expression_code)
    for way in (head, head.posed, head.canonical):
        together = way(x, z, expression)
        torch.testing.assert_close(together[1:], way(x[1:], z[1:], expression[1:]))


def test_only_the_last_hidden_layer_of_the_forward_field_sees_the_code():
    field = made_head().forward_field
    assert field.code_layers == [field.hidden.__len__()]
    x = encode(points(5), field.octaves)
    codes = torch.randn(2, 1, field.code[0].in_features)
    last = len(field.hidden)
    torch.testing.assert_close(field.trunk(x, codes[0], last), field.trunk(x, codes[1], last))
    assert (field(x, codes[0]) - field(x, codes[1])).abs().max() > 1e-3


def test_a_network_begins_at_zero_and_its_last_matrix_is_linear_in_the_code():
    torch.manual_seed(3)
    network = Network(3, 4, 8, 3, 2, [])
    x, a, b = points(6), torch.randn(1, 4), torch.randn(1, 4)
    assert network(x, a).abs().max() == 0.0
    torch.nn.init.normal_(network.out_code.weight)
    torch.testing.assert_close(network(x, a) + network(x, b), network(x, a + b), atol=1e-4, rtol=1e-4)


def test_encoding_has_a_length_and_a_period():
    x = torch.tensor([[0.25, -0.5, 0.1]])
    assert encode(x, 3).shape[-1] == encoded(3) == 21
    torch.testing.assert_close(encode(x, 3)[:, 3:], encode(x + 2.0, 3)[:, 3:], atol=1e-5, rtol=1e-4)


def test_a_head_that_sees_finer_places_begins_as_the_same_head(tmp_path):
    head = made_head()
    save(tmp_path / "head.pt", head)
    finer = load_head(tmp_path / "head.pt", 5)
    assert finer.config.expression_octaves == 5
    assert finer.forward_field.point[0].in_features == encoded(5)
    x, z = points(40), head.identity_code(torch.randn(1, COEFFICIENTS))
    code = torch.randn(1, head.config.expression_code)
    assert (head.posed(x, z, code) - finer.posed(x, z, code)).abs().max() < 1e-6
    assert (head.canonical(x, z, code) - finer.canonical(x, z, code)).abs().max() < 1e-6
    with pytest.raises(ValueError, match="expected at least 3, got 2"):
        load_head(tmp_path / "head.pt", 2)


def test_errors_along_normals_count_more():
    normals = torch.tensor([[0.0, 0.0, 1.0]]).expand(2, 3)
    error = torch.tensor([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]])
    along, across = uneven(error, normals, 0.25)[0]
    assert along > 2.0 * across > 0.0


def test_a_head_of_the_model_is_found_again_from_points_and_landmarks():
    head = made_head(0.02)
    torch.manual_seed(5)
    with torch.no_grad():
        head.identity.landmarks.weight.copy_(0.02 * torch.randn_like(head.identity.landmarks.weight))
        c = torch.randn(COEFFICIENTS)
        z = head.identity_code(c)[None]
        landmarks = head.identity.places(z)[0] * head.config.scale_m
        x = points(4000)
        on = x[0, head.identity(x, z)[0].abs().argsort()[:100]] * head.config.scale_m
        fitted = fit_identity(head, on, landmarks, iterations=2)
        refound = head.identity.places(head.identity_code(fitted)[None])[0] * head.config.scale_m
        mean = head.identity.places(head.identity_code.bias[None])[0] * head.config.scale_m
    assert (refound - landmarks).norm(dim=1).mean() < 0.3 * (mean - landmarks).norm(dim=1).mean()


def test_groups_of_a_sequence_share_their_frames():
    head = made_head()
    fit = SequenceFit(group=4, shared=2, iterations=3, points=20, late_from=2)
    clouds = [0.05 * torch.randn(50, 3) for _ in range(7)]
    z = head.identity_code(torch.randn(COEFFICIENTS)).detach()
    start = torch.zeros(head.config.expression_code)
    whole = fit_sequence(head, clouds, z, fit, start)
    assert whole.shape == (7, head.config.expression_code)
    torch.testing.assert_close(fit_sequence(head, clouds[:4], z, fit, start), whole[:4])
    assert whole.abs().max() > 0.0


def test_an_exported_folder_comes_back(tmp_path):
    head, motion = made_head(), Denoiser(debug_motion())
    by_landmarks = Denoiser(landmark_config(debug_motion().codes))
    both = joined(head, {"motion": motion, "landmark_motion": by_landmarks})
    folder = write_model(tmp_path / "facetalk_debug", *both, EXACT)
    again, motions = load_folder(folder)
    z = head.identity_code(torch.randn(1, COEFFICIENTS))
    torch.testing.assert_close(
        again.identity(points(30), z), head.identity(points(30), z), atol=2e-3, rtol=1e-2
    )
    assert motions["motion"].config == motion.config
    assert motions["landmark_motion"].config == by_landmarks.config
    stored = load_file(folder / "model.safetensors")
    assert stored["identity_code.weight"].dtype == torch.float32
    assert stored["identity.template.layers.0.weight"].dtype == torch.float16
    alone, nothing = load_folder(write_model(tmp_path / "alone", *joined(head, {}), EXACT))
    assert nothing == {} and alone.config.channels == head.config.channels


def test_places_lie_in_their_triangles_and_more_often_in_likely_ones():
    places = drawn_places(torch.tensor([1.0, 9.0]), 2000, torch.Generator().manual_seed(2))
    assert (places.share >= 0.0).all() and 0.85 < (places.triangle == 1).float().mean() < 0.95
    torch.testing.assert_close(places.share.sum(1), torch.ones(2000))
    assert isinstance(places[torch.arange(3)], Places) and len(places[torch.arange(3)]) == 3


def test_normals_of_a_square_stand_on_it():
    vertices = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    normals = vertex_normals(vertices, torch.tensor([[0, 1, 2], [0, 2, 3]]))
    torch.testing.assert_close(normals, torch.tensor([0.0, 0.0, 1.0]).expand(1, 4, 3))


def test_winding_number_of_a_box_and_the_rim_of_an_open_one():
    side = np.linspace(-1.0, 1.0, 13)
    a, b = (x.ravel() for x in np.meshgrid(side, side, indexing="ij"))
    squares = np.array([[i * 13 + j, (i + 1) * 13 + j, (i + 1) * 13 + j + 1, i * 13 + j + 1]
                        for i in range(12) for j in range(12)])  # fmt: skip
    triangles = np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
    assert len(neck_rim(triangles)) == 48
    sides, faces = [], []
    for axis in range(3):
        for end in (1.0, -1.0):
            corners = np.zeros((len(a), 3))
            corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3], corners[:, axis] = a, b, end
            faces.append((triangles if end > 0 else triangles[:, ::-1]) + len(sides) * len(a))
            sides.append(corners)
    box, faces = np.concatenate(sides), np.concatenate(faces)
    places = np.array([[0.0, 0.0, 0.0], [0.5, -0.5, 0.2], [1.6, 0.0, 0.0], [0.0, -3.0, 0.0]])
    np.testing.assert_allclose(winding_number(places, box, faces), [1.0, 1.0, 0.0, 0.0], atol=0.03)


def test_a_motion_model_of_another_head_is_not_exported(tmp_path):
    config = replace(debug_motion(), codes=7)
    save_model(tmp_path / "motion.pt", Denoiser(config))
    with pytest.raises(ValueError, match="expected 64 expression codes, as its head has, found 7"):
        export("facetalk", tmp_path / "models", motion=tmp_path / "motion.pt")
    assert not (tmp_path / "models").exists()
