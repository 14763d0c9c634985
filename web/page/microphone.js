// Brings what a microphone hears to 16 kHz, by a windowed sinc, and hands it over in blocks of 20 ms.

const RATE_HZ = 16000;
const BLOCK = 320;
const REACH = 24; // Samples of the microphone on either side of one of ours.

class Microphone extends AudioWorkletProcessor {
  constructor() {
    super();
    this.step = sampleRate / RATE_HZ;
    this.cutoff = Math.min(1, 0.92 / this.step);
    this.heard = new Float32Array(2 * REACH);
    this.place = REACH;
    this.block = [];
  }

  process([[samples]]) {
    if (!samples) return true;
    const heard = new Float32Array(this.heard.length + samples.length);
    heard.set(this.heard);
    heard.set(samples, this.heard.length);
    for (; this.place + REACH < heard.length; this.place += this.step) this.block.push(this.at(heard));
    const gone = Math.max(0, Math.floor(this.place) - REACH);
    this.heard = heard.subarray(gone);
    this.place -= gone;
    while (this.block.length >= BLOCK) this.port.postMessage(new Float32Array(this.block.splice(0, BLOCK)));
    return true;
  }

  at(heard) {
    let sum = 0;
    for (let i = Math.ceil(this.place - REACH); i <= this.place + REACH; i++) {
      const away = i - this.place;
      const angle = Math.PI * this.cutoff * away;
      const sinc = angle === 0 ? 1 : Math.sin(angle) / angle;
      sum += heard[i] * this.cutoff * sinc * (0.5 + 0.5 * Math.cos((Math.PI * away) / REACH));
    }
    return sum;
  }
}

registerProcessor("microphone", Microphone);
