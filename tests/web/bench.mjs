// Times the npm package in Node, one thread: node bench.mjs PACKAGE SOUND.wav HEAD...
// The sound is mono, 16 kHz, 16 bits. Prints the lines of docs/web.md, times in milliseconds.
import { readFileSync } from "node:fs";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [folder, sound, ...heads] = process.argv.slice(2);
const RATE = 16000, FPS = 25, HEADER = 44;
const wav = readFileSync(sound);
const format = { channels: wav.readUInt16LE(22), rate: wav.readUInt32LE(24), bits: wav.readUInt16LE(34) };
if (format.channels !== 1 || format.rate !== RATE || format.bits !== 16) {
  throw new Error(`${sound}: expected mono, 16 kHz, 16 bits, got ${JSON.stringify(format)}`);
}
const numbers = new Int16Array(wav.buffer.slice(wav.byteOffset + HEADER, wav.byteOffset + wav.length));
const samples = Float32Array.from(numbers, (number) => number / 32768);

const { load } = await import(pathToFileURL(resolve(folder, "anyface.js")));
const { Engine } = await load();
const engine = new Engine();
const timed = (work) => {
  const began = performance.now();
  const result = work();
  return [performance.now() - began, result];
};
const median = (times) => times.sort((a, b) => a - b)[times.length >> 1];

for (const head of heads) {
  const [prepared, face] = timed(() => engine.face(readFileSync(head)));
  const spoken = [1, 2, 3, 4, 5].map(() => {
    const [time, clip] = timed(() => engine.speak(samples, "neutral", true));
    clip.free();
    return time;
  });
  const live = engine.live("neutral");
  const frames = [];
  for (let at = 0; at < samples.length; at += RATE / FPS) {
    const [time, moved] = timed(() => {
      live.push(samples.subarray(at, at + RATE / FPS));
      return engine.liveFrame(face, live);
    });
    if (moved) frames.push(time);
  }
  console.log(
    `${head}: ${face.positions().length / 3} vertices; preparing the face ${prepared.toFixed(0)} ms; ` +
      `${(samples.length / RATE).toFixed(1)} s of speech ${median(spoken).toFixed(0)} ms; ` +
      `a live frame ${median(frames).toFixed(2)} ms in the median`,
  );
}
