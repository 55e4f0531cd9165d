// The findings of a reader on a picture: a dot for a point, a line for all others, and their numbers.

import { svg } from "../base/dom.ts";
import type { Mark } from "../model/marks.ts";
import type { Vec2 } from "../model/space.ts";

/** The radius of a point, in CSS pixels: what is marked lies free in the middle. */
const RADIUS = 7;

export class Marks {
  readonly element = svg("svg", { class: "finding-marks", "aria-hidden": "true" });
  #shown = "";

  show(marks: readonly Mark[], [width, height]: Vec2): void {
    const wanted = JSON.stringify([marks, width, height]);
    if (wanted === this.#shown) return;
    this.#shown = wanted;
    this.element.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.element.replaceChildren(...marks.map(drawn));
  }
}

function drawn({ number, places, isClosed, colour, isAway }: Mark): SVGElement {
  const [x, y] = places[0] ?? [0, 0];
  const shape =
    places.length === 1
      ? svg("circle", { cx: x, cy: y, r: RADIUS })
      : svg("path", {
          d: `M${places.map((place) => place.map((part) => part.toFixed(1)).join(" ")).join("L")}${isClosed ? "Z" : ""}`,
        });
  return svg(
    "g",
    { class: isAway ? "away" : null, stroke: colour },
    shape,
    svg("text", { x: x + RADIUS + 3, y: y - RADIUS, fill: colour }, String(number)),
  );
}
