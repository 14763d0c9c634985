// Sounds: decoded, played, and heard from a microphone.

const RATE_HZ = 16000;
let context;

function audio() {
  context ??= new AudioContext();
  return context;
}

/** The sound of a file: to be played, and as 16 kHz mono. */
export async function decode(bytes, name) {
  let buffer;
  try {
    buffer = await new OfflineAudioContext(1, 1, RATE_HZ).decodeAudioData(bytes.slice(0));
  } catch {
    throw new Error(
      `${name}: expected a sound that this browser can play, such as MP3, WAV or M4A, got something else. ` +
        "Save it as one of these and drop it again.",
    );
  }
  // Decoded at the rate of the context, with all its channels; the mean of these is heard.
  const samples = new Float32Array(buffer.length);
  for (let c = 0; c < buffer.numberOfChannels; c++) {
    const channel = buffer.getChannelData(c);
    for (let i = 0; i < samples.length; i++) samples[i] += channel[i] / buffer.numberOfChannels;
  }
  return { buffer: await playable(bytes, buffer), samples };
}

async function playable(bytes, fallback) {
  try {
    return await audio().decodeAudioData(bytes.slice(0));
  } catch {
    return fallback;
  }
}

/** Plays one sound after the other; its clock is that of the sound. */
export class Player {
  constructor(onend) {
    this.onend = onend;
    this.from = 0;
  }

  set(buffer) {
    this.pause();
    this.buffer = buffer;
    this.from = 0;
  }

  get duration() {
    return this.buffer?.duration ?? 0;
  }

  get isPlaying() {
    return this.source !== undefined;
  }

  get time() {
    const now = this.isPlaying ? this.from + audio().currentTime - this.began : this.from;
    return Math.min(this.duration, now);
  }

  /** Whether the browser lets it sound; before somebody has pressed a key or a button it may not. */
  async play() {
    if (this.isPlaying || !this.buffer) return true;
    const soon = new Promise((resolve) => setTimeout(resolve, 300));
    await Promise.race([audio().resume(), soon]);
    if (audio().state !== "running") return false;
    if (this.from >= this.duration - 0.05) this.from = 0;
    const source = audio().createBufferSource();
    source.buffer = this.buffer;
    source.connect(audio().destination);
    source.onended = () => {
      if (this.source !== source) return;
      this.from = this.duration;
      this.source = undefined;
      this.onend();
    };
    this.began = audio().currentTime;
    source.start(0, this.from);
    this.source = source;
    return true;
  }

  pause() {
    if (!this.isPlaying) return;
    const { source, time } = this;
    this.source = undefined;
    this.from = time;
    source.stop();
  }

  seek(time) {
    const was = this.isPlaying;
    this.pause();
    this.from = time;
    if (was) this.play();
  }
}

/** Calls `hear` with blocks of 16 kHz mono until the function that it returns is called. */
export async function microphone(hear) {
  let stream;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ audio: { channelCount: 1 } });
  } catch (error) {
    const why = error.name === "NotFoundError" ? "found none" : `got none (${error.name})`;
    throw new Error(
      `Expected a microphone that this page may use, ${why}. ` +
        "Plug one in or allow it beside the address of the page, and press Microphone again.",
    );
  }
  await audio().audioWorklet.addModule(new URL("microphone.js", import.meta.url).href);
  await audio().resume();
  const source = audio().createMediaStreamSource(stream);
  const node = new AudioWorkletNode(audio(), "microphone", { numberOfOutputs: 0 });
  node.port.onmessage = ({ data }) => hear(data);
  source.connect(node);
  return () => {
    node.port.onmessage = null;
    source.disconnect();
    stream.getTracks().forEach((track) => track.stop());
  };
}
