// What stands on a picture: the patient's directions, scale, depth, colours, the cursor, and what the picture is not
// for.

import type { Edges } from "../model/camera.ts";
import { h, setText, tell } from "../base/dom.ts";
import { intensity, number, t } from "../base/i18n.ts";
import { scaleBar } from "../base/readout.ts";
import { type LayerOverlay, type LayerWords, isMap } from "../model/maps.ts";
import type { Mark } from "../model/marks.ts";
import { type Vec2, clamp } from "../model/space.ts";
import { type Colormap, type HalfLook, type Swipe, type ViewState, windowEnds } from "../model/state.ts";
import { Cursor, type CursorLook } from "./cursor.ts";
import { Marks } from "./marks.ts";

export const SIDES = ["left", "right", "top", "bottom"] as const;

export class Overlay {
  readonly element: HTMLElement;
  /** What is shown, and as what: in a slice, beside its slider. */
  readonly line: HTMLElement;
  readonly #edges = SIDES.map((side) => h("span", { class: `edge ${side}` }));
  readonly #title = h("span", { class: "pane-title" });
  readonly #badge = h("span", { class: "badge", hidden: true });
  readonly #case = h("span", { class: "pane-case", hidden: true });
  readonly #scaleLine = h("span", { class: "scale-line" });
  readonly #scaleText = h("span", { class: "scale-text" });
  readonly #cursor = new Cursor();
  readonly #twin = new Cursor();
  readonly #marks = new Marks();
  #pixel_mm = 1;
  readonly #divider = h("div", {
    class: "divider",
    hidden: true,
    pointerdown: (event: PointerEvent) => {
      event.stopPropagation();
      this.#divider.setPointerCapture(event.pointerId);
    },
    pointermove: (event: PointerEvent) => {
      if (this.#divider.hasPointerCapture(event.pointerId)) this.#drag(event);
    },
  });

  constructor(host: HTMLElement) {
    this.line = h("div", { class: "pane-line" }, this.#title, this.#badge);
    this.element = h(
      "div",
      { class: "overlay" },
      // Letters stand before its lines.
      this.#marks.element,
      this.#cursor.element,
      this.#cursor.words,
      this.#twin.element,
      this.#twin.words,
      ...this.#edges,
      h("div", { class: "pane-head" }, this.line, this.#case),
      h("div", { class: "scale" }, this.#scaleText, this.#scaleLine),
      h("span", { class: "pane-notice" }, t("notice.long")),
      this.#divider,
    );
    host.append(this.element);
    const point = (event: PointerEvent | null): void => {
      const { left, top } = this.element.getBoundingClientRect();
      this.#marks.point(event && [event.clientX - left, event.clientY - top]);
    };
    host.addEventListener("pointermove", point);
    host.addEventListener("pointerleave", () => point(null));
  }

  /** Shows the line that divides a picture, at a share of its width; null: there is none. */
  divide(swipe: Swipe | null): void {
    this.#divider.hidden = !swipe;
    if (swipe) this.#divider.style.left = `${100 * swipe.share}%`;
  }

  /** The line follows the pointer: the panes hear of it by an event. */
  #drag({ clientX }: PointerEvent): void {
    const { left, width } = this.element.getBoundingClientRect();
    const detail = clamp((clientX - left) / width, 0, 1);
    this.element.dispatchEvent(new CustomEvent("swipe", { bubbles: true, detail }));
  }

  letter(edges: Edges): void {
    this.#edges.forEach((edge, index) => setText(edge, edges[SIDES[index] ?? "left"]));
  }

  title(words: string, badge = ""): void {
    setText(this.#title, words);
    tell(this.#badge, badge);
  }

  /** Names the case that is shown. */
  identity(words: string): void {
    tell(this.#case, words);
  }

  scale(mm_per_pixel: number, width: number): void {
    this.#pixel_mm = mm_per_pixel;
    const bar = scaleBar(mm_per_pixel, width / 4);
    this.#scaleLine.style.width = `${bar.pixels}px`;
    setText(this.#scaleText, `${number(bar.mm)} mm`);
  }

  /** The marked point, or the pointer: see `Cursor`. */
  cursor(place: Vec2 | null, size: Vec2, look: CursorLook): void {
    this.#cursor.show(place, size, this.#pixel_mm, look);
  }

  marks(marks: readonly Mark[], size: Vec2): void {
    this.#marks.show(marks, size, this.#pixel_mm);
  }

  /** Where the mirror image of the marked point is. */
  twin(place: Vec2 | null, size: Vec2): void {
    this.#twin.show(place, size, this.#pixel_mm, { kind: "ghost", words: t("mark.opposite") });
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

/** Colours from a height up to 0. */
export function rampOf(context: CanvasRenderingContext2D, height: number, colours: readonly string[]): CanvasGradient {
  const ramp = context.createLinearGradient(0, height, 0, 0);
  colours.forEach((colour, index) => ramp.addColorStop(index / (colours.length - 1), colour));
  return ramp;
}

/** A layer, and where its place comes from: `FLAIR, registered`. */
export const titleWords = (about: LayerWords | undefined): string =>
  about ? [about.title, about.origin].filter(Boolean).join(", ") : "";

/** The same of what lies over a picture. */
export const overlayWords = ({ name, about }: LayerOverlay): string =>
  isMap(name) ? t(`map.${name}`) : titleWords(about);

/** The name of a layer, and above which values it is seen: a slice without any looks like the case itself. */
export const thresholdWords = (overlay: LayerOverlay): string =>
  overlayWords(overlay) + (overlay.threshold === null ? "" : ` > ${intensity(overlay.threshold)}`);

/** The names of a half's layers, or that it shows the case itself. */
export const lookWords = ({ layer, overlay }: Pick<HalfLook, "layer" | "overlay">): string =>
  [layer ? layer.about?.title : t("beside.own"), overlay && (overlay.about?.title ?? overlayWords(overlay))]
    .filter(Boolean)
    .join(" + ");

/** The bar that says which intensity has which colour. */
export class ColourBar {
  readonly element: HTMLElement;
  readonly #canvas = h("canvas", { width: 1, height: 64, class: "ramp" });
  readonly #title = h("span", { class: "layer-title", hidden: true });
  readonly #white = h("span", {});
  readonly #black = h("span", {});
  #shown = "";

  constructor() {
    this.element = h("div", { class: "colour-bar", hidden: true }, this.#title, this.#white, this.#canvas, this.#black);
  }

  show({ window, colormap, layer }: Pick<ViewState, "window" | "colormap" | "layer">): void {
    // What is painted again costs as much as the picture on a slow device.
    const title = layer ? titleWords(layer.about) : "";
    const wanted = `${window.center} ${window.width} ${colormap} ${title}`;
    if (wanted === this.#shown) return;
    this.#shown = wanted;
    this.element.hidden = false;
    tell(this.#title, title);
    // Both ends to the same place, about a hundredth of the width.
    const [black, white] = windowEnds(window);
    const places = clamp(2 - Math.round(Math.log10(white - black)), 0, 6);
    setText(this.#white, number(white, places));
    setText(this.#black, number(black, places));
    const context = this.#canvas.getContext("2d");
    if (!context) return;
    context.fillStyle = rampOf(context, 64, COLOURS[colormap]);
    context.fillRect(0, 0, 1, 64);
  }
}
