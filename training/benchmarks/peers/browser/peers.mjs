// Lets the lip-sync tools of npm hear every sound, offline, and posts what they put out.
//
// Each tool gets a context of its own for each sound, at 48 kHz, as browsers have it. `times` are seconds of the
// sound, `values` a row of numbers for each.

import { HeadAudio } from "/packages/@met4citizen/headaudio/modules/headaudio.mjs";
import { createWLipSyncNode } from "/packages/wlipsync/dist/wlipsync-single.js";
import { Lipsync, VISEMES } from "/packages/wawa-lipsync/dist/wawa-lipsync.es.js";

const RATE = 48000;
const FPS = 60;
const QUANTUM = 128;
const MESSAGES_MS = 60;
// After 125 sounds Chromium defined no more processors; a new page has it begin again.
const SOUNDS_A_PAGE = 30;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function post(path, body) {
  await fetch(path, { method: "POST", body: typeof body === "string" ? body : JSON.stringify(body) });
}

async function contextWith(bytes) {
  const sound = await new OfflineAudioContext(1, 1, RATE).decodeAudioData(bytes.slice(0));
  const context = new OfflineAudioContext(1, sound.length, RATE);
  const source = context.createBufferSource();
  source.buffer = sound;
  return { context, source, seconds: sound.duration };
}

// Messages of the processor are kept and replayed against a clock of 60 frames a second.
async function headaudio(bytes) {
  const { context, source, seconds } = await contextWith(bytes);
  await context.audioWorklet.addModule("/packages/@met4citizen/headaudio/dist/headworklet.min.mjs");
  const node = new HeadAudio(context, {});
  await node.loadModel("/packages/@met4citizen/headaudio/dist/model-en-mixed.bin");
  const messages = [];
  node.port.onmessage = ({ data }) => messages.push(data);
  source.connect(node);
  source.start();
  await pause(MESSAGES_MS);
  await context.startRendering();
  await pause(MESSAGES_MS);
  const heardAt = (m) => m.t + (m.event === "viseme" ? m.d / 2 : 0);
  const weights = Object.fromEntries(node.visemeNames.map((name) => [name, 0]));
  node.onvalue = (name, value) => (weights[name] = value);
  const times = [], values = [];
  let next = 0;
  for (let k = 0; k < seconds * FPS; k++) {
    for (; next < messages.length && heardAt(messages[next]) <= k / FPS; next++) {
      node._onmessage({ data: messages[next] });
    }
    node.update(1000 / FPS);
    times.push(k / FPS);
    values.push(Object.values(weights));
  }
  return { times, values, events: messages.length };
}

// Weights, the volume, and both multiplied, after every message of the processor.
async function wlipsync(bytes, profile) {
  const { context, source } = await contextWith(bytes);
  const node = await createWLipSyncNode(context, profile);
  const times = [], values = [];
  const handler = node.port.onmessage;
  node.port.onmessage = (event) => {
    handler(event);
    const weights = Object.values(node.weights);
    times.push(event.data.timestamp);
    values.push([...weights, ...weights.map((w) => w * node.volume), node.volume]);
  };
  source.connect(node);
  node.connect(context.destination);
  source.start();
  await pause(MESSAGES_MS);
  await context.startRendering();
  await pause(MESSAGES_MS);
  return { times, values, events: times.length };
}

// The tool makes its own context and reads the clock: it gets ours and that of the sound.
async function wawa(bytes) {
  const { context, source, seconds } = await contextWith(bytes);
  const [clock, Context] = [performance.now, window.AudioContext];
  window.AudioContext = function () {
    return context;
  };
  let at = 0;
  performance.now = () => 1000 * at;
  try {
    const tool = new Lipsync();
    source.connect(tool.analyser).connect(context.destination);
    source.start();
    const names = Object.values(VISEMES);
    const times = [], values = [];
    for (let k = 1; k < seconds * FPS - 1; k++) {
      const when = (Math.round(((k / FPS) * RATE) / QUANTUM) * QUANTUM) / RATE;
      context.suspend(when).then(() => {
        at = when;
        tool.processAudio();
        times.push(when);
        values.push(names.map((name) => (name === tool.viseme ? 1 : 0)));
        context.resume();
      });
    }
    await context.startRendering();
    return { times, values, events: times.length };
  } finally {
    [performance.now, window.AudioContext] = [clock, Context];
  }
}

async function main() {
  const { names, profile } = await (await fetch("/task.json")).json();
  const tools = { headaudio, wlipsync: (bytes) => wlipsync(bytes, profile), wawa_lipsync: wawa };
  for (const name of names.slice(0, SOUNDS_A_PAGE)) {
    const bytes = await (await fetch(`/sounds/${name}.wav`)).arrayBuffer();
    for (const [tool, hear] of Object.entries(tools)) {
      const output = await hear(bytes);
      if (!output.events) throw new Error(`${tool}: nothing heard in ${name}`);
      await post(`/outputs/${tool}/${name}`, output);
    }
  }
  return names.length > SOUNDS_A_PAGE;
}

main().then(
  (more) => (more ? location.reload() : post("/end", "{}")),
  (error) => post("/end", { error: `${error}\n${error.stack}` }),
);
