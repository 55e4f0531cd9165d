// The legend of a map over a picture: its name and unit, which value has which colour, and what is transparent.

import { clamp } from "../model/space.ts";
import { h, setText } from "../base/dom.ts";
import { known, number, t } from "../base/i18n.ts";
import { type LayerOverlay, isDiverging, shareOf, styleOf } from "../model/maps.ts";
import { COLOURS, overlayWords, rampOf } from "./overlay.ts";

const ROWS = 64;
/** Colours from the first to the last value, as the server's. */
const MAP_COLOURS = {
  "vermilion-yellow": ["#d55e00", "#e2a121", "#f0e442"],
  "blue-orange": ["#56b4e9", "#a0a0a0", "#e69f00"],
  viridis: COLOURS.viridis,
  hot: COLOURS.hot,
  labels: [],
};

/** Writes numbers of a window with so many digits that its ends differ. */
export function writer([low, high]: readonly [number, number]): (value: number) => string {
  const places = clamp(Math.ceil(1 - Math.log10(high - low)), 0, 6);
  return (value) => number(value, high - low < 50 ? Math.max(places, 1) : 0);
}

export class MapBar {
  readonly element: HTMLElement;
  readonly #name = h("span", {});
  readonly #high = h("span", {});
  readonly #canvas = h("canvas", { width: 1, height: ROWS, class: "ramp" });
  readonly #low = h("span", {});
  /** The threshold on the ramp; of magnitudes, at both ends. */
  readonly #ticks = h("div", { class: "ticks" });
  readonly #ramp = h("div", { class: "ramp-box" }, this.#canvas, this.#ticks);
  #shown: LayerOverlay | null = null;

  constructor() {
    this.element = h(
      "div",
      { class: "colour-bar map-bar", hidden: true },
      this.#name,
      this.#high,
      this.#ramp,
      this.#low,
    );
  }

  show(overlay: LayerOverlay | null): void {
    if (overlay === this.#shown) return;
    this.#shown = overlay;
    this.element.hidden = overlay === null;
    if (!overlay) return;
    const style = styleOf(overlay);
    const { unit, colormap } = style;
    const { threshold } = overlay;
    const window = shownRange(overlay);
    const meaning = known(`map.${overlay.name}.low`);
    setText(this.#name, `${overlayWords(overlay)}${unit && `, ${unit}`}${meaning ? `\n${t(meaning)}` : ""}`);
    const written = writer(window);
    setText(this.#high, written(window[1]));
    setText(this.#low, written(window[0]));
    // Labels have the colours of their numbers.
    for (const part of [this.#high, this.#low, this.#ramp]) part.hidden = colormap === "labels";
    // What lies below the threshold is transparent: its own number says where that begins.
    this.#low.hidden ||= threshold !== null && !isDiverging(style);
    const ends = threshold === null ? [] : isDiverging(style) ? [threshold, -threshold] : [threshold];
    this.#ticks.replaceChildren(...ends.map((end) => tick(end, window, written(end))));
    const context = this.#canvas.getContext("2d");
    if (!context) return;
    // The colours belong to their window, which need not be all of the ramp; beyond its ends they stay.
    const first = ROWS * ((window[1] - style.window[0]) / (window[1] - window[0]));
    context.clearRect(0, 0, 1, ROWS);
    context.fillStyle = rampOf(context, first, MAP_COLOURS[colormap]);
    for (let row = 0; row < ROWS; row += 1) {
      const value = window[1] + ((row + 0.5) / ROWS) * (window[0] - window[1]);
      context.globalAlpha = shareOf(overlay, value);
      context.fillRect(0, row, 1, 1);
    }
  }
}

/** The values at the ends of the ramp: those of the colours, and further down the threshold. */
function shownRange(overlay: LayerOverlay): readonly [number, number] {
  const style = styleOf(overlay);
  const [low, high] = style.window;
  return isDiverging(style) ? [low, high] : [Math.min(low, overlay.threshold ?? low), high];
}

/** A line across the ramp, with its number. */
function tick(value: number, [low, high]: readonly [number, number], words: string): HTMLElement {
  const element = h("div", { class: "tick" }, h("span", { class: "tick-line" }), h("span", {}, words));
  element.style.top = `${100 * clamp((high - value) / (high - low), 0, 1)}%`;
  return element;
}
