// The page: what is dropped, pressed and slid, and what is said about it.
import { Show } from "./show.js";
import { decode } from "./sound.js";
import { call, listen } from "./work.js";

const SAMPLE_HEAD = { file: "sample/head.obj", landmarks: "sample/landmarks.json", name: "Sample head" };
const SAMPLE_SOUND = { file: "sample/sentence.mp3", name: "Sample sentence" };
const HEADS = /\.(glb|vrm|obj|ply)$/i;
const SOUNDS = /\.(wav|mp3|m4a|aac|ogg|oga|opus|flac|webm|mp4)$/i;
// Of all that a face can be asked for, what is seen best.
const EVENTS = [
  "smile", "wink", "blink", "brow raise", "frown", "surprise", "squint", "sneer", "sad mouth", "pucker", "jaw drop",
  "grimace",
];
const EVENT_S = 0.9;

const at = (id) => document.getElementById(id);
const state = { head: undefined, sound: undefined, clip: undefined, busy: 0 };
const show = new Show(at("view"), { onstate: playing, onerror: complain });
const ready = begin("Fetching Anyface", () => call("load"));

function say(text) {
  at("status").textContent = text;
}

function sentence(text) {
  const begun = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(begun) ? begun : `${begun}.`;
}

/** Says what went wrong, in a sentence. */
function complain(error) {
  at("alert-text").textContent = sentence(error.message);
  at("alert").hidden = false;
  say("That did not work; the message over the head says why.");
}

/** Does what takes a while, and says so; undefined where it failed, with a hint of what to do then. */
async function begin(what, work, hint = "") {
  state.busy += 1;
  say(`${what}…`);
  at("progress").classList.remove("idle");
  at("alert").hidden = true;
  try {
    return await work();
  } catch (error) {
    complain(new Error(`${sentence(error.message)} ${hint}`.trim()));
    return undefined;
  } finally {
    state.busy -= 1;
    if (state.busy === 0) at("progress").classList.add("idle");
    at("export").disabled = !state.clip || state.busy > 0;
  }
}

function emotion() {
  const name = at("emotion").value;
  return name === "auto" ? name : `${name}:${name === "neutral" ? 0 : at("intensity").value}`;
}

async function takeHead(file, name, landmarks) {
  await ready;
  const found = await begin("Looking for the face", async () => {
    const head = await call("face", { file: file.slice(0), landmarks });
    const showsFile = await show.head(head, file);
    at("shapes").hidden = !showsFile || head.shapes.length === 0;
    at("by-shapes").checked = false;
    return head;
  }, `That was ${name}: choose a file with one whole head, or export it once more as GLB or OBJ.`);
  if (!found) return;
  state.head = name;
  at("welcome").hidden = true;
  at("head-name").textContent = name;
  at("notes").replaceChildren(
    ...found.notes.map((note) => Object.assign(document.createElement("li"), { textContent: note })),
  );
  if (state.sound) await speak({ play: true });
  else say("Now drop a sound, take the sample sentence, or speak into the microphone.");
}

async function takeSound(bytes, name) {
  await show.stopListening();
  const sound = await begin("Reading the sound", () => decode(bytes, name));
  if (!sound) return;
  state.sound = sound;
  at("sound-name").textContent = name;
  show.sound(sound.buffer);
  if (state.head) await speak({ play: true });
  else say("Now drop a head, or take the sample head.");
}

/** Lets the head speak the sound; again with another emotion where it speaks already. */
async function speak({ play }) {
  await ready;
  const { samples } = state.sound;
  const clip = await begin("Listening", () => call("speak", { samples, emotion: emotion() }));
  if (!clip) return;
  state.clip = clip;
  at("transport").hidden = false;
  at("seek").max = show.duration;
  at("export").disabled = false;
  await show.clip(clip, play);
  const done = `${state.head} speaks: ${clip.frames} frames.`;
  say(play && !show.isPlaying ? `${done} Press Play to hear it.` : done);
}

async function fetched({ file }) {
  const answer = await fetch(new URL(file, import.meta.url));
  if (!answer.ok) throw new Error(`Expected ${file} beside this page, got ${answer.status}. Copy the whole folder`);
  return answer.arrayBuffer();
}

async function sampleHead() {
  const text = async () => new TextDecoder().decode(await fetched({ file: SAMPLE_HEAD.landmarks }));
  const files = await begin("Fetching the head", () => Promise.all([fetched(SAMPLE_HEAD), text()]));
  if (files) await takeHead(files[0], SAMPLE_HEAD.name, files[1]);
}

async function sampleSound() {
  const bytes = await begin("Fetching the sentence", () => fetched(SAMPLE_SOUND));
  if (bytes) await takeSound(bytes, SAMPLE_SOUND.name);
}

