// How much a frame may cost: on a slow device a picture that changes is drawn with less, and in full when it rests.

import type { Gl } from "../gl/gl.ts";
import { type Drawn, FULL_QUALITY, type Quality } from "../gl/painter.ts";
import { FrameTimer } from "../gl/timer.ts";

/** Frames that take longer than this are drawn with less while something changes. */
const SLOW_FRAME_MS = 40;
const COARSE_SHARE = 0.5;
/** After so long without a frame everything rests. */
const REST_MS = 150;

export class Pace {
  readonly #timer = new FrameTimer();
  readonly #full_ms: Record<Drawn, number> = { mesh: 0, exact: 0 };
  readonly #redraw: () => void;
  #moving = false;
  /** Whether nothing changes: said by the clock alone, for on a slow device a frame may last longer than any rest. */
  #resting = true;
  #rest = 0;

  /** `redraw` is called when a picture that was drawn with less can be drawn in full. */
  constructor(redraw: () => void) {
    this.#redraw = redraw;
  }

  /** Hears whether a hand moves the picture, and whether it changes. */
  stir(moving: boolean, changes: boolean): void {
    if (changes || moving) this.#resting = false;
    this.#moving = moving;
  }

  /**
   * On a slow device a picture that changes is drawn with less: the mesh with hard edges, and while something is
   * dragged, the isosurface at half the resolution. As soon as it rests it is drawn in full.
   */
  qualityOf(way: Drawn): Quality {
    if (this.#full_ms[way] <= SLOW_FRAME_MS) return FULL_QUALITY;
    if (way === "exact") return this.#moving ? { share: COARSE_SHARE, depths: 2 } : FULL_QUALITY;
    return this.#resting ? FULL_QUALITY : { share: 1, depths: 1 };
  }

  /** Draws a frame and times it; `hear` is told when the device has drawn it. */
  time(gl: Gl, way: Drawn, quality: Quality, draw: () => void, hear: () => void): void {
    this.#timer.time(gl, draw, (frame_ms) => {
      if (quality === FULL_QUALITY) this.#full_ms[way] = frame_ms;
      hear();
    });
    clearTimeout(this.#rest);
    this.#rest = window.setTimeout(() => this.#onRest(quality), REST_MS);
  }

  get frames(): number {
    return this.#timer.times.frames;
  }

  /** The times of the last frames, in words. */
  get words(): string {
    const { script_ms, frame_ms, frames } = this.#timer.times;
    return `${frame_ms.toFixed(1)} ms · JS ${script_ms.toFixed(2)} ms · ${frames}`;
  }

  stop(): void {
    clearTimeout(this.#rest);
  }

  #onRest(quality: Quality): void {
    if (this.#moving) return;
    this.#resting = true;
    if (quality !== FULL_QUALITY) this.#redraw();
  }
}
