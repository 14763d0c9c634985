// Loads the library and the models beside it.
import init, * as library from "./anyface_web.js";

/**
 * Fetches the library and its models from the folder of this file, or from `base`.
 * `progress` hears which share is there, 0 to 1.
 */
export async function load({ base = new URL(".", import.meta.url), progress = () => {} } = {}) {
  await init({ module_or_path: await bytesOf(new URL("anyface_web_bg.wasm.gz", base)).then(unpacked) });
  const names = library.modelNames();
  let done = 0;
  progress(0.2);
  await Promise.all(
    names.map(async (name) => {
      library.addModel(name, new Uint8Array(await bytesOf(new URL(`models/${name}/model.planes.gz`, base))));
      done += 1;
      progress(0.2 + (0.8 * done) / names.length);
    }),
  );
  return library;
}

async function bytesOf(address) {
  if (address.protocol === "file:" && globalThis.process) {
    const { readFile } = await import("node:fs/promises");
    return readFile(address);
  }
  const answer = await fetch(address);
  if (!answer.ok) {
    throw new Error(`Expected ${address}, got ${answer.status} ${answer.statusText}. Copy the whole folder to the host.`);
  }
  return answer.arrayBuffer();
}

/** Hosts that pack files by themselves unpack this one on its way; others hand it over as it is. */
async function unpacked(bytes) {
  const view = new Uint8Array(bytes);
  if (view[0] !== 0x1f || view[1] !== 0x8b) return view;
  const stream = new Blob([view]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}
