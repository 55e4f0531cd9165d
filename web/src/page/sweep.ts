// The sweep through the depths, to and fro.

import type { ReadyCase } from "../model/case.ts";
import { sweptDepth } from "../model/state.ts";

/** The sweep's steps. */
const STEP_MS = 100;

export class Sweep {
  readonly #shown: ReadyCase;
  readonly #depth_mm: () => number;
  readonly #go: (depth_mm: number) => void;
  #timer = 0;
  #direction = 1;

  /** `go` is given the depth of every step, from the one that `depth_mm` tells. */
  constructor(shown: ReadyCase, depth_mm: () => number, go: (depth_mm: number) => void) {
    this.#shown = shown;
    this.#depth_mm = depth_mm;
    this.#go = go;
  }

  get isRunning(): boolean {
    return this.#timer !== 0;
  }

  start(): void {
    this.#timer = window.setInterval(() => this.#step(), STEP_MS);
    this.#step();
  }

  /** Whether there was anything to stop. */
  stop(): boolean {
    if (!this.isRunning) return false;
    clearInterval(this.#timer);
    this.#timer = 0;
    return true;
  }

  #step(): void {
    const [next, direction] = sweptDepth(this.#depth_mm(), this.#direction, this.#shown);
    this.#direction = direction;
    this.#go(next);
  }
}