async function takeFiles(files) {
  const known = [...files].map((file) => ({ file, isHead: HEADS.test(file.name), isSound: SOUNDS.test(file.name) }));
  const other = known.find(({ isHead, isSound }) => !isHead && !isSound);
  if (other) {
    complain(new Error(
      `Expected a head (GLB, VRM, OBJ, PLY) or a sound (MP3, WAV, M4A …), got ${other.file.name}. ` +
        "Export it as one of these and drop it again",
    ));
  }
  // A sound is quick to read, and the head then speaks it at once.
  for (const { file } of known.filter(({ isSound }) => isSound)) await takeSound(await file.arrayBuffer(), file.name);
  for (const { file } of known.filter(({ isHead }) => isHead)) await takeHead(await file.arrayBuffer(), file.name);
}

async function event(name) {
  const expression = `${name}:${at("event-strength").value}`;
  if (show.isListening) {
    await begin(name, () => call("liveShow", { expression, seconds: EVENT_S }));
    return say(`${name}.`);
  }
  if (!state.clip) return say("A gesture needs a head that speaks: take a head and a sound first.");
  const from = Math.min(show.time, Math.max(0, show.duration - EVENT_S));
  const text = `${from.toFixed(2)}-${(from + EVENT_S).toFixed(2)}:${expression}`;
  await begin(name, () => call("event", { text }));
  show.forget();
  say(`${name} at ${from.toFixed(1)} s.`);
}

async function feel() {
  at("intensity-value").value = at("intensity").value;
  if (show.isListening) await begin("Feeling", () => call("liveEmotion", { emotion: emotion() }));
  else if (state.clip) await speak({ play: false });
}

async function listenToMicrophone() {
  if (show.isListening) {
    await show.stopListening();
    return say("The microphone is off.");
  }
  if (!state.head) return say("Take a head first, then speak into the microphone.");
  const latency = await begin("Asking for the microphone", () => show.listen(emotion()));
  if (latency !== undefined) say(`Speak; the head follows ${Math.round(1000 * latency)} ms behind.`);
}

async function save() {
  const made = await begin("Writing the GLB", () => call("export"));
  if (!made) return;
  const address = URL.createObjectURL(new Blob([made.bytes], { type: "model/gltf-binary" }));
  Object.assign(document.createElement("a"), { href: address, download: "anyface.glb" }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
  say(`Saved anyface.glb, ${(made.bytes.length / 1e6).toFixed(1)} MB.`);
}

function playing() {
  at("play").textContent = show.isPlaying ? "Pause" : "Play";
  at("seek").value = show.time;
  at("clock").value = `${show.time.toFixed(1)} s`;
  at("speak").setAttribute("aria-pressed", String(show.isListening));
}

function connect() {
  const on = (id, kind, work) => at(id).addEventListener(kind, work);
  for (const button of document.querySelectorAll(".choose-head")) {
    button.addEventListener("click", () => at("head-file").click());
  }
  on("choose-sound", "click", () => at("sound-file").click());
  for (const id of ["head-file", "sound-file"]) {
    on(id, "change", async () => {
      await takeFiles(at(id).files);
      at(id).value = "";
    });
  }
  on("try", "click", async () => {
    await sampleSound();
    await sampleHead();
    at("play").focus();
  });
  on("sample-head", "click", sampleHead);
  on("sample-sound", "click", sampleSound);
  on("speak", "click", listenToMicrophone);
  on("play", "click", () => (show.isPlaying ? show.pause() : show.play()));
  on("seek", "input", () => show.seek(Number(at("seek").value)));
  on("emotion", "change", feel);
  on("intensity", "change", feel);
  on("intensity", "input", () => (at("intensity-value").value = at("intensity").value));
  on("by-shapes", "change", () => show.byShapes(at("by-shapes").checked));
  on("event-strength", "input", () => (at("event-strength-value").value = at("event-strength").value));
  on("clear-events", "click", async () => {
    await begin("Removing gestures", () => call("clearEvents"));
    show.forget();
    say("The gestures are gone.");
  });
  on("export", "click", save);
  on("alert-close", "click", () => (at("alert").hidden = true));
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") at("alert").hidden = true;
    if (event.key === " " && event.target === at("view")) {
      event.preventDefault();
      at("play").click();
    }
  });
  for (const kind of ["dragenter", "dragover"]) {
    document.addEventListener(kind, (event) => {
      event.preventDefault();
      at("drop").hidden = false;
    });
  }
  document.addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) at("drop").hidden = true;
  });
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    at("drop").hidden = true;
    takeFiles(event.dataTransfer.files);
  });
  for (const name of EVENTS) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: name.charAt(0).toUpperCase() + name.slice(1) });
    button.addEventListener("click", () => event(name));
    at("events").append(button);
  }
}

connect();
listen({
  progress({ what, share }) {
    say(`${what}…`);
    at("progress").value = share;
  },
  live: (frame) => show.liveFrame(frame),
  restart() {
    Object.assign(state, { head: undefined, clip: undefined });
    show.lose();
  },
});
const known = await ready;
for (const name of known?.emotions ?? []) {
  if (name === "neutral") continue;
  at("emotion").append(new Option(name, name));
}
if (known) say("Ready. Drop a head and a sound, or try the sample head.");
