// The sweep through the depths, step by step.

import { signal } from "@preact/signals";

import { type SweepChoice, boundSweep, stepMs, sweptDepth, wholeSweep } from "../model/sweep.ts";
import type { View } from "./view.ts";

export class Sweep {
  readonly choice;
  readonly isRunning = signal(false);
  readonly #view: View;
  #timer = 0;
  #direction = 1;

  constructor(view: View) {
    this.#view = view;
    this.choice = signal(wholeSweep(view.shown));
  }

  /** Takes another range, speed or way; a running sweep goes on with it. */
  choose(wished: SweepChoice): void {
    this.choice.value = boundSweep(wished, this.#view.shown);
    if (!this.isRunning.peek()) return;
    this.stop();
    this.start();
  }

  start(): void {
    this.isRunning.value = true;
    this.#timer = window.setInterval(() => this.#step(), stepMs(this.choice.peek()));
    this.#step();
  }

  stop(): void {
    clearInterval(this.#timer);
    this.isRunning.value = false;
  }

  #step(): void {
    const [depth_mm, direction] = sweptDepth(this.#view.now.depth_mm, this.#direction, this.choice.peek());
    this.#direction = direction;
    this.#view.change({ depth_mm });
  }
}
