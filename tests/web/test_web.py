"""The library as WebAssembly, its npm package and its page, in Node and in Chromium.

`cargo xtask web` builds them in target/web. The tests compare the motion with that of the command,
which `ANYFACE_COMMAND` names. If tools are missing, the tests are ignored, or fail if `CI` is set.
A run leaves pictures in target/web-pictures.
"""

import base64
import functools
import http.server
import json
import os
import shutil
import struct
import subprocess
import threading
import wave
from pathlib import Path

import numpy as np
import pytest

browser = pytest.importorskip("browser")
ROOT = Path(__file__).resolve().parents[2]
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
SERVED = ROOT / "target/web"
PICTURES = ROOT / "target/web-pictures"
AXE = ROOT / "target/axe"
HEAD = ROOT / "weights/shared/default_head"
RATE_HZ = 16000
NEAR_M = 1e-5
AXE_VERSION = "4.14.1"
MAX_BYTES = 10_000_000


def need(*tools: str) -> None:
    """Skips the test if none of these tools is installed, or fails it if `CI` is set."""
    if not any(map(shutil.which, tools)):
        if os.environ.get("CI"):
            pytest.fail(f"{tools[0]} is not installed")
        pytest.skip(f"ignored: {tools[0]} is not installed")


@pytest.fixture(scope="module")
def served():
    """The folder that a web server serves."""
    need("node")
    if not (SERVED / "index.html").is_file():
        subprocess.run(["cargo", "xtask", "web"], cwd=ROOT, check=True)
    return SERVED


def spoken(seconds: float) -> np.ndarray:
    """Syllables of a voice with gliding pitch, within ±1."""
    time_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    pitch = 120 * (1 + 0.1 * np.sin(5.6 * time_s))
    phase = 2 * np.pi * np.cumsum(pitch) / RATE_HZ
    first = 500 + 250 * np.sin(2 * np.pi * 1.3 * time_s)
    sound = np.zeros_like(time_s)
    for k in range(1, 30):
        near = np.exp(-(((k * pitch - first) / 150) ** 2))
        near += 0.6 * np.exp(-(((k * pitch - 1300) / 200) ** 2))
        sound += near * np.sin(k * phase)
    return 0.2 * sound * np.clip(np.sin(2 * np.pi * 2.5 * time_s) + 0.4, 0, 1)


def write_wav(path: Path, samples: np.ndarray) -> np.ndarray:
    """Writes a 16-bit file; returns the samples that readers get."""
    whole = np.round(samples * 32767).astype("<i2")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes(whole.tobytes())
    return (whole / np.float32(32768)).astype("<f4")


def test_a_clip_is_that_of_the_command(served, tmp_path):
    sound = tmp_path / "voice.wav"
    write_wav(sound, spoken(3.0)).tofile(tmp_path / "voice.f32")
    head, landmarks = HEAD / "head.obj", HEAD / "landmarks.json"
    words = ["node", ROOT / "tests/web/native.mjs", served / "anyface", head, landmarks]
    out = tmp_path / "moved.f32"
    report = subprocess.run(
        [*words, tmp_path / "voice.f32", out], check=True, capture_output=True, text=True
    ).stdout
    motion, moved = tmp_path / "motion.npz", tmp_path / "moved.npz"
    for words in (
        ["motion", "--audio", sound, "--emotion", "happy:0.7", "--causal", "--fps", "25"],
        ["deform", "--mesh", head, "--landmarks", landmarks, "--motion", motion],
    ):
        to = motion if words[0] == "motion" else moved
        subprocess.run([COMMAND, *words, "--out", to], check=True)
    native = np.load(moved)["displacements"]
    here = np.fromfile(out, "<f4").reshape(-1, native.shape[1], 3)
    assert here.shape == native.shape
    assert np.abs(native).max() > 0.003
    apart = np.abs(here - native).max()
    print(report, f"apart by {apart:.2e} m")
    assert apart < NEAR_M
    glb = (tmp_path / "moved.f32.glb").read_bytes()
    length = struct.unpack_from("<I", glb, 12)[0]
    document = json.loads(glb[20 : 20 + length])
    assert document["animations"] and document["meshes"][0]["primitives"][0]["targets"]


@pytest.fixture(scope="module")
def avatar(tmp_path_factory) -> bytes:
    """A head of few vertices as a GLB, with shapes."""
    path = tmp_path_factory.mktemp("avatar") / "avatar.vrm"
    words = ["rig", "--mesh", HEAD / "head.obj", "--landmarks", HEAD / "landmarks.json"]
    subprocess.run([COMMAND, *words, "--out", path], check=True, capture_output=True)
    return path.read_bytes()


