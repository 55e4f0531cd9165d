// The trace of the slice across the sulcus in another slice: a line through the mark, with a handle at each end.

import { svg } from "../base/dom.ts";
import { STILL_PIXELS } from "./gestures.ts";
import type { Vec2 } from "../model/space.ts";

/** The middle is left free, as by the cross; lengths in CSS pixels. */
const GAP = 30;
const RADIUS = 6;
/** How far handles stay away from the borders of the pane. */
const INSET = 22;
/** A finger needs more room than is seen. */
const TOUCH_RADIUS = 16;

/** How far it is from a place to the border of a side, along a direction that goes by so much along it. */
const roomIn = (side: number, place: number, along: number): number =>
  along > 0 ? (side - INSET - place) / along : along < 0 ? (INSET - place) / along : Infinity;

export class Trace {
  readonly element = svg("svg", { class: "trace", "aria-hidden": "true", hidden: true });
  readonly #lines = [svg("line"), svg("line")];
  readonly #handles = [svg("circle", { r: RADIUS }), svg("circle", { r: RADIUS })];
  readonly #grips = [0, 1].map(() => svg("circle", { class: "grip", r: TOUCH_RADIUS }));

  /** `turn` hears where a handle is dragged to. */
  constructor(turn: (place: Vec2) => void) {
    this.element.append(...this.#lines, ...this.#handles, ...this.#grips);
    for (const grip of this.#grips) {
      let from: Vec2 | null = null;
      const placeOf = ({ clientX, clientY }: PointerEvent): Vec2 => {
        const { left, top } = this.element.getBoundingClientRect();
        return [clientX - left, clientY - top];
      };
      grip.addEventListener("pointerdown", (event) => {
        // The slice itself would put the mark here.
        event.stopPropagation();
        event.preventDefault();
        from = placeOf(event);
        grip.setPointerCapture(event.pointerId);
      });
      grip.addEventListener("pointermove", (event) => {
        if (!grip.hasPointerCapture(event.pointerId)) return;
        const place = placeOf(event);
        if (from && Math.hypot(place[0] - from[0], place[1] - from[1]) < STILL_PIXELS) return;
        from = null;
        turn(place);
      });
    }
  }

  /** A line through `middle` along `direction`, which has a length; null: there is none. */
  show(middle: Vec2 | null, direction: Vec2 | null, [width, height]: Vec2): void {
    const isShown = middle !== null && direction !== null && width > 0 && height > 0;
    this.element.toggleAttribute("hidden", !isShown);
    if (!isShown) return;
    this.element.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const size = Math.hypot(...direction);
    const longest = Math.min(width, height) / 2 - INSET;
    for (const [at, sign] of [1, -1].entries()) {
      const [dx, dy] = [(sign * direction[0]) / size, (sign * direction[1]) / size];
      // Handles stay in the pane, wherever the mark is.
      const reach = Math.min(longest, roomIn(width, middle[0], dx), roomIn(height, middle[1], dy));
      const parts = [this.#lines[at], this.#handles[at], this.#grips[at]];
      for (const part of parts) part?.toggleAttribute("hidden", reach < GAP + RADIUS);
      const [x, y] = [middle[0] + reach * dx, middle[1] + reach * dy];
      const line = { x1: middle[0] + GAP * dx, y1: middle[1] + GAP * dy, x2: x - RADIUS * dx, y2: y - RADIUS * dy };
      for (const [name, value] of Object.entries(line)) this.#lines[at]?.setAttribute(name, value.toFixed(1));
      for (const circle of [this.#handles[at], this.#grips[at]]) {
        circle?.setAttribute("cx", x.toFixed(1));
        circle?.setAttribute("cy", y.toFixed(1));
      }
    }
  }
}
