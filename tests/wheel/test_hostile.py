"""Calls with wrong arguments: the package's own error, no crash, and no file is lost."""

import shutil
import threading

import numpy as np
import pytest

from conftest import HEAD, RATE_HZ, spoken

SOUND = spoken(0.4), RATE_HZ


class _Odd:
    """Something that is neither a number nor a text nor an array."""


# None of these is a value of any argument, so each call is refused before any work.
WRONG = (None, "a\0b", [1, [2, 3]], np.zeros((2, 3, 4)), _Odd())


@pytest.fixture(scope="module")
def engine(anyface):
    """An engine of two threads."""
    return anyface.Engine(threads=2)


def calls(anyface, engine, wrong):
    """Calls with one wrong argument each, by name."""
    mesh, find = engine.read_mesh(str(HEAD)), anyface.find_landmarks
    few = mesh[0][:100], mesh[1][:20] % 100

    def animate(**arguments):
        anyface.animate(few, SOUND, **({"engine": engine} | arguments))

    return {
        "mesh": lambda: find(wrong, engine=engine),
        "vertices": lambda: find((wrong, mesh[1]), engine=engine),
        "faces": lambda: find((mesh[0], wrong), engine=engine),
        "fixed": lambda: find(few, fixed={3: wrong}, engine=engine),
        "sound": lambda: anyface.animate(few, wrong, engine=engine),
        "rate": lambda: anyface.animate(few, (SOUND[0], wrong), engine=engine),
        "fps": lambda: animate(fps=wrong),
        "emotion": lambda: animate(emotion=[(wrong, "happy:1")]),
        "events": lambda: animate(events=[wrong]),
        "out": lambda: animate(out=wrong),
        "forward": lambda: animate(forward=wrong),
        "strength": lambda: anyface.Stream(emotion=wrong, engine=engine),
        "look_ahead": lambda: anyface.Stream(look_ahead=[wrong], engine=engine),
        "positions": lambda: engine.triangulate(wrong, [3], [0, 1, 2]),
        "weights": lambda: engine.write_weights(["a"], wrong, "weights.csv", 25.0),
    }


@pytest.mark.parametrize("number", range(len(WRONG)))
def test_wrong_arguments_are_refused_with_the_packages_own_error(anyface, engine, number):
    for name, call in calls(anyface, engine, WRONG[number]).items():
        with pytest.raises(anyface.AnyfaceError) as refused:
            call()
        assert refused.value.kind != "internal", f"{name}: {refused.value}"


def test_arrays_shorter_than_they_claim_are_not_read_beyond_their_end(anyface, engine):
    """The library would read three numbers of each vertex."""
    positions, triangles = engine.read_mesh(str(HEAD))
    for short in (positions[:, :2], positions[:, 0], positions.ravel()):
        with pytest.raises(anyface.AnyfaceError, match=r"expected \[V, 3\]"):
            engine.triangulate(short, [3], [0, 1, 2])
    with pytest.raises(anyface.AnyfaceError, match=r"vectors: expected \[2, V, 3\]"):
        engine.solve(["a", "b"], np.zeros((1, 4, 3)), np.zeros((0, 2)), np.zeros((2, 4, 3)), None)
    with pytest.raises(anyface.AnyfaceError, match="landmark"):
        far = np.full((68, 3), 1e30)
        anyface.find_landmarks((positions, triangles), landmarks=far, engine=engine)


def test_no_result_replaces_what_is_read(anyface, engine, voice, tmp_path):
    mesh, linked = tmp_path / "head.glb", tmp_path / "take.glb"
    shutil.copy(HEAD, mesh)
    linked.hardlink_to(mesh)
    before = mesh.read_bytes()
    for out in (mesh, linked):
        with pytest.raises(anyface.AnyfaceError, match="which is read"):
            anyface.make_rig(mesh, out=out, engine=engine)
        with pytest.raises(anyface.AnyfaceError, match="which is read"):
            anyface.animate(mesh, voice, out=out, engine=engine)
    assert mesh.read_bytes() == before


def test_a_closed_engine_refuses_and_lets_running_calls_end(anyface):
    engine = anyface.Engine(threads=1)
    turned, stream = engine.facing("-y", "+z"), anyface.Stream(engine=engine)
    engine.close()
    engine.close()
    with pytest.raises(anyface.AnyfaceError, match="closed one"):
        anyface.find_landmarks(HEAD, engine=engine)
    # Neither the engine for other axes nor the stream lost its models.
    assert turned.listen(anyface.core.take.Sound(*SOUND, "voice")).shape[1] == 2
    stream.push(SOUND[0])
    stream.finish()
    assert list(stream.frames())


def test_threads_may_share_a_stream_and_close_it(anyface, engine):
    stream, others = anyface.Stream(engine=engine), []

    def use(number):
        try:
            for _ in range(20):
                stream.push(SOUND[0][: 400 + number])
                stream.pull()
        except anyface.AnyfaceError:
            return
        except BaseException as error:
            others.append(error)

    threads = [threading.Thread(target=use, args=(number,)) for number in range(4)]
    [thread.start() for thread in threads]
    stream.close()
    [thread.join() for thread in threads]
    assert not others
