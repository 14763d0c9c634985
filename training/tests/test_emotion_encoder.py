"""Labels of acted speech become phones."""

from training.corpus.emodb import phones_of
from training.corpus.phones import segments


def label(start: float, duration: float, text: str) -> dict:
    return {"start": start, "duration": duration, "label": text}


def test_closure_burst_and_breath_of_a_plosive_are_one_phone():
    phones = phones_of([label(0.1, 0.04, "_t"), label(0.14, 0.02, "!t"), label(0.16, 0.05, "tasp"),
                       label(0.21, 0.1, "E6")])  # fmt: skip
    assert [(p.label, round(p.start_s, 3), round(p.end_s, 3)) for p in phones] == [
        ("t", 0.1, 0.21),
        ("ɛɐ", 0.21, 0.31),
    ]
    assert segments("ɛɐ") == ["ɛ", "ɐ"]


def test_what_modifies_a_phone_lengthens_it():
    phones = phones_of([label(0.0, 0.1, "a"), label(0.1, 0.05, "-lar"), label(0.15, 0.1, "m")])
    assert [(p.label, round(p.duration_s, 3)) for p in phones] == [("a", 0.15), ("m", 0.1)]