def test_an_avatar_speaks(page, avatar):
    assert not dropped(page, "avatar.vrm", avatar)
    page.read("document.getElementById('sample-sound').click()")
    browser.wait(lambda: "avatar.vrm speaks" in status(page) and frames(page) > 5)
    page.read("document.getElementById('by-shapes').click()")
    before = frames(page)
    browser.wait(lambda: frames(page) > before)
    page.photograph(PICTURES / "by-shapes.png")


def test_the_targets_of_an_avatar_are_driven(served, avatar, tmp_path):
    sound, head = tmp_path / "voice.wav", tmp_path / "avatar.vrm"
    write_wav(sound, spoken(2.0)).tofile(tmp_path / "voice.f32")
    head.write_bytes(avatar)
    words = ["node", ROOT / "tests/web/native.mjs", served / "anyface"]
    words += [head, "-", tmp_path / "voice.f32", tmp_path / "moved.f32"]
    report = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    names, weights = report["names"], np.array(report["weights"])
    assert weights.shape == (report["frames"], len(names)) and "jawOpen" in names
    assert len(report["places"]) == 2 * len(names)
    assert weights.min() >= 0 and weights.max() <= 1
    moved = np.fromfile(tmp_path / "moved.f32", "<f4").reshape(len(weights), -1, 3)
    lowest = -moved[..., 1].min(axis=1)
    jaw = weights[:, names.index("jawOpen")]
    assert np.ptp(jaw) > 0.1, jaw
    assert np.corrcoef(lowest, jaw)[0, 1] > 0.9
    assert "expected" in report["refusal"] and "vertices" in report["refusal"]


def test_a_face_talks_after_less_than_ten_megabytes(served):
    kept_out = {served / "anyface" / name for name in ("README.md", "THIRD-PARTY.md")}
    files = [path for path in served.rglob("*") if path.is_file() and path not in kept_out]
    assert sum(path.stat().st_size for path in files) < MAX_BYTES


