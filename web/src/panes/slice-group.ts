// The three slices together: shown, enlarged and stripped of what is drawn on them. Their panes are made when they are
// first shown.

import type { ReadyCase } from "../model/case.ts";
import type { Marked } from "../model/marks.ts";
import { PLANE_NAMES, type Plane } from "../model/query.ts";
import type { ViewState } from "../model/state.ts";
import { h } from "../base/dom.ts";
import type { Placed } from "./screenshot.ts";
import type { SliceLayer, SliceListener } from "./slice-parts.ts";
import type { SlicePane } from "./slices.ts";

export interface SliceGroupListener extends Omit<SliceListener, "enlarge" | "zoomed"> {
  /** Fetches what panes are made of. */
  load(): Promise<{ readonly SlicePane: typeof SlicePane }>;
}

export class SliceGroup {
  readonly element = h("div", { class: "slices" });
  readonly #shown: ReadyCase;
  readonly #listener: SliceGroupListener;
  #panes: readonly SlicePane[] = [];
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
    for (const pane of this.#panes) pane.show(state);
    if (this.#panes.length === 0) void this.#make();
  }

  center(): void {
    for (const pane of this.#panes) pane.center();
  }

  /** Gives all slices the greatest zoom that one of them has. */
  link(): void {
    const zoom = Math.max(...this.#panes.map((pane) => pane.zoom));
    for (const pane of this.#panes) pane.zoomTo(zoom);
  }

  /** Lays something over each slice; null: nothing. */
  lay(make: (() => SliceLayer) | null): void {
    this.#layer = make;
    for (const pane of this.#panes) pane.lay(make && make());
  }

  /** Shows marks on each slice. */
  mark(marked: readonly Marked[]): void {
    this.#marked = marked;
    for (const pane of this.#panes) pane.mark(marked);
  }

  /** The slices as they lie, with so many pixels to a CSS pixel. */
  async pictures(ratio: number): Promise<readonly Placed[]> {
    return (await Promise.all(this.#panes.map((pane) => pane.placed(ratio)))).filter((one) => one !== null);
  }

  describe(words: string): void {
    this.#words = words;
    for (const pane of this.#panes) pane.describe(words);
  }

  /** Hides the outlines, or shows them; whether they are hidden now. */
  strip(): boolean {
    this.#isBare = !this.#isBare;
    for (const pane of this.#panes) pane.outline(!this.#isBare);
    return this.#isBare;
  }

  dispose(): void {
    this.#state = null;
    for (const pane of this.#panes) pane.dispose();
  }

  async #make(): Promise<void> {
    if (this.#isLoading) return;
    this.#isLoading = true;
    try {
      const { SlicePane } = await this.#listener.load();
      const state = this.#state;
      if (!state) return;
      const listener = {
        ...this.#listener,
        zoomed: (plane: Plane, zoom: number) => {
          if (!this.#listener.hasOneZoom()) return;
          for (const pane of this.#panes) if (pane.plane !== plane) pane.zoomTo(zoom);
        },
        enlarge: (plane: Plane, isDoubleClick?: boolean) => this.#enlarge(plane, isDoubleClick),
      };
      this.#panes = PLANE_NAMES.map((plane) => new SlicePane(plane, this.#shown, listener));
      this.element.append(...this.#panes.map((pane) => pane.element));
      for (const pane of this.#panes) {
        if (this.#layer) pane.lay(this.#layer());
        pane.outline(!this.#isBare);
        pane.mark(this.#marked);
        pane.show(state);
        pane.describe(this.#words);
      }
    } catch (problem) {
      this.#listener.complain(problem);
    } finally {
      this.#isLoading = false;
    }
  }

  /** Shows a slice as large as all panes, or all panes again. */
  #enlarge(plane: Plane, isDoubleClick = false): void {
    for (const pane of this.#panes) pane.enlarge(pane.plane === plane && !pane.isLarge);
    this.#listener.resized(isDoubleClick);
  }
}
