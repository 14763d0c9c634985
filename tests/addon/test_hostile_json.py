"""Job and preset files with wrong content: a message names row and field, never a traceback."""

import json

import pytest

# Files that once caused a failure, and words of the message that now says where they are wrong.
JOBS = {
    '{"defaults": [], "shots": []}': "defaults: expected an object, got []",
    '{"shots": ["x"]}': "shot 1: expected an object, got 'x'",
    '{"shots": {"a": 1}}': "shots: expected a list",
    '["shots"]': "expected an object",
    '{"shots": [{"file": ["a"], "save": "b"}]}': "shot 1: file: expected text",
    '{"shots": [{"file": "a", "save": "b", "faces": "x=y"}]}': "faces: expected a list",
    '{"shots": [{"file": "a", "save": "b", "faces": [1]}]}': "face 1: expected an object",
    '{"shots": [{"file": "a", "save": "b", "faces": []}]}': "faces: expected at least one",
    '{"shots": [{"file": "a", "save": "b", "object": ["H"]}]}': "shot 1: object: expected text",
    '{"shots": [{"file": "a", "save": "b", "task": NaN}]}': "finite number, got NaN",
    '{"shots": [{"file": "a", "save": "b", "seed": 1e999}]}': "finite number, got 1e999",
    '{"defaults": {"object": ' + "1" * 400 + '}, "shots": []}': "19 digits, got 400",
    '{"shots": [{"file": "a", "save": "b\\u0000c"}]}': "expected a path in 'save'",
    '{"shots": [{"file": "a.blend", "save": "o/Batch.blend"}]}': "which the summary has",
    '{"shots": ' + "[" * 100_000: "too many",
}


@pytest.mark.parametrize("text", JOBS, ids=range(len(JOBS)))
def test_jobs_name_the_row_and_the_field(addon, tmp_path, text):
    path = tmp_path / "jobs.json"
    path.write_text(text)
    error = addon("core.errors").AnyfaceError
    try:
        (broken,) = addon("farm.jobs").read(path, tmp_path / "reports").broken
        kind, message = broken.outcome["kind"], broken.outcome["message"]
    except error as whole:
        kind, message = whole.kind, str(whole)
    assert kind == "input" and JOBS[text] in message, message


def test_names_that_differ_in_case_alone_are_refused(addon, tmp_path):
    rows = [{"file": "a.blend", "save": f"{name}.blend", "object": "H"} for name in ("Sh", "sh")]
    path = tmp_path / "jobs.json"
    path.write_text(json.dumps({"shots": rows}))
    listed = addon("farm.jobs").read(path, tmp_path / "reports")
    assert not listed.shots
    for row, other in zip(listed.broken, (2, 1), strict=True):
        assert f"shots {other} have the" in row.outcome["message"]
    assert len({row.shot.report.casefold() for row in listed.broken}) == 2


def test_one_bad_preset_leaves_the_others_in_the_list(addon, tmp_path):
    presets = addon("core.presets")
    presets.write(presets.Preset("Calm", {"articulation": 0.8}), tmp_path / "calm.json")
    start = '{"anyface_preset": 1, "name": '
    for number, text in enumerate(
        (
            start + '"a", "values": {"articulation": ' + "1" * 400 + "}}",
            start + '"a\\ud800", "values": {}}',
            start + '["a"], "values": {}}',
            start + '"a", "values": {"emotion": {"a": 1}}}',
            start + '"a", "values": {"articulation": NaN}}',
            "[" * 100_000,
            "\ufeff" + start,
        )
    ):
        path = tmp_path / f"bad{number}.json"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(addon("core.errors").AnyfaceError):
            presets.read(path)
    assert [preset.name for preset in presets.in_folder(tmp_path)] == ["Calm"]