def test_the_package_packs_what_it_exports(served, tmp_path):
    need("npm")
    words = ["npm", "pack", "--json", "--pack-destination", str(tmp_path)]
    listing = subprocess.run(
        words, cwd=served / "anyface", check=True, capture_output=True, text=True
    ).stdout
    [package] = json.loads(listing)
    files = {file["path"] for file in package["files"]}
    assert {"anyface.js", "anyface.d.ts", "anyface_web.js", "anyface_web.d.ts"} <= files
    assert {"anyface_web_bg.wasm.gz", "README.md", "LICENSE-MIT", "LICENSE-APACHE"} <= files
    models = (ROOT / "web/models.txt").read_text().split()
    assert {f"models/{name}/model.planes.gz" for name in models} <= files


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files and writes no log."""

    def log_message(self, *_):
        """Says nothing."""


@pytest.fixture(scope="module")
def address(served):
    """Address of a server for the page."""
    need(*browser.BROWSERS)
    PICTURES.mkdir(exist_ok=True)
    handler = functools.partial(Quiet, directory=served)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture
def page(address, tmp_path):
    """The page, ready, with a microphone that hears syllables."""
    write_wav(tmp_path / "microphone.wav", spoken(4.0))
    flags = [
        "--autoplay-policy=no-user-gesture-required",
        "--use-fake-device-for-media-stream",
        "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-audio-capture={tmp_path / 'microphone.wav'}",
    ]
    page = browser.Page(address, flags)
    browser.wait(
        lambda: page.read("document.getElementById('status')?.textContent ?? ''").startswith(
            "Ready"
        )
    )
    yield page
    page.close()


def status(page) -> str:
    return page.read("document.getElementById('status').textContent")


def trouble(page) -> str:
    box = "document.getElementById('alert')"
    return page.read(f"{box}.hidden ? '' : {box}.querySelector('p').textContent")


def frames(page) -> int:
    assert not trouble(page), (trouble(page), page.said)
    return page.read("window.anyface.frames")


DROP = """(async () => {
  const data = new DataTransfer();
  for (const name of %s) {
    const bytes = await (await fetch(name)).arrayBuffer();
    data.items.add(new File([bytes], name.split('/').pop()));
  }
  document.dispatchEvent(new DragEvent('drop', {dataTransfer: data, bubbles: true}));
})()"""


def test_the_sample_head_speaks_by_the_keyboard_alone(page):
    reached = []
    while "try" not in reached:
        page.press("Tab")
        reached.append(page.read("document.activeElement.id"))
        assert len(reached) < 10, reached
    assert reached[0] == "view"
    page.press("Enter")
    browser.wait(lambda: frames(page) > 10)
    page.photograph(PICTURES / "speaking.png")
    assert "speaks" in status(page)
    page.read("document.activeElement.blur(); document.getElementById('view').focus()")
    before = page.read("document.getElementById('play').textContent")
    page.press(" ")
    browser.wait(lambda: page.read("document.getElementById('play').textContent") != before)
    walked = set()
    for _ in range(45):
        page.press("Tab")
        walked.add(page.read("document.activeElement.id || document.activeElement.textContent"))
    assert {
        "play", "seek", "sample-head", "choose-sound", "sample-sound", "speak", "emotion",
        "intensity", "Smile", "Wink", "event-strength", "clear-events", "export", "view",
    } <= walked, walked  # fmt: skip
    page.prefer("dark")
    page.photograph(PICTURES / "dark.png")


def test_dropped_files_speak_with_emotion_and_gestures_and_become_a_glb(page):
    page.read(DROP % json.dumps(["sample/sentence.mp3", "sample/head.obj"]))
    browser.wait(lambda: frames(page) > 5)
    page.read("document.getElementById('play').click()")
    page.read(
        "const e = document.getElementById('emotion'); e.value = 'happy';"
        "e.dispatchEvent(new Event('change', {bubbles: true}))"
    )
    browser.wait(lambda: "frames" in status(page))
    wink = "[...document.querySelectorAll('#events button')].find((b) => b.textContent === 'Wink')"
    page.read(f"{wink}.click()")
    browser.wait(lambda: "wink at" in status(page))
    page.read("URL.createObjectURL = (blob) => { window.saved = blob; return '#'; }")
    page.read("document.getElementById('export').click()")
    assert browser.wait(lambda: page.read("window.saved?.size")) > 100_000
    assert "Saved anyface.glb" in status(page)
    # The saved file is a head too, with a material of its own.
    before = frames(page)
    page.read(
        "const d = new DataTransfer(); d.items.add(new File([window.saved], 'again.glb'));"
        "document.dispatchEvent(new DragEvent('drop', {dataTransfer: d, bubbles: true}))"
    )
    browser.wait(lambda: "again.glb speaks" in status(page) and frames(page) > before + 5)
    page.photograph(PICTURES / "again.png")


def dropped(page, name: str, data: bytes) -> str:
    """Drops a file on the page and waits; returns what the page then says in trouble, or ''."""
    packed = base64.b64encode(data).decode()
    page.read(
        "document.getElementById('alert').hidden = true;"
        "document.getElementById('status').textContent = 'dropped';"
        f"{{ const b = Uint8Array.from(atob('{packed}'), (c) => c.charCodeAt(0));"
        f"const h = new DataTransfer(); h.items.add(new File([b], {json.dumps(name)}));"
        "document.dispatchEvent(new DragEvent('drop', {dataTransfer: h, bubbles: true})); }"
    )
    browser.wait(lambda: trouble(page) or "Now drop a sound" in status(page))
    return trouble(page)


def glb(document: dict, binary: bytes) -> bytes:
    """A GLB of its two chunks."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def chunks_of(data: bytes) -> tuple[dict, bytes]:
    """The document and the binary of a GLB."""
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """A GLB with some bytes changed, one number of its document replaced, or its end missing."""
    kind = random.integers(3)
    if kind == 0:
        changed = np.frombuffer(data, np.uint8).copy()
        at = random.integers(12, len(data), random.integers(1, 200))
        changed[at] = random.integers(0, 256, len(at))
        return changed.tobytes()
    if kind == 1:
        return data[: random.integers(len(data))]
    document, binary = chunks_of(data)
    places = [
        (entry, key)
        for kind in ("accessors", "bufferViews", "nodes")
        for entry in document.get(kind, [])
        for key, value in entry.items()
        if isinstance(value, int)
    ]
    for at in random.integers(len(places), size=2):
        entry, key = places[at]
        entry[key] = random.choice([0, 1, 2**31 - 1, 2**32 - 1, 2**53, -1]).item()
    return glb(document, binary)


def test_hostile_avatars_are_refused_in_words_and_the_page_goes_on(page, avatar):
    seed = int(os.environ.get("ANYFACE_SEED", "1"))
    random = np.random.default_rng(seed)
    count = int(os.environ.get("ANYFACE_MUTATIONS", "4"))
    files = [(f"damaged{n}.glb", damaged(avatar, random)) for n in range(count)]
    folder = os.environ.get("ANYFACE_SHARED")
    if folder:
        paths = sorted(Path(folder, "hostile/mesh").glob("*.glb"))
        files += [(path.name, path.read_bytes()) for path in paths[:: 1 if count > 4 else 8]]
    refused = 0
    for name, data in files:
        said = dropped(page, name, data)
        refused += bool(said)
        assert not said or name in said, (name, said)
    print(f"{len(files)} files, {refused} refused")
    assert refused > 0
    assert not dropped(page, "whole.glb", avatar)
    page.read("document.getElementById('sample-sound').click()")
    browser.wait(lambda: "whole.glb speaks" in status(page) and frames(page) > 5)


