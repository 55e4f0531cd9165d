// Crosses on a picture: the marked point, its mirror image, the pointer.

import { h, svg, tell } from "../base/dom.ts";
import type { Vec2 } from "../model/space.ts";

/** From where to where the ticks of a cross reach, from its middle, in CSS pixels: what is marked lies free. */
const TICKS = { long: [10, 24], short: [5, 14] } as const;
/** Words stand so far from the middle of a mark, and take at most so much room, in CSS pixels. */
const WORDS_GAP = 12;
const WORDS_ROOM = 56;

/** `ticks` are a cross on a slice, `opposite` the same at its mirror image; the others are smaller, with a circle. */
type CursorKind = "ticks" | "opposite" | "mark" | "hidden" | "ghost";

export interface CursorLook {
  readonly kind: CursorKind;
  /** What stands beside it; empty: nothing. */
  readonly words?: string;
  /** The radius of the place around it, in CSS pixels; 0: it has no outline. */
  readonly ring?: number;
}

export class Cursor {
  readonly element = svg("svg", { class: "cursor", "aria-hidden": "true", hidden: true });
  readonly words = h("span", { class: "cursor-words", hidden: true });
  #shown = "";

  /**
   * A cross around `place`, over a pane of `size`. It is broken where it lies behind the surface, `hidden`, and of
   * another colour where it is a mirror image or the pointer's, a `ghost`.
   */
  show(place: Vec2 | null, size: Vec2, { kind, words = "", ring = 0 }: CursorLook): void {
    const wanted = [kind, words, ring, ...(place ? [...place, ...size] : [])].join(" ");
    if (wanted === this.#shown) return;
    this.#shown = wanted;
    this.element.replaceChildren();
    this.element.setAttribute("class", `cursor ${kind}`);
    const isShown = place !== null && place.every(Number.isFinite);
    this.element.toggleAttribute("hidden", !isShown);
    tell(this.words, isShown ? words : "");
    if (!isShown) return;
    const [x, y] = place;
    this.#placeWords(place, size, kind);
    const isLong = kind === "ticks" || kind === "opposite";
    const [gap, reach] = TICKS[isLong ? "long" : "short"];
    const line = (x1: number, y1: number, x2: number, y2: number): SVGElement => svg("line", { x1, y1, x2, y2 });
    this.element.append(
      line(x - reach, y, x - gap, y),
      line(x + gap, y, x + reach, y),
      line(x, y - reach, x, y - gap),
      line(x, y + gap, x, y + reach),
    );
    // Also a small place has its outline outside of the mark.
    const outline = ring > 0 ? Math.max(ring, gap + 4) : 0;
    if (outline > 0) this.element.append(svg("circle", { class: "place", cx: x, cy: y, r: outline }));
    if (!isLong) this.element.append(svg("circle", { cx: x, cy: y, r: gap }));
    // No larger than the mark, for all of it is laid over the picture with every frame.
    const half = Math.ceil(Math.max(reach, outline + 2));
    const [left, top, side] = [x - half, y - half, 2 * half];
    this.element.setAttribute("viewBox", `${left} ${top} ${side} ${side}`);
    Object.assign(this.element.style, { left: `${left}px`, top: `${top}px`, width: `${side}px`, height: `${side}px` });
  }

  /** To the right of the mark, or to its left at the right edge. */
  #placeWords([x, y]: Vec2, [width]: Vec2, kind: CursorKind): void {
    this.words.classList.toggle("ghost", kind === "ghost");
    const isRight = x + WORDS_GAP + WORDS_ROOM > width;
    this.words.style.left = `${isRight ? x - WORDS_GAP : x + WORDS_GAP}px`;
    // Words of both marks at one height would meet in a narrow slice.
    this.words.style.top = `${kind === "ghost" ? y - 24 : y + 4}px`;
    this.words.style.translate = isRight ? "-100%" : "";
  }
}
