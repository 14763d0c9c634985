"""The exported modes are ICT's."""

import json

import numpy as np

from training import shipped
from training.corpus.ict import IctLandmarks
from training.nn.checkpoint import read_arrays
from training.tests.test_parity import SHARED, needs_shared

FOLDER = shipped("face_modes")


@needs_shared
def test_the_exported_modes_are_up_to_date():
    modes = IctLandmarks(SHARED / "data").modes
    names = json.loads((FOLDER / "config.json").read_text())["modes"]
    assert names == list(modes)
    np.testing.assert_allclose(read_arrays(FOLDER)["modes"].numpy(), np.stack(list(modes.values())))
