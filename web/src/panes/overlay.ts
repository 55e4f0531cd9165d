// What stands on a picture: the patient's directions, scale, depth, colours, the cursor, and what the picture is not
// for.

import type { Edges } from "../model/camera.ts";
import type { Window } from "../model/case.ts";
import { h, setText } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { scaleBar } from "../base/readout.ts";
import type { Vec2 } from "../model/space.ts";
import { type Colormap, windowEnds } from "../model/state.ts";
import { Cursor, type CursorKind } from "./cursor.ts";

export const SIDES = ["left", "right", "top", "bottom"] as const;

/** The writing on one picture. */
export class Overlay {
  readonly element: HTMLElement;
  readonly #edges = SIDES.map((side) => h("span", { class: `edge ${side}` }));
  readonly #title = h("span", { class: "pane-title" });
  readonly #badge = h("span", { class: "badge", hidden: true });
  readonly #case = h("span", { class: "pane-case", hidden: true });
  readonly #scaleLine = h("span", { class: "scale-line" });
  readonly #scaleText = h("span", { class: "scale-text" });
  readonly #cursor = new Cursor();
  readonly #twin = new Cursor();

  constructor(host: HTMLElement) {
    this.element = h(
      "div",
      { class: "overlay" },
      // Letters stand before its lines.
      this.#cursor.element,
      this.#twin.element,
      ...this.#edges,
      h("div", { class: "pane-head" }, h("div", { class: "pane-line" }, this.#title, this.#badge), this.#case),
      h("div", { class: "scale" }, this.#scaleText, this.#scaleLine),
      h("span", { class: "pane-notice" }, t("notice.short")),
    );
    host.append(this.element);
  }

  letter(edges: Edges): void {
    this.#edges.forEach((edge, index) => setText(edge, edges[SIDES[index] ?? "left"]));
  }

  title(words: string, badge = ""): void {
    setText(this.#title, words);
    setText(this.#badge, badge);
    this.#badge.hidden = badge === "";
  }

  /** Names the case that is shown. */
  identity(words: string): void {
    setText(this.#case, words);
    this.#case.hidden = words === "";
  }

  scale(mm_per_pixel: number, width: number): void {
    const bar = scaleBar(mm_per_pixel, width / 4);
    this.#scaleLine.style.width = `${bar.pixels}px`;
    setText(this.#scaleText, `${number(bar.mm)} mm`);
  }

  /** The marked point, or the pointer: see `Cursor`. */
  cursor(place: Vec2 | null, size: Vec2, kind: CursorKind): void {
    this.#cursor.show(place, size, kind);
  }

  /** Where the mirror image of the marked point is. */
  twin(place: Vec2 | null, size: Vec2): void {
    this.#twin.show(place, size, "ghost");
  }
}

/** Colours of the maps from black to white, as the server's; between them it is linear enough for a legend. */
export const COLOURS: Readonly<Record<Colormap, readonly string[]>> = {
  grey: ["#000", "#fff"],
  inverted: ["#fff", "#000"],
  bone: ["#000", "#535374", "#a6c6c6", "#fff"],
  hot: ["#000", "#f00", "#ff0", "#fff"],
  viridis: ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"],
};

/** The bar that says which intensity has which colour. */
export class ColourBar {
  readonly element: HTMLElement;
  readonly #canvas = h("canvas", { width: 1, height: 64, class: "ramp" });
  readonly #white = h("span", {});
  readonly #black = h("span", {});
  #shown = "";

  constructor() {
    this.element = h("div", { class: "colour-bar", hidden: true }, this.#white, this.#canvas, this.#black);
  }

  show(window: Window, colormap: Colormap): void {
    // What is painted anew costs as much as the picture on a slow device.
    const wanted = `${window.center} ${window.width} ${colormap}`;
    if (wanted === this.#shown) return;
    this.#shown = wanted;
    this.element.hidden = false;
    // Both ends to the same place, about a hundredth of the width.
    const [black, white] = windowEnds(window);
    const places = Math.min(Math.max(2 - Math.round(Math.log10(white - black)), 0), 6);
    setText(this.#white, number(white, places));
    setText(this.#black, number(black, places));
    const context = this.#canvas.getContext("2d");
    if (!context) return;
    const ramp = context.createLinearGradient(0, 64, 0, 0);
    const colours = COLOURS[colormap];
    colours.forEach((colour, index) => ramp.addColorStop(index / (colours.length - 1), colour));
    context.fillStyle = ramp;
    context.fillRect(0, 0, 1, 64);
  }
}
