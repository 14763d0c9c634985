"""FaceTalk's head: mirrored anchors, blending, exact pairs, and a run that goes on with the same bits."""

import numpy as np
import torch

from training.corpus.heads import neck_rim, winding_number
from training.systems.facetalk.config import CONFIGS, debug_config
from training.systems.facetalk.head import COEFFICIENTS, Head


def points(count: int) -> torch.Tensor:
    return 0.3 * torch.randn(count, 3, generator=torch.Generator().manual_seed(1))


def made_head() -> Head:
    torch.manual_seed(0)
    return Head(debug_config())


def test_paper_sizes():
    config = CONFIGS["paper"]()
    assert (config.anchors, config.identity_code) == (39, 1344)
    config = CONFIGS["compact"]()
    assert (config.anchors, config.identity_code) == (21, 384)


def test_a_mirrored_code_makes_a_mirrored_head():
    head = made_head()
    config, number = head.config, torch.zeros(200, dtype=torch.long)
    z = torch.randn(1, config.identity_code)
    own, local = head.identity.codes(z)
    swap = [n ^ 1 for n in range(2 * len(config.pairs))]
    swap += list(range(2 * len(config.pairs), config.anchors + 1))
    other = torch.cat([own, local[:, swap].flatten(1)], 1)
    places = torch.randn(1, config.anchors, 3)
    places[:, 2 * len(config.pairs) :] = torch.tensor([0.0, 9.0, 0.0])
    flip = torch.tensor([-1.0, 1.0, 1.0])
    places[:, 1 : 2 * len(config.pairs) : 2] = places[:, : 2 * len(config.pairs) : 2] * flip
    places = 0.2 * places
    x = places[0, : 2 * len(config.pairs)].repeat(50, 1) + 0.2 * points(200)
    head.identity.anchors.forward = lambda code: places.expand(len(code), -1, -1)
    weight = head.identity.blend(x, places.expand(200, -1, -1))
    only_pairs = (weight[:, 2 * len(config.pairs) :] == 0.0).all(1)
    assert only_pairs.sum() > 10
    there = head.identity(x, z, number)[only_pairs]
    mirror = head.identity(x * flip, other, number)[only_pairs]
    torch.testing.assert_close(there, mirror, atol=1e-5, rtol=1e-4)


def test_weights_of_the_blend_sum_to_one_and_many_are_zero():
    head, x = made_head(), points(300)
    anchors = torch.rand(1, head.config.anchors, 3).expand(300, -1, -1)
    weight = head.identity.blend(x, anchors)
    torch.testing.assert_close(weight.sum(1), torch.ones(300))
    assert (weight == 0.0).float().mean() > 0.3


def test_the_canonical_pose_has_the_code_zero():
    head = made_head()
    weights = torch.zeros(1, len(head.config.channels))
    assert head.expression(weights).abs().max() > 0.0
    weights[0, head.config.channels.index("jawOpen")] = head.config.open_jaw
    assert head.expression(weights).abs().max() == 0.0


def test_heads_of_a_batch_do_not_mix():
    head, x = made_head(), points(40)
    z = head.identity_code(torch.randn(2, COEFFICIENTS))
    number = torch.arange(2).repeat_interleave(20)
    together = head.identity(x, z, number)
    alone = head.identity(x[20:], z[1:], torch.zeros(20, dtype=torch.long))
    torch.testing.assert_close(together[20:], alone)


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
    asked = np.array([[0.0, 0.0, 0.0], [0.5, -0.5, 0.2], [1.6, 0.0, 0.0], [0.0, -3.0, 0.0]])
    np.testing.assert_allclose(winding_number(asked, box, faces), [1.0, 1.0, 0.0, 0.0], atol=0.03)
