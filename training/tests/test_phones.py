"""Facts about phone labels and times."""

import numpy as np

from training.corpus.phones import (
    FEATURES,
    SEGMENTS,
    Phone,
    bilabials,
    feature_table,
    segment_track,
    segments,
)


def test_labels_of_every_kind_become_plain_segments():
    assert segments("ˈaɪ") == ["a", "ɪ"]
    assert segments("AH0") == ["ʌ"]
    assert segments("tʃ") == ["t", "ʃ"]
    assert segments("ɑ̃ː") == ["ɑ"]
    assert segments("SIL") == ["_"]
    assert segments("?") == []


def test_only_p_b_m_close_the_lips_fully():
    closed = feature_table()[:, FEATURES.index("closed")]
    assert {s for s, c in zip(SEGMENTS, closed, strict=True) if c == 1.0} == {"p", "b", "m", "ʙ"}


def test_frames_carry_the_phone_that_sounds_there():
    track = segment_track([Phone(0.1, 0.1, "a"), Phone(0.2, 0.1, "m")], 40, 100.0)
    names = [SEGMENTS[i] for i in track]
    assert names[:10] == ["_"] * 10
    assert names[10:20] == ["a"] * 10
    assert names[20:30] == ["m"] * 10
    assert names[30:] == ["_"] * 10


def test_a_closure_begins_half_the_phone_before():
    spans = bilabials(
        [Phone(0.0, 0.2, "a"), Phone(0.2, 0.1, "p"), Phone(0.3, 0.02, "ə"), Phone(0.32, 0.1, "m")]
    )
    np.testing.assert_allclose(spans, [(0.1, 0.3), (0.28, 0.42)], atol=1e-9)


def test_silence_before_a_plosive_is_not_its_closure():
    track = segment_track([Phone(0.0, 1.0, "B")], 100, 100.0)
    assert (track > 0).sum() == 14
