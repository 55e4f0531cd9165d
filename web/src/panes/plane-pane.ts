// What all panes of slices have: the picture, what stands on it and below it, and what a hand on it is told.

import type { ReadyCase } from "../model/case.ts";
import { caseIdentity } from "../base/case-words.ts";
import { h, iconButton, setText } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { depthAtWords, positionWords } from "../base/readout.ts";
import type { Marked } from "../model/marks.ts";
import { CENTRED, type Lying, type Placing, laid } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { Place, ViewState } from "../model/state.ts";
import type { Store } from "../store/store.ts";
import { MapBar } from "./map-bar.ts";
import { Overlay } from "./overlay.ts";
import type { PlacedByHand } from "./slice-parts.ts";
import { isBesideAnother } from "./slice-words.ts";

interface PaneParts {
  /** Distinguishes it from all other slices that are shown. */
  readonly name: string;
  readonly classes: string;
  readonly label: string;
  readonly plane: string;
  readonly zoom: number;
  /** Whose look it shows. */
  readonly pane: Place;
  readonly range: { readonly min: number; readonly max: number; readonly step: number; readonly "aria-label": string };
  readonly buttons?: readonly HTMLElement[];
}

export abstract class PlanePane {
  readonly element: HTMLElement;
  readonly name: string;
  protected readonly shown: ReadyCase;
  protected readonly store: Store;
  protected readonly byHand: PlacedByHand;
  protected readonly pane: Place;
  protected readonly image = h("div", { class: "slice-image" });
  /** The picture and what stands on it; its name and its slider lie below. */
  protected readonly frame = h("div", { class: "slice-view" }, this.image);
  protected readonly overlay = new Overlay(this.frame);
  protected readonly mapBar = new MapBar();
  protected readonly range: HTMLInputElement;
  /** How it lies at first, and now. */
  protected readonly home: Placing;
  protected placing: Placing;
  protected state: ViewState | null = null;
  protected outlined = true;
  protected marked: readonly Marked[] = [];
  readonly #hovered = h("span", { class: "hovered", hidden: true });
  readonly #words: HTMLElement;
  #pointer: Vec2 | null = null;

  constructor(store: Store, byHand: PlacedByHand, parts: PaneParts) {
    const { name, classes, label, plane, zoom, pane, range, buttons = [] } = parts;
    this.name = name;
    this.shown = store.shown;
    this.store = store;
    this.byHand = byHand;
    this.pane = pane;
    this.home = this.placing = { ...CENTRED, zoom };
    this.range = h("input", {
      type: "range",
      class: "slice-range",
      ...range,
      input: () => this.slide(this.range.valueAsNumber),
    });
    const enlarge = iconButton("enlarge", t("slice.enlarge", { plane }), () => store.enlarge(name));
    this.#words = h("p", { id: `slice-${name}-words`, class: "visually-hidden" });
    this.element = h(
      "section",
      {
        class: `pane slice ${classes} blank`,
        role: "group",
        tabindex: 0,
        "aria-label": label,
        "aria-describedby": this.#words.id,
        "data-pane": pane,
      },
      this.frame,
      h("div", { class: "slice-bar" }, this.overlay.line, this.range, ...buttons, enlarge),
      this.#words,
    );
    this.overlay.element.append(this.mapBar.element, this.#hovered);
    if (isBesideAnother()) this.overlay.identity(caseIdentity(this.shown));
    this.frame.addEventListener("pointermove", (event) => this.#hover(event));
    this.frame.addEventListener("pointerleave", () => this.#hover(null));
  }

  abstract show(state: ViewState): void;

  /** Writes of the picture that is up. */
  protected abstract write(): void;

  protected abstract slide(value: number): void;

  /** Where the patient is at a place of the pane; null: nowhere. */
  protected abstract positionAt(place: Vec2): Vec3 | null;

  get zoom(): number {
    return this.placing.zoom;
  }

  get isLarge(): boolean {
    return this.element.classList.contains("large");
  }

  /** Whether the slice is as large as all panes; then it names the case itself. */
  enlarge(isLarge: boolean): void {
    if (isLarge === this.isLarge) return;
    this.element.classList.toggle("large", isLarge);
    // So that Escape is its own.
    if (isLarge) this.element.focus();
    this.overlay.identity(isLarge || isBesideAnother() ? caseIdentity(this.shown) : "");
  }

  mark(marked: readonly Marked[]): void {
    this.marked = marked;
    this.write();
  }

  outline(shown: boolean): void {
    this.outlined = shown;
    if (this.state) this.show(this.state);
  }

  describe(words: string): void {
    setText(this.#words, `${this.range.getAttribute("aria-valuetext") ?? ""}. ${words}`);
  }

  protected get size(): Vec2 {
    return [this.frame.clientWidth, this.frame.clientHeight];
  }

  /** The slice in the pane, of so many pixels, as the server is asked for it. */
  protected path(plane: string, query: URLSearchParams): string {
    const { zoom, pan_mm } = this.placing;
    if (!this.outlined) query.delete("depth_mm");
    if (zoom !== 1) query.set("zoom", zoom.toFixed(4));
    if (pan_mm.some((part) => part !== 0)) query.set("pan", pan_mm.map((part) => part.toFixed(2)).join(","));
    return `${this.shown.id}/slices/${plane}?${query}`;
  }

  protected put(image: HTMLElement, facts: Readonly<Record<string, string | number>>): void {
    this.image.replaceChildren(image);
    this.element.classList.remove("blank");
    Object.assign(this.element.dataset, facts);
  }

  /** Until the picture of another placing comes, the one that is up is laid as it will be. */
  protected lie(drawn: Lying, wanted: Lying): void {
    const { scale, move } = laid(drawn, wanted, this.shown.envelope_sphere);
    const [width, height] = drawn.size;
    // The picture keeps its own size and shape, about the pane's middle.
    Object.assign(this.image.style, {
      inset: "auto",
      left: `${(wanted.size[0] - width) / 2}px`,
      top: `${(wanted.size[1] - height) / 2}px`,
      width: `${width}px`,
      height: `${height}px`,
      transform: `translate(${move[0]}px, ${move[1]}px) scale(${scale})`,
    });
  }

  /** Why the picture that is wanted cannot be had; null: it is up. */
  protected complain(problem: unknown): void {
    this.element.classList.toggle("troubled", problem !== null);
    this.store.complain(problem);
  }

  /** The hand has placed the slice: the others may have the same scale. */
  protected place(placing: Placing): void {
    const isZoomed = placing.zoom !== this.placing.zoom;
    this.setPlacing(placing);
    this.byHand(this.name, placing, isZoomed);
  }

  protected setPlacing(placing: Placing): void {
    this.placing = placing;
    if (this.state) this.show(this.state);
  }

  #hover(event: PointerEvent | null): void {
    const box = this.frame.getBoundingClientRect();
    this.#pointer = event && [event.clientX - box.left, event.clientY - box.top];
    this.store.tool?.hover(this.#pointer && this.positionAt(this.#pointer));
    this.sayHovered();
  }

  /** Position, depth and intensity under the pointer, also if the slice moves below it. */
  protected sayHovered(): void {
    const position = this.#pointer && this.positionAt(this.#pointer);
    this.#hovered.hidden = !position;
    if (!position) return;
    const depth = depthAtWords(this.store.surface?.probe(position)?.depth_mm);
    const values = this.store.point.valuesAt(position);
    setText(this.#hovered, t("slice.hovered", { place: positionWords(position), depth, values }));
  }
}
