// Crossed lines on a picture: the marked point, its mirror image, the pointer.

import { svg } from "../base/dom.ts";
import type { Vec2 } from "../model/space.ts";

/** How far a mark reaches from its middle, in CSS pixels. */
const MARK_REACH = 14;

/** `lines` go from edge to edge, the others are small marks. */
export type CursorKind = "lines" | "mark" | "hidden" | "ghost";

export class Cursor {
  readonly element = svg("svg", { class: "cursor", "aria-hidden": "true", hidden: true });
  #shown = "";

  /**
   * Crossed lines with a gap at `place`, over a pane of `size`. They are broken where they lie behind the surface,
   * `hidden`, and of another colour where they are a mirror image or the pointer's, a `ghost`.
   */
  show(place: Vec2 | null, size: Vec2, kind: CursorKind): void {
    const wanted = [kind, ...(place ? [...place, ...size] : [])].join(" ");
    if (wanted === this.#shown) return;
    this.#shown = wanted;
    this.element.replaceChildren();
    this.element.setAttribute("class", `cursor ${kind}`);
    const isShown = place !== null && place.every(Number.isFinite);
    this.element.toggleAttribute("hidden", !isShown);
    if (!isShown) return;
    const [x, y] = place;
    const [gap, reach] = kind === "lines" ? [10, Math.max(...size)] : [5, MARK_REACH];
    const line = (x1: number, y1: number, x2: number, y2: number): SVGElement => svg("line", { x1, y1, x2, y2 });
    this.element.append(
      line(x - reach, y, x - gap, y),
      line(x + gap, y, x + reach, y),
      line(x, y - reach, x, y - gap),
      line(x, y + gap, x, y + reach),
    );
    if (kind === "lines") return;
    this.element.append(svg("circle", { cx: x, cy: y, r: gap }));
    // No larger than the mark, for all of it is laid over the picture with every frame.
    const [left, top, side] = [x - MARK_REACH, y - MARK_REACH, 2 * MARK_REACH];
    this.element.setAttribute("viewBox", `${left} ${top} ${side} ${side}`);
    Object.assign(this.element.style, { left: `${left}px`, top: `${top}px` });
  }
}
