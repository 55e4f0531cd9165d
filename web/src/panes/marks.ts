// What a reader has marked and measured, on a picture: a dot for a point, a line for all others, and words beside it.

import { svg } from "../base/dom.ts";
import type { Mark } from "../model/marks.ts";
import type { Vec2 } from "../model/space.ts";

/** The radius of a point, in CSS pixels: what is marked lies free in the middle. */
const RADIUS = 7;

export class Marks {
  readonly element = svg("svg", { class: "finding-marks", "aria-hidden": "true" });
  #size = "";
  /** What each mark is drawn from: those that stay the same are not drawn again. */
  #drawn: string[] = [];

  show(marks: readonly Mark[], [width, height]: Vec2): void {
    const size = `0 0 ${width} ${height}`;
    if (size !== this.#size) this.element.setAttribute("viewBox", (this.#size = size));
    const { children } = this.element;
    while (children.length > marks.length) this.element.lastChild?.remove();
    const wanted = marks.map((mark) => JSON.stringify(mark));
    for (const [at, mark] of marks.entries()) {
      if (wanted[at] === this.#drawn[at] && at < children.length) continue;
      const element = drawn(mark);
      if (at < children.length) children[at]?.replaceWith(element);
      else this.element.append(element);
    }
    this.#drawn = wanted;
  }
}

function drawn({ words, parts, colour, isAway }: Mark): SVGElement {
  const [x, y] = parts[0]?.[0] ?? [0, 0];
  const shapes = parts.map((places) => {
    const [[cx, cy] = [0, 0]] = places;
    if (places.length === 1) return svg("circle", { cx, cy, r: RADIUS });
    return svg("path", { d: `M${places.map((place) => place.map((part) => part.toFixed(1)).join(" ")).join("L")}` });
  });
  return svg(
    "g",
    { class: isAway ? "away" : null, stroke: colour },
    ...shapes,
    svg("text", { x: x + RADIUS + 3, y: y - RADIUS, fill: colour }, words),
  );
}
