// The slices together: shown, enlarged and stripped of what is drawn on them. Their panes are made when they are
// first shown.

import { computed, effect } from "@preact/signals";

import type { Marked } from "../model/marks.ts";
import type { AcrossPlane } from "../model/across.ts";
import { PLANE_NAMES, type Plane } from "../model/space.ts";
import type { Placing } from "../model/slice-geometry.ts";
import { SLICE_SLOTS, type ViewState, stateIn } from "../model/state.ts";
import { h } from "../base/dom.ts";
import { preferences } from "../store/preferences.ts";
import type { Store } from "../store/store.ts";
import type { Placed } from "./screenshot.ts";
import { AcrossPane } from "./across.ts";
import { MaskLayer } from "./mask-layer.ts";
import { SlicePane } from "./slices.ts";

export class SliceGroup {
  readonly element = h("div", { class: "slices" });
  readonly #store: Store;
  /** All panes have other sizes now. */
  readonly #resized: () => void;
  #panes: readonly SlicePane[] = [];
  /** The plane of all panes; null: each has its own. */
  #plane: Plane | null = null;
  /** The slice across the sulcus, while it is shown. */
  #across: AcrossPane | null = null;
  #marked: readonly Marked[] = [];
  #words = "";
  #isOutlined = true;
  readonly #ends: readonly (() => void)[];

  constructor(store: Store, resized: () => void) {
    this.#store = store;
    this.#resized = resized;
    const isLinked = computed(() => preferences.value.linked_zoom);
    this.#ends = [
      effect(() => {
        const large = store.large.value;
        for (const pane of this.#all) pane.enlarge(pane.name === large);
      }),
      effect(() => {
        const mask = store.mask.value;
        for (const pane of this.#panes) pane.lay(mask && new MaskLayer(mask));
      }),
      // All slices get the greatest zoom that one of them has.
      effect(() => {
        if (isLinked.value) this.#zoom(Math.max(...this.#panes.map(({ zoom }) => zoom)));
      }),
    ];
  }

  show(state: ViewState): void {
    if (this.#panes.length === 0 || this.#plane !== state.plane) this.#make(state.plane);
    this.#meetAcross(state);
    for (const [at, slot] of SLICE_SLOTS.entries()) this.#panes[at]?.show(stateIn(state, slot));
    this.#across?.show(stateIn(state, "across"));
  }

  get #all(): readonly (SlicePane | AcrossPane)[] {
    return this.#across ? [...this.#panes, this.#across] : this.#panes;
  }

  /** The slice across the sulcus comes and goes with the mark. */
  #meetAcross({ crosshair_mm, across_deg }: ViewState): void {
    const isShown = crosshair_mm !== null && across_deg !== null;
    this.element.toggleAttribute("data-across", isShown);
    this.element.parentElement?.toggleAttribute("data-across", isShown);
    if (!isShown) {
      this.#across?.dispose();
      this.#across = null;
    } else if (!this.#across) {
      const lies = (plane: AcrossPlane | null): void => {
        for (const one of this.#panes) one.trace(plane);
      };
      const pane = (this.#across = new AcrossPane(this.#store, this.#placed, lies));
      this.element.append(pane.element);
      pane.outline(this.#isOutlined);
      pane.mark(this.#marked);
      pane.describe(this.#words);
      // What is enlarged has a zoom of its own already.
      const zoom = this.#panes[0]?.zoom ?? 1;
      if (preferences.peek().linked_zoom && zoom > 1) pane.zoomTo(zoom);
      this.#resized();
    }
  }

  center(): void {
    for (const pane of this.#all) pane.center();
  }

  mark(marked: readonly Marked[]): void {
    this.#marked = marked;
    for (const pane of this.#all) pane.mark(marked);
  }

  /** The slices as they lie, with so many pixels to a CSS pixel. */
  async pictures(ratio: number): Promise<readonly Placed[]> {
    return (await Promise.all(this.#all.map((pane) => pane.placed(ratio)))).filter((one) => one !== null);
  }

  describe(words: string): void {
    this.#words = words;
    for (const pane of this.#all) pane.describe(words);
  }

  outline(isShown: boolean): void {
    this.#isOutlined = isShown;
    for (const pane of this.#all) pane.outline(isShown);
  }

  dispose(): void {
    for (const end of this.#ends) end();
    for (const pane of this.#all) pane.dispose();
  }

  /** The panes are made when they are first shown, and when their planes are others. */
  #make(one: Plane | null): void {
    const store = this.#store;
    const before = this.#panes;
    const focused = before.findIndex(({ element }) => element === document.activeElement);
    this.#plane = one;
    this.#panes = SLICE_SLOTS.map((pane, at) => {
      const plane = one ?? PLANE_NAMES[at] ?? "axial";
      const number = one && at > 0 ? ` ${at + 1}` : "";
      return new SlicePane(plane, store, this.#placed, { pane, number });
    });
    if (one) for (const pane of this.#panes) pane.siblings = this.#panes.filter((other) => other !== pane);
    const zoom = before[0]?.zoom ?? 1;
    if (preferences.peek().linked_zoom) for (const pane of this.#panes) pane.zoomTo(zoom);
    for (const pane of before) {
      pane.dispose();
      pane.element.remove();
    }
    this.element.prepend(...this.#panes.map(({ element }) => element));
    this.#panes[focused]?.element.focus();
    const mask = store.mask.peek();
    for (const pane of this.#panes) {
      if (mask) pane.lay(new MaskLayer(mask));
      pane.outline(this.#isOutlined);
      pane.mark(this.#marked);
      pane.describe(this.#words);
    }
  }

  /** Slices in one plane lie alike; the others are enlarged alike. */
  readonly #placed = (from: string, placing: Placing, isZoomed: boolean): void => {
    if (!preferences.peek().linked_zoom) return;
    const isOfPlane = this.#plane !== null && from !== this.#across?.name;
    if (isOfPlane) for (const pane of this.#panes) if (pane.name !== from) pane.lieAs(placing);
    if (isZoomed) this.#zoom(placing.zoom, from);
  };

  #zoom(zoom: number, from = ""): void {
    for (const pane of this.#all) if (pane.name !== from) pane.zoomTo(zoom);
  }
}
