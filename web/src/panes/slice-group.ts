// The slices together: shown, enlarged and stripped of what is drawn on them. Their panes are made when they are
// first shown.

import type { ReadyCase } from "../model/case.ts";
import type { Marked } from "../model/marks.ts";
import type { AcrossPlane } from "../model/across.ts";
import { PLANE_NAMES } from "../model/query.ts";
import type { ViewState } from "../model/state.ts";
import { h } from "../base/dom.ts";
import type { Placed } from "./screenshot.ts";
import type { AcrossPane } from "./across.ts";
import type { SliceLayer, SliceListener, SliceName } from "./slice-parts.ts";
import type { SlicePane } from "./slices.ts";

export interface SliceGroupListener extends Omit<SliceListener, "enlarge" | "zoomed"> {
  /** Fetches what panes are made of. */
  load(): Promise<{ readonly SlicePane: typeof SlicePane; readonly AcrossPane: typeof AcrossPane }>;
  /** The slice across the sulcus is not wanted any more. */
  closeAcross(): void;
}

export class SliceGroup {
  readonly element = h("div", { class: "slices" });
  readonly #shown: ReadyCase;
  readonly #listener: SliceGroupListener;
  #panes: readonly SlicePane[] = [];
  /** The slice across the sulcus, while it is shown, and what makes it. */
  #across: AcrossPane | null = null;
  #makeAcross: (() => AcrossPane) | null = null;
  #isLoading = false;
  #state: ViewState | null = null;
  #layer: (() => SliceLayer) | null = null;
  #marked: readonly Marked[] = [];
  #words = "";
  #isBare = false;

  constructor(shown: ReadyCase, listener: SliceGroupListener) {
    this.#shown = shown;
    this.#listener = listener;
  }

  show(state: ViewState): void {
    this.#state = state;
    this.#meetAcross(state);
    for (const pane of this.#all) pane.show(state);
    if (this.#panes.length === 0) void this.#make();
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
    } else if (!this.#across && this.#makeAcross) {
      const pane = (this.#across = this.#makeAcross());
      this.element.append(pane.element);
      pane.outline(!this.#isBare);
      pane.mark(this.#marked);
      pane.describe(this.#words);
      // What is enlarged has a zoom of its own already.
      const zoom = this.#panes[0]?.zoom ?? 1;
      if (this.#listener.hasOneZoom() && zoom > 1) pane.zoomTo(zoom);
      // All panes have other sizes now.
      this.#listener.resized(false);
    }
  }

  center(): void {
    for (const pane of this.#all) pane.center();
  }

  /** Gives all slices the greatest zoom that one of them has. */
  link(): void {
    const zoom = Math.max(...this.#panes.map((pane) => pane.zoom));
    for (const pane of this.#all) pane.zoomTo(zoom);
  }

  /** Lays something over each slice; null: nothing. */
  lay(make: (() => SliceLayer) | null): void {
    this.#layer = make;
    for (const pane of this.#panes) pane.lay(make && make());
  }

  /** Shows marks on each slice. */
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

  /** Hides the outlines, or shows them; whether they are hidden now. */
  strip(): boolean {
    this.#isBare = !this.#isBare;
    for (const pane of this.#all) pane.outline(!this.#isBare);
    return this.#isBare;
  }

  dispose(): void {
    this.#state = null;
    for (const pane of this.#all) pane.dispose();
  }

  async #make(): Promise<void> {
    if (this.#isLoading) return;
    this.#isLoading = true;
    try {
      const { SlicePane, AcrossPane } = await this.#listener.load();
      const state = this.#state;
      if (!state) return;
      const listener = {
        ...this.#listener,
        zoomed: (plane: SliceName, zoom: number) => {
          if (!this.#listener.hasOneZoom()) return;
          for (const pane of this.#all) if (pane.plane !== plane) pane.zoomTo(zoom);
        },
        enlarge: (plane: SliceName, isDoubleClick?: boolean) => this.#enlarge(plane, isDoubleClick),
      };
      const lies = (plane: AcrossPlane | null): void => {
        for (const pane of this.#panes) pane.trace(plane);
      };
      const close = (): void => this.#listener.closeAcross();
      this.#makeAcross = () => new AcrossPane(this.#shown, { ...listener, lies, close });
      this.#panes = PLANE_NAMES.map((plane) => new SlicePane(plane, this.#shown, listener));
      this.element.append(...this.#panes.map((pane) => pane.element));
      for (const pane of this.#panes) {
        if (this.#layer) pane.lay(this.#layer());
        pane.outline(!this.#isBare);
        pane.mark(this.#marked);
        pane.show(state);
        pane.describe(this.#words);
      }
      this.show(state);
    } catch (problem) {
      this.#listener.complain(problem);
    } finally {
      this.#isLoading = false;
    }
  }

  /** Shows a slice as large as all panes, or all panes again. */
  #enlarge(plane: SliceName, isDoubleClick = false): void {
    for (const pane of this.#all) pane.enlarge(pane.plane === plane && !pane.isLarge);
    this.#listener.resized(isDoubleClick);
  }
}
