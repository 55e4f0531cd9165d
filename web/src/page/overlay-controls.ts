// How a layer lies over the picture: above which value, how opaque, in which colours from which value to which.

import { h, setValue } from "../base/dom.ts";
import { number, readNumber, t } from "../base/i18n.ts";
import { type LayerOverlay, OVERLAY_COLORMAPS, THRESHOLD_RANGE, isDiverging, isMap, styleOf } from "../model/maps.ts";
import { writer } from "../panes/map-bar.ts";
import { Slider, choice, line } from "./fields.ts";

export class OverlayControls {
  readonly element: HTMLElement;
  readonly #change: (overlay: LayerOverlay) => void;
  readonly #threshold: Slider;
  readonly #opacity: Slider;
  readonly #ends: readonly [HTMLInputElement, HTMLInputElement];
  readonly #colours: HTMLSelectElement;
  readonly #colourLines: readonly HTMLElement[];
  #overlay: LayerOverlay | null = null;

  constructor(change: (overlay: LayerOverlay) => void) {
    this.#change = change;
    this.#threshold = new Slider("map-threshold", t("map.threshold"), [0, 1, 0.05], (value) => {
      // Of an added layer, the lower end is no threshold.
      const isNone = value <= Number(this.#threshold.input.min) && this.#overlay && !isMap(this.#overlay.name);
      this.#set({ threshold: isNone ? null : value });
    });
    this.#opacity = new Slider("map-opacity", t("map.opacity"), [0, 1, 0.05], (opacity) => this.#set({ opacity }));
    const end = (name: "low" | "high"): HTMLInputElement =>
      h("input", {
        type: "text",
        inputmode: "decimal",
        class: "end",
        "aria-label": t(`map.${name}`),
        change: () => {
          const [low = NaN, high = NaN] = this.#ends.map(({ value }) => readNumber(value));
          this.#set(low < high ? { window: [low, high] } : {});
        },
      });
    this.#ends = [end("low"), end("high")];
    this.#colours = choice(
      "map-colours",
      t("colormap.label"),
      OVERLAY_COLORMAPS,
      (name) => t(`colormap.${name}`),
      (colormap) => this.#set({ colormap }),
    );
    this.#colourLines = [
      line(t("map.window"), this.#ends[0], h("span", { class: "quiet" }, "–"), this.#ends[1]),
      line(t("colormap.label"), this.#colours),
    ];
    this.element = h(
      "div",
      { class: "group-part", hidden: true },
      this.#threshold.element,
      this.#opacity.element,
      ...this.#colourLines,
    );
  }

  /** Shows a layer with its style. */
  show(overlay: LayerOverlay | null): void {
    this.#overlay = overlay;
    this.element.hidden = overlay === null;
    if (!overlay) return;
    const { threshold, opacity } = overlay;
    const style = styleOf(overlay);
    const isLabels = style.colormap === "labels";
    const written = writer(style.window);
    this.#opacity.show(opacity, `${number(100 * opacity)} %`);
    for (const part of this.#colourLines) part.hidden = isLabels;
    this.#threshold.element.hidden = isLabels || (isMap(overlay.name) && threshold === null);
    this.#range(overlay);
    const words = threshold === null ? t("map.all") : `${written(threshold)} ${style.unit}`;
    this.#threshold.show(threshold ?? this.#threshold.input.min, words);
    this.#ends.forEach((end, at) => {
      // Without the language's signs between thousands, which are commas or points.
      if (document.activeElement !== end) end.value = String(Number((style.window[at] ?? 0).toPrecision(5)));
    });
    setValue(this.#colours, style.colormap);
  }

  /** The thresholds that can be chosen: of the maps a fixed range, of other layers their first window. */
  #range({ name, about }: LayerOverlay): void {
    const [low, high] = about?.window ?? THRESHOLD_RANGE;
    const range = isMap(name) ? [...THRESHOLD_RANGE, 0.1] : [Math.max(low, isDiverging(about ?? NONE) ? 0 : low), high];
    const [min = 0, max = 1, step = (max - min) / 100] = range;
    Object.assign(this.#threshold.input, { min, max, step });
  }

  #set(change: Partial<LayerOverlay>): void {
    if (this.#overlay) this.#change({ ...this.#overlay, ...change });
  }
}

const NONE = { colormap: "hot" } as const;
