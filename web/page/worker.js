// The work, away from the page: finds faces, moves them. Answers each message by its number.
import { load } from "./anyface/anyface.js";

let anyface, engine, face, clip, live;
// What the page moves: the positions that a file stores, those of the scene, or the shapes that the file has.
const forms = {
  stored: (moved) => face.storedDisplacements(moved),
  scene: (moved) => moved,
  shapes: (moved) => face.targetWeights(moved),
};
let form = forms.stored;

const kinds = {
  async load() {
    anyface = await load({ progress: (share) => tell("Fetching Anyface", share) });
    engine = new anyface.Engine();
    return { emotions: anyface.emotionNames() };
  },
  face({ file, landmarks }) {
    const found = engine.face(new Uint8Array(file), landmarks, (stage, share) =>
      tell(stage === "landmarks" ? "Looking for the face" : "Preparing the face", share),
    );
    face?.free();
    face = found;
    form = forms.stored;
    return {
      positions: face.positions(), triangles: face.triangles(), place: face.place(), notes: face.notes(),
      parts: face.glbParts(), shapes: face.targetPlaces(), roles: face.roles(), pieces: face.parts(),
    };
  },
  form({ name }) {
    form = forms[name];
  },
  speak({ samples, emotion }) {
    tell("Listening", 0);
    const spoken = engine.speak(samples, emotion, true);
    clip?.free();
    clip = spoken;
    return { frames: clip.frameCount, fps: clip.fps };
  },
  frame({ number }) {
    const began = performance.now();
    const moved = form(engine.clipFrame(face, clip, number));
    return { moved, head: clip.head(number), took: performance.now() - began };
  },
  event({ text }) {
    clip.addEvent(text);
  },
  clearEvents() {
    clip?.clearEvents();
  },
  export() {
    tell("Writing the GLB", 0);
    return { bytes: engine.exportGlb(face, clip) };
  },
  liveStart({ emotion }) {
    live?.free();
    live = engine.live(emotion);
    return { fps: live.fps, latency: live.latencyS };
  },
  livePush({ samples }) {
    if (!live) return;
    live.push(samples);
    for (;;) {
      const began = performance.now();
      const shown = engine.liveFrame(face, live);
      if (!shown) return;
      const moved = form(shown);
      const message = { live: { moved, head: live.head(), took: performance.now() - began } };
      postMessage(message, [moved.buffer]);
    }
  },
  liveEmotion({ emotion }) {
    live?.setEmotion(emotion);
  },
  liveShow({ expression, seconds }) {
    live?.show(expression, seconds);
  },
  liveStop() {
    live?.free();
    live = undefined;
  },
};

function tell(what, share) {
  postMessage({ progress: { what, share } });
}

function buffersOf(answer) {
  return Object.values(answer ?? {})
    .filter((value) => ArrayBuffer.isView(value))
    .map((value) => value.buffer);
}

self.onmessage = async ({ data: { id, kind, ...message } }) => {
  try {
    const answer = await kinds[kind](message);
    postMessage({ id, answer }, buffersOf(answer));
  } catch (error) {
    // A trap leaves memory of which nothing can be told any more.
    postMessage({ id, error: error.message, isBroken: error instanceof WebAssembly.RuntimeError });
  }
};
