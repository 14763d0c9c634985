// Runs Rhubarb Lip Sync, as npm carries it, on the sounds whose text is known.
//
//     node rhubarb.mjs PACKAGES SOUNDS OUT
//
// SOUNDS holds `<name>.wav` (16 bits, 16 kHz, mono) and `texts.json`, words by name. OUT gets `<name>.json`: cues with `start` and `end` in seconds and `value`, a mouth shape. What OUT has is not made again.

import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

const WAV_HEADER = 44;
const [packages, sounds, out] = process.argv.slice(2).map((place) => path.resolve(place));
const entry = path.join(packages, "node_modules/rhubarb-lip-sync-wasm/dist/index.js");
const { Rhubarb } = await import(pathToFileURL(entry));
const texts = JSON.parse(fs.readFileSync(path.join(sounds, "texts.json"), "utf8"));
fs.mkdirSync(out, { recursive: true });
for (const [name, dialogText] of Object.entries(texts)) {
  const place = path.join(out, `${name}.json`);
  if (fs.existsSync(place)) continue;
  const samples = fs.readFileSync(path.join(sounds, `${name}.wav`)).subarray(WAV_HEADER);
  const { mouthCues } = await Rhubarb.getLipSync(Buffer.from(samples), { dialogText });
  fs.writeFileSync(place, JSON.stringify(mouthCues));
}
