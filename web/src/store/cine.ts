// The cine: slices go through the head by themselves, there and back, until any input stops them.

import { signal } from "@preact/signals";

import { commandOf } from "../model/keys.ts";
import { reachOf } from "../model/slice-geometry.ts";
import { PLANES, type Plane, type Vec3, clamp } from "../model/space.ts";
import { sweptDepth } from "../model/sweep.ts";
import type { View } from "./view.ts";

const STEP_MM = 1;
const STEP_MS = 100;
/** Keys that do nothing by themselves. */
const MODIFIERS: readonly string[] = ["Shift", "Control", "Alt", "Meta"];

export class Cine {
  /** The plane of the slices that go; null: none. */
  readonly plane = signal<Plane | null>(null);
  readonly #view: View;
  readonly #move: (position: Vec3) => void;
  #timer = 0;
  #direction = 1;
  #stopping = new AbortController();

  constructor(view: View, move: (position: Vec3) => void) {
    this.#view = view;
    this.#move = move;
  }

  toggle(plane: Plane): void {
    const isRunning = this.plane.peek() === plane;
    this.stop();
    if (isRunning) return;
    this.plane.value = plane;
    this.#timer = window.setInterval(() => this.#step(plane), STEP_MS);
    this.#stopping = new AbortController();
    const { signal: given } = this.#stopping;
    for (const kind of ["pointerdown", "keydown", "wheel"])
      window.addEventListener(kind, (event) => this.#hear(event), { capture: true, passive: true, signal: given });
  }

  stop(): void {
    clearInterval(this.#timer);
    this.#stopping.abort();
    this.plane.value = null;
  }

  /** Its own key and button stop it themselves. */
  #hear(event: Event): void {
    const isOnButton = event.target instanceof Element && event.target.closest("[data-cine]") !== null;
    const isOwn =
      event instanceof KeyboardEvent
        ? MODIFIERS.includes(event.key) ||
          commandOf(event)?.kind === "cine" ||
          (isOnButton && (event.key === "Enter" || event.key === " "))
        : isOnButton && event.type === "pointerdown";
    if (!isOwn) this.stop();
  }

  #step(plane: Plane): void {
    const { axis } = PLANES[plane];
    const { now, shown } = this.#view;
    const { center_in_patient: center, radius_mm } = shown.envelope_sphere;
    const position = now.crosshair_mm ?? center;
    // Beside the head there is nothing to see.
    const [low, high] = reachOf(shown, axis);
    const ends = [-radius_mm, radius_mm].map((away) => clamp(Math.round((center[axis] ?? 0) + away), low, high));
    const [from_mm = low, to_mm = high] = ends;
    const [next, direction] = sweptDepth(
      position[axis] ?? 0,
      this.#direction,
      { from_mm, to_mm, turns: true },
      STEP_MM,
    );
    this.#direction = direction;
    this.#move(position.map((one, at) => (at === axis ? next : one)) as unknown as Vec3);
  }
}
