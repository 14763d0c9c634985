"""The commands that measure decoders, shapes and creases read the shipped models."""

import json

import numpy as np
import pytest
import torch

from training import shipped
from training.corpus.emotions import strengths
from training.corpus.sequence_meshes import sequence_meshes
from training.deform import fit_creases
from training.deform.creases import Creases
from training.rig import evaluate as rig
from training.rig.network import CONFIGS, RigNetwork
from training.rig.train import skin
from training.rig.visemes import solve
from training.systems.freetalk.stm import evaluate as stm
from training.tests.made_up import made_up
from training.tests.test_parity import SHARED, needs_shared


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    """A made-up face with a vertex sequence."""
    folder = made_up(tmp_path_factory.mktemp("corpus") / "made_up", 2.0, "vertices")
    return sequence_meshes([folder], held_out=True)[0]


def test_the_shipped_decoders_are_measured_without_a_run(mesh, tmp_path):
    names = [name for name, _ in stm.rows(tmp_path)]
    assert names == ["no motion", "training-free (TSB)", "static, shipped", "paper, shipped"]
    landmarks = mesh.displacements(0, [3, 9])[:, mesh.landmarks]
    with torch.no_grad():
        moved = {name: method(mesh, landmarks) for name, method in stm.corpus_rows(tmp_path)}
    assert set(names) < set(moved)
    for name, motion in moved.items():
        assert motion.shape == (2, len(mesh.lips), 3) and motion.isfinite().all(), name
    assert "of 68" in stm.attention_line(stm.shipped_paper(), [mesh], lambda mesh: landmarks)


def test_a_fixed_familiarity_replaces_that_of_the_face(mesh):
    model = stm.shipped_static()
    landmarks = mesh.displacements(0, [9])[:, mesh.landmarks]
    with torch.no_grad():
        free = stm.training_free(mesh, landmarks)
        usual, full = (stm.static(model, f)(mesh, landmarks) - free for f in (None, 1.0))
    torch.testing.assert_close(usual, model.familiarity(mesh.geometry.landmarks) * full)


def test_the_shipped_shapes_are_measured_without_a_run(mesh, tmp_path):
    assert list(rig.networks(tmp_path)) == ["shipped"]
    torch.save(RigNetwork(CONFIGS["rig"]).state_dict(), tmp_path / "rig_ict.pt")
    models = rig.networks(tmp_path)
    assert list(models) == ["shipped", "ict"]
    with torch.no_grad():
        shapes = models["shipped"](skin(mesh))
    assert shapes.isfinite().all() and shapes.abs().max() > 0.01


@needs_shared
def test_the_exported_visemes_are_up_to_date():
    config = json.loads((shipped("rig") / "config.json").read_text())
    assert solve(SHARED / "data")[0] == config["visemes"]


def test_creases_are_read_as_they_were_written(tmp_path):
    rng = np.random.default_rng(0)
    shapes = ((5, 3), (5, 3), (68, 3), (5, 3, 2), (2, 204))
    faces = {name: Creases(*(rng.normal(size=shape) for shape in shapes)) for name in ("a", "b")}
    fit_creases.write_creases(tmp_path / "creases", faces)
    read = fit_creases.read_creases(tmp_path / "creases")
    assert list(read) == ["a", "b"]
    for name, creases in faces.items():
        for key, value in vars(creases).items():
            np.testing.assert_allclose(vars(read[name])[key], value, rtol=1e-3, atol=1e-6)


def test_a_strength_measures_its_own_landmarks():
    smile = np.zeros((68, 3))
    smile[[48, 54]] = [[-2.0, 3.0, 0.0], [2.0, 3.0, 0.0]]
    moved = {name: value for name, value in strengths(smile).items() if value}
    assert moved == {"corners up": 3.0, "corners apart": 4.0}
