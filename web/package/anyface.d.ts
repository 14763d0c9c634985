import type * as library from "./anyface_web.js";

export type { Clip, Engine, Face, Live } from "./anyface_web.js";

/** The library with its models: classes `Engine`, `Face`, `Clip` and `Live`, and lists of names. */
export type Library = typeof library;

export interface LoadOptions {
  /** The folder that holds the library and its models; default: that of this file. */
  base?: URL;
  /** Hears which share has been fetched, 0 to 1. */
  progress?: (share: number) => void;
}

/** Fetches the library and its models, 5 MB. Call it in a worker: what it offers works on the thread that calls. */
export function load(options?: LoadOptions): Promise<Library>;
