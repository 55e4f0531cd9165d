// How much a frame may cost: on a slow device a picture that changes is drawn with less, and in full when it rests.

import { clamp } from "../model/space.ts";
import { number, t } from "../base/i18n.ts";
import type { Gl } from "../gl/gl.ts";
import { type Drawn, FULL_QUALITY, type Quality } from "../gl/scene.ts";
import { FrameTimer } from "../gl/timer.ts";

/** Frames that take longer than this are drawn with less while something changes. */
const SLOW_FRAME_MS = 40;
/** The first frames are no measure: shaders are compiled for them. */
const LEAST_FRAMES = 2;
const COARSE_SHARE = 0.5;
/** After so long without a frame everything rests; where an exact frame takes longer, after as long as one, up to a limit. */
const REST_MS = [150, 1000] as const;

export class Pace {
  readonly #timer = new FrameTimer();
  readonly #full_ms: Record<Drawn, number> = { mesh: 0, exact: 0 };
  readonly #redraw: () => void;
  /** Exact frames that have been timed. */
  #exactFrames = 0;
  #moving = false;
  /** Whether nothing changes: said by the clock alone, for on a slow device a frame may last longer than any rest. */
  #resting = true;
  #rest = 0;

  /** `redraw` is called when a picture that was drawn with less can be drawn in full. */
  constructor(redraw: () => void) {
    this.#redraw = redraw;
  }

  /** Takes note of whether a hand moves the picture, and whether the picture changes. */
  stir(moving: boolean, changes: boolean): void {
    if (changes || moving) this.#resting = false;
    this.#moving = moving;
  }

  /** Which way suits a picture now: exact where the device is fast, and on any as soon as it rests, for the mesh has facets. */
  get way(): Drawn {
    const isFast = this.#exactFrames >= LEAST_FRAMES && this.#full_ms.exact <= SLOW_FRAME_MS;
    return isFast || this.#resting ? "exact" : "mesh";
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

  /**
   * Draws a frame and times it; `hear` is told when the device has drawn it. `isLast`: at rest it would be the same
   * picture.
   */
  time(gl: Gl, frame: { way: Drawn; quality: Quality; isLast: boolean }, draw: () => void, hear: () => void): void {
    const { way, quality, isLast } = frame;
    this.#timer.time(gl, draw, (frame_ms) => {
      if (quality === FULL_QUALITY) this.#full_ms[way] = frame_ms;
      if (quality === FULL_QUALITY && way === "exact") this.#exactFrames += 1;
      hear();
    });
    clearTimeout(this.#rest);
    const [least_ms, most_ms] = REST_MS;
    const rest_ms = clamp(this.#full_ms.exact, least_ms, most_ms);
    this.#rest = window.setTimeout(() => this.#onRest(isLast), rest_ms);
  }

  get frames(): number {
    return this.#timer.times.frames;
  }

  get words(): string {
    const { script_ms, frame_ms, frames } = this.#timer.times;
    if (frame_ms === 0) return t("timer.none");
    return t("timer.text", { frame: number(frame_ms, 1), script: number(script_ms, 2), frames: number(frames) });
  }

  stop(): void {
    clearTimeout(this.#rest);
  }

  #onRest(isLast: boolean): void {
    if (this.#moving) return;
    this.#resting = true;
    if (!isLast) this.#redraw();
  }
}
