// The legend of a map over a picture: its name and unit, which value has which colour, and what is transparent.

import { h, setText } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { type MapOverlay, isDiverging, shareOf, styleOf } from "../model/maps.ts";
import { COLOURS } from "./overlay.ts";

const ROWS = 64;
/** Colours from the first to the last value, as the server's. */
const MAP_COLOURS = {
  "vermilion-yellow": ["#d55e00", "#e2a121", "#f0e442"],
  "blue-orange": ["#56b4e9", "#a0a0a0", "#e69f00"],
  viridis: COLOURS.viridis,
};

export class MapBar {
  readonly element: HTMLElement;
  readonly #name = h("span", {});
  readonly #high = h("span", {});
  readonly #canvas = h("canvas", { width: 1, height: ROWS, class: "ramp" });
  readonly #low = h("span", {});
  readonly #hidden = h("span", {});
  #shown: MapOverlay | null = null;

  constructor() {
    this.element = h(
      "div",
      { class: "colour-bar map-bar", hidden: true },
      this.#name,
      this.#high,
      this.#canvas,
      this.#low,
      this.#hidden,
    );
  }

  show(overlay: MapOverlay | null): void {
    if (overlay === this.#shown) return;
    this.#shown = overlay;
    this.element.hidden = overlay === null;
    if (!overlay) return;
    const { unit, window, colormap } = styleOf(overlay.name);
    const { threshold } = overlay;
    setText(this.#name, `${t(`map.${overlay.name}`)}${unit && `, ${unit}`}`);
    setText(this.#high, number(window[1], 1));
    setText(this.#low, number(window[0], 1));
    this.#hidden.hidden = threshold === null;
    const size = isDiverging(overlay.name) ? `|${unit}|` : unit;
    setText(this.#hidden, threshold === null ? "" : `${size} > ${number(threshold, 1)}`);
    const context = this.#canvas.getContext("2d");
    if (!context) return;
    const ramp = context.createLinearGradient(0, ROWS, 0, 0);
    const colours = MAP_COLOURS[colormap];
    colours.forEach((colour, index) => ramp.addColorStop(index / (colours.length - 1), colour));
    context.clearRect(0, 0, 1, ROWS);
    context.fillStyle = ramp;
    for (let row = 0; row < ROWS; row += 1) {
      const value = window[1] + ((row + 0.5) / ROWS) * (window[0] - window[1]);
      context.globalAlpha = shareOf(overlay, value);
      context.fillRect(0, row, 1, 1);
    }
  }
}
