// Displacements of a head that speaks a sound, by the npm package: node native.mjs PACKAGE HEAD LANDMARKS SOUND OUT.
// SOUND and OUT: 32-bit floats; prints what it takes, milliseconds, and what the targets of HEAD show.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [folder, head, landmarks, sound, out] = process.argv.slice(2);
const began = performance.now();
const lap = () => Math.round(performance.now() - began);
const { load } = await import(pathToFileURL(`${folder}/anyface.js`));
const { Engine } = await load();
const engine = new Engine();
const loaded = lap();
const known = landmarks === "-" ? undefined : readFileSync(landmarks, "utf8");
const face = engine.face(readFileSync(head), known);
const faceReady = lap();
const bytes = readFileSync(sound);
const samples = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
const clip = engine.speak(samples, "happy:0.7", false);
const spoken = lap();
const frames = [];
for (let t = 0; t < clip.frameCount; t++) frames.push(engine.clipFrame(face, clip, t));
const moved = lap();
const all = new Float32Array(frames.length * frames[0].length);
frames.forEach((frame, t) => all.set(frame, t * frame.length));
writeFileSync(out, new Uint8Array(all.buffer));
const names = face.targetNames();
const weights = names.length > 0 ? frames.map((frame) => [...face.targetWeights(frame)]) : [];
let refusal = "";
try {
  face.targetWeights(frames[0].subarray(3));
} catch (error) {
  refusal = error.message;
}
const glb = engine.exportGlb(face, clip);
writeFileSync(`${out}.glb`, glb);
console.log(
  JSON.stringify({
    loaded, face: faceReady - loaded, spoken: spoken - faceReady, frames: clip.frameCount,
    frame: (moved - spoken) / clip.frameCount, exported: lap() - moved, notes: face.notes(),
    names, weights, refusal, places: [...face.targetPlaces()],
    mouth: frames.map((frame) => Math.max(...frame)),
  }),
);
