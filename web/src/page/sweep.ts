// The sweep through the depths, step by step.

import type { ReadyCase } from "../model/case.ts";
import { type SweepChoice, stepMs, sweptDepth, wholeSweep } from "../model/sweep.ts";

export class Sweep {
  readonly #depth_mm: () => number;
  readonly #go: (depth_mm: number) => void;
  #choice: SweepChoice;
  #timer = 0;
  #direction = 1;

  /** `go` gets the depth of every step; the first one comes from `depth_mm`. */
  constructor(shown: ReadyCase, depth_mm: () => number, go: (depth_mm: number) => void) {
    this.#choice = wholeSweep(shown);
    this.#depth_mm = depth_mm;
    this.#go = go;
  }

  get choice(): SweepChoice {
    return this.#choice;
  }

  /** Takes another range, speed or way; a running sweep goes on with it. */
  choose(choice: SweepChoice): void {
    this.#choice = choice;
    if (this.stop()) this.start();
  }

  get isRunning(): boolean {
    return this.#timer !== 0;
  }

  start(): void {
    this.#timer = window.setInterval(() => this.#step(), stepMs(this.#choice));
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
    const [next, direction] = sweptDepth(this.#depth_mm(), this.#direction, this.#choice);
    this.#direction = direction;
    this.#go(next);
  }
}
