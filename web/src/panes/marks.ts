// What a reader has marked and measured, on a picture: a dot for a point, a line for all others, and words beside it.

import { svg } from "../base/dom.ts";
import type { Mark } from "../model/marks.ts";
import type { Vec2 } from "../model/space.ts";

/** The radius of a point, in CSS pixels: what is marked lies free in the middle. */
const RADIUS = 7;

export class Marks {
  readonly element = svg("svg", { class: "finding-marks", "aria-hidden": "true" });
  #size = "";
  readonly #drawn: DrawnMark[] = [];

  show(marks: readonly Mark[], [width, height]: Vec2): void {
    const size = `0 0 ${width} ${height}`;
    if (size !== this.#size) this.element.setAttribute("viewBox", (this.#size = size));
    for (const { element } of this.#drawn.splice(marks.length)) element.remove();
    for (const [at, mark] of marks.entries()) {
      const drawn = (this.#drawn[at] ??= new DrawnMark());
      if (!drawn.element.parentNode) this.element.append(drawn.element);
      drawn.show(mark);
    }
  }
}

/** A mark on the picture: its shapes stay, and are moved when the picture turns. */
class DrawnMark {
  readonly #line = svg("path");
  /** Dark below the line, so that it is seen on white: a filter of all marks would cost more than the picture. */
  readonly #casing = svg("path", { class: "casing" });
  readonly #words = svg("text");
  readonly element = svg("g", {}, this.#casing, this.#line, this.#words);
  #shown = "";
  #look = "";

  show({ words, parts, colour, isAway }: Mark): void {
    const [x, y] = parts[0]?.[0] ?? [0, 0];
    const d = parts.map((places) => (places.length === 1 ? dot(places[0]) : line(places))).join("");
    if (d !== this.#shown) {
      this.#shown = d;
      for (const path of [this.#casing, this.#line]) path.setAttribute("d", d);
      this.#words.setAttribute("x", (x + RADIUS + 3).toFixed(1));
      this.#words.setAttribute("y", (y - RADIUS).toFixed(1));
    }
    const look = [words, colour, isAway].join("\n");
    if (look === this.#look) return;
    this.#look = look;
    this.element.setAttribute("class", isAway ? "away" : "");
    this.element.setAttribute("stroke", colour);
    this.#words.setAttribute("fill", colour);
    this.#words.textContent = words;
  }
}

const line = (places: readonly Vec2[]): string =>
  `M${places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}`;

/** A circle around a place. */
const dot = ([x, y]: Vec2 = [0, 0]): string =>
  `M${(x - RADIUS).toFixed(1)} ${y.toFixed(1)}a${RADIUS} ${RADIUS} 0 1 0 ${2 * RADIUS} 0a${RADIUS} ${RADIUS} 0 1 0 ${-2 * RADIUS} 0`;