def test_an_avatar_fetches_nothing_and_runs_nothing(page, avatar):
    asked = []

    class Elsewhere(http.server.BaseHTTPRequestHandler):
        """Another site; it remembers who asks."""

        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_):
            """Says nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        site = f"http://127.0.0.1:{server.server_port}"
        script = f'<img src={site}/name onerror="window.ran = 1"><script>window.ran = 1</script>'
        document, binary = chunks_of(avatar)
        document["images"] = [{"uri": f"{site}/picture.png", "name": script}]
        document["textures"] = [{"source": 0}]
        document["materials"] = [
            {"name": script, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        ]
        for mesh in document["meshes"]:
            mesh["name"] = script
            for primitive in mesh["primitives"]:
                primitive["material"] = 0
        for node in document["nodes"]:
            node["name"] = script
        dropped(page, f"{script.replace('/', '')}.glb", glb(document, binary))
        page.read("document.getElementById('sample-sound').click()")
        page.read("new Promise((later) => setTimeout(later, 1000))")
        server.shutdown()
    assert page.read("window.ran") is None
    assert not asked


def test_a_head_follows_the_microphone(page):
    page.read("document.getElementById('sample-head').click()")
    browser.wait(lambda: "Now drop a sound" in status(page))
    page.read("document.getElementById('speak').click()")
    browser.wait(lambda: frames(page) > 40)
    page.read("document.querySelector('#events button').click()")
    page.photograph(PICTURES / "microphone.png")
    page.read("document.getElementById('speak').click()")
    browser.wait(lambda: "off" in status(page))


def test_what_cannot_be_used_is_said_in_words(page):
    page.read(
        "const d = new DataTransfer(); d.items.add(new File(['no head'], 'letter.txt'));"
        "document.dispatchEvent(new DragEvent('drop', {dataTransfer: d, bubbles: true}))"
    )
    assert "got letter.txt" in browser.wait(lambda: trouble(page))
    page.press("Escape")
    assert not trouble(page)
    page.read(
        "const t = new DataTransfer(), text = 'v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n';"
        "t.items.add(new File([text], 'a.obj'));"
        "document.dispatchEvent(new DragEvent('drop', {dataTransfer: t, bubbles: true}))"
    )
    said = browser.wait(lambda: trouble(page))
    page.photograph(PICTURES / "trouble.png")
    assert "expected" in said and "a.obj" in said and "choose" in said, said


def test_nothing_leaves_the_machine(page, address):
    page.read("document.getElementById('try').click()")
    browser.wait(lambda: frames(page) > 5)
    fetched = page.read("performance.getEntriesByType('resource').map((entry) => entry.name)")
    assert all(name.startswith((address, "blob:", "data:")) for name in fetched), fetched
    elsewhere = (
        f"fetch('http://localhost:{address.split(':')[-1]}').then(() => 'left', () => 'stayed')"
    )
    assert page.read(elsewhere) == "stayed"
    in_worker = (
        f"new Promise((tell) => {{ const code = new Blob([`{elsewhere}.then(postMessage)`]);"
        "new Worker(URL.createObjectURL(code)).onmessage = (m) => tell(m.data); })"
    )
    assert page.read(in_worker) == "stayed"


def test_axe_finds_nothing(page):
    need("npm")
    if not (AXE / "node_modules/axe-core").is_dir():
        AXE.mkdir(exist_ok=True)
        words = ["npm", "install", "--silent", "--no-save", "--no-audit", "--prefix", str(AXE)]
        subprocess.run([*words, f"axe-core@{AXE_VERSION}"], check=True)
    source = (AXE / "node_modules/axe-core/axe.min.js").read_text()
    page.read(source + "; 0")
    violations = "r.violations.map((v) => v.id + ': ' + v.nodes.map((n) => n.html).join())"
    run = f"axe.run().then((r) => {violations})"
    for scheme in ("light", "dark"):
        page.prefer(scheme)
        assert page.read(run) == []
    page.read("document.getElementById('try').click()")
    browser.wait(lambda: frames(page) > 5)
    for scheme in ("light", "dark"):
        page.prefer(scheme)
        assert page.read(run) == []
