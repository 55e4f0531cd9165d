// Crosses on a picture: the marked point, its mirror image, the pointer.

import { h, svg, tell } from "../base/dom.ts";
import { freeOf } from "../model/marks.ts";
import type { Vec2 } from "../model/space.ts";

/** The length of a tick, and how far words stand from it and how much room they take at most, in CSS pixels. */
const TICK = 8;
const WORDS_GAP = 3;
const WORDS_ROOM = 56;

/** A mark, one that lies behind the surface, or a mirror image or the pointer's. */
type CursorKind = "mark" | "hidden" | "ghost";

export interface CursorLook {
  readonly kind: CursorKind;
  /** What stands beside it; empty: nothing. */
  readonly words?: string;
  /** The diameter of the place around it; 0: it has no outline. */
  readonly place_mm?: number;
}

export class Cursor {
  readonly element = svg("svg", { class: "cursor", "aria-hidden": "true", hidden: true });
  readonly words = h("span", { class: "cursor-words", hidden: true });
  #shown = "";

  /**
   * Four ticks around `place`, over a pane of `size`: what is marked lies free. They are broken where it lies behind the surface,
   * `hidden`, and of another colour where it is a mirror image or the pointer's, a `ghost`.
   */
  show(place: Vec2 | null, size: Vec2, mm_per_pixel: number, { kind, words = "", place_mm = 0 }: CursorLook): void {
    const wanted = [kind, words, place_mm, mm_per_pixel, ...(place ? [...place, ...size] : [])].join(" ");
    if (wanted === this.#shown) return;
    this.#shown = wanted;
    this.element.replaceChildren();
    this.element.setAttribute("class", `cursor ${kind}`);
    const isShown = place !== null && place.every(Number.isFinite);
    this.element.toggleAttribute("hidden", !isShown);
    tell(this.words, isShown ? words : "");
    if (!isShown) return;
    const [x, y] = place;
    const gap = freeOf(mm_per_pixel, size);
    const reach = gap + TICK;
    this.#placeWords(place, size, reach + WORDS_GAP, kind);
    const line = (x1: number, y1: number, x2: number, y2: number): SVGElement => svg("line", { x1, y1, x2, y2 });
    this.element.append(
      line(x - reach, y, x - gap, y),
      line(x + gap, y, x + reach, y),
      line(x, y - reach, x, y - gap),
      line(x, y + gap, x, y + reach),
    );
    // Also a small place has its outline outside of the mark.
    const outline = place_mm > 0 ? Math.max(place_mm / 2 / mm_per_pixel, gap + 4) : 0;
    if (outline > 0) this.element.append(svg("circle", { class: "place", cx: x, cy: y, r: outline }));
    // No larger than the mark, for all of it is laid over the picture with every frame.
    const half = Math.ceil(Math.max(reach, outline + 2));
    const [left, top, side] = [x - half, y - half, 2 * half];
    this.element.setAttribute("viewBox", `${left} ${top} ${side} ${side}`);
    Object.assign(this.element.style, { left: `${left}px`, top: `${top}px`, width: `${side}px`, height: `${side}px` });
  }

  /** To the right of the mark, or to its left at the right edge. */
  #placeWords([x, y]: Vec2, [width]: Vec2, away: number, kind: CursorKind): void {
    this.words.classList.toggle("ghost", kind === "ghost");
    const isRight = x + away + WORDS_ROOM > width;
    this.words.style.left = `${isRight ? x - away : x + away}px`;
    // Words of both marks at one height would meet in a narrow slice.
    this.words.style.top = `${kind === "ghost" ? y - 24 : y + 4}px`;
    this.words.style.translate = isRight ? "-100%" : "";
  }
}
