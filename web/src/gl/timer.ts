// How long frames take: JavaScript, and from its beginning until the device has drawn it.

import { type Gl, finished } from "./gl.ts";

/**
 * Of the last frames, the one in the middle by duration: the first ones, for which shaders are compiled, do not count
 * for much.
 */
interface FrameTimes {
  readonly script_ms: number;
  readonly frame_ms: number;
  readonly frames: number;
}

/** Frames that are remembered. */
const REMEMBERED = 30;

export class FrameTimer {
  readonly #script: number[] = [];
  readonly #frame: number[] = [];
  #frames = 0;
  #waits = false;

  /** Times a drawing. Only one frame at a time is waited for; the others' scripts are timed alone. */
  time(gl: Gl, draw: () => void, hear: (frame_ms: number) => void): void {
    const begun = performance.now();
    draw();
    remember(this.#script, performance.now() - begun);
    this.#frames += 1;
    if (this.#waits) return;
    this.#waits = true;
    void finished(gl).then(() => {
      this.#waits = false;
      const frame_ms = performance.now() - begun;
      remember(this.#frame, frame_ms);
      hear(frame_ms);
    });
  }

  get times(): FrameTimes {
    return { script_ms: middle(this.#script), frame_ms: middle(this.#frame), frames: this.#frames };
  }
}

function remember(list: number[], value: number): void {
  list.push(value);
  if (list.length > REMEMBERED) list.shift();
}

const middle = (list: readonly number[]): number => [...list].sort((a, b) => a - b)[list.length >> 1] ?? 0;
