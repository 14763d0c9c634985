// Which frame the head shows when: that of the sound being played, or the last one of the microphone.
import { Player, microphone } from "./sound.js";
import { Stage } from "./stage.js";
import { call } from "./work.js";

// Frames that are fetched before they are shown, and of those kept.
const AHEAD = 4;

export class Show {
  constructor(canvas, { onstate, onerror }) {
    this.stage = new Stage(canvas);
    this.player = new Player(onstate);
    this.onstate = onstate;
    this.onerror = onerror;
    this.frames = new Map();
    this.asked = new Set();
    this.generation = 0;
    // What tests and measures read.
    this.measured = { frames: 0, frameMs: [], firstAt: undefined };
    window.anyface = this.measured;
    const tick = () => {
      this.tick();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  get isPlaying() {
    return this.player.isPlaying;
  }

  get isListening() {
    return this.stopMicrophone !== undefined;
  }

  get time() {
    return this.player.time;
  }

  get duration() {
    return this.player.duration;
  }

  async head(head, file) {
    this.clipped = undefined;
    this.forget();
    const showsFile = await this.stage.show(head, file);
    if (!showsFile) await call("form", { name: "scene" });
    return showsFile;
  }

  /** Moves a head by the shapes that its file has, or by its vertices. */
  async byShapes(are) {
    await call("form", { name: are ? "shapes" : "stored" });
    this.stage.byShapes(are);
    this.newest = undefined;
    this.forget();
  }

  sound(buffer) {
    this.clipped = undefined;
    this.forget();
    this.player.set(buffer);
  }

  /** Takes a clip of the sound; undefined frames are fetched as they are needed. */
  async clip(clip, play) {
    this.clipped = clip;
    this.forget();
    await this.fetch(this.now());
    if (play) await this.play();
  }

  async play() {
    await this.stopListening();
    const plays = await this.player.play();
    this.onstate();
    return plays;
  }

  pause() {
    this.player.pause();
    this.onstate();
  }

  seek(time) {
    this.player.seek(time);
  }

  /** The worker that knew the clip is gone. */
  lose() {
    this.clipped = undefined;
    this.pause();
    this.stopListening();
  }

  /** Forgets frames that have changed; the one on the screen stays until it comes again. */
  forget() {
    this.frames.clear();
    this.asked.clear();
    this.generation += 1;
    this.shown = undefined;
  }

  now() {
    return Math.min(this.clipped.frames - 1, Math.max(0, this.player.time * this.clipped.fps));
  }

  tick() {
    if (this.isListening) {
      // Frames that came while the screen was busy are passed over.
      if (this.newest) this.stage.pose(this.newest.moved, this.newest.head);
      this.newest = undefined;
      return;
    }
    if (!this.clipped) return;
    if (this.isPlaying) this.onstate();
    const now = this.now();
    const first = Math.floor(now);
    for (let k = first; k <= Math.min(first + AHEAD, this.clipped.frames - 1); k++) this.fetch(k);
    for (const k of this.frames.keys()) if (k < first || k > first + 2 * AHEAD) this.frames.delete(k);
    const frame = this.frames.get(first);
    if (!frame || this.shown === now) return;
    const next = this.frames.get(first + 1);
    this.stage.pose(...(next ? between(frame, next, now - first) : [frame.moved, frame.head]));
    this.shown = now;
    this.measured.frames += 1;
    this.measured.firstAt ??= performance.now();
  }

  async fetch(place) {
    const number = Math.floor(place);
    if (this.frames.has(number) || this.asked.has(number)) return;
    const { generation } = this;
    this.asked.add(number);
    try {
      const frame = await call("frame", { number });
      this.measured.frameMs.push(frame.took);
      if (generation === this.generation) this.frames.set(number, frame);
    } catch (error) {
      this.clipped = undefined;
      this.onerror(error);
    } finally {
      if (generation === this.generation) this.asked.delete(number);
    }
  }

  /** Lets the head follow the microphone; seconds that it lies behind. */
  async listen(emotion) {
    this.pause();
    const { latency } = await call("liveStart", { emotion });
    const push = (samples) => call("livePush", { samples }, [samples.buffer]).catch((error) => {
      this.stopListening();
      this.onerror(error);
    });
    this.stopMicrophone = await microphone(push);
    this.onstate();
    return latency;
  }

  async stopListening() {
    if (!this.isListening) return;
    this.stopMicrophone();
    this.stopMicrophone = undefined;
    this.shown = this.newest = undefined;
    await call("liveStop");
    this.onstate();
  }

  liveFrame({ moved, head, took }) {
    if (!this.isListening) return;
    this.measured.frames += 1;
    this.measured.frameMs.push(took);
    this.newest = { moved, head };
  }
}

/** A pose between two frames. */
function between(one, other, share) {
  const mix = (a, b) => a.map((x, i) => x + share * (b[i] - x));
  return [mix(one.moved, other.moved), mix(one.head, other.head)];
}
