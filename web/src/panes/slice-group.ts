// The three slices together: shown, enlarged and stripped of what is drawn on them.

import type { ReadyCase } from "../model/case.ts";
import { PLANE_NAMES, type Plane } from "../model/query.ts";
import type { ViewState } from "../model/state.ts";
import { h } from "../base/dom.ts";
import type { Placed } from "./screenshot.ts";
import { type SliceLayer, type SliceListener, SlicePane } from "./slices.ts";

export class SliceGroup {
  readonly element: HTMLElement;
  readonly panes: readonly SlicePane[];
  readonly #redraw: () => void;
  #isBare = false;

  /** `redraw` is called when the slices have other sizes. */
  constructor(shown: ReadyCase, listener: Omit<SliceListener, "enlarge">, redraw: () => void) {
    this.#redraw = redraw;
    const enlarge = (plane: Plane): void => this.#enlarge(plane);
    this.panes = PLANE_NAMES.map((plane) => new SlicePane(plane, shown, { ...listener, enlarge }));
    this.element = h("div", { class: "slices" }, ...this.panes.map((pane) => pane.element));
  }

  show(state: ViewState): void {
    for (const pane of this.panes) pane.show(state);
  }

  center(): void {
    for (const pane of this.panes) pane.center();
  }

  /** Lays something over each slice; null: nothing. */
  lay(make: (() => SliceLayer) | null): void {
    for (const pane of this.panes) pane.lay(make && make());
  }

  /** The slices as they lie, with so many pixels to a CSS pixel. */
  async pictures(ratio: number): Promise<readonly Placed[]> {
    return (await Promise.all(this.panes.map((pane) => pane.placed(ratio)))).filter((one) => one !== null);
  }

  describe(words: string): void {
    for (const pane of this.panes) pane.describe(words);
  }

  /** Hides outline and cross, or shows them; whether they are hidden now. */
  strip(): boolean {
    this.#isBare = !this.#isBare;
    for (const pane of this.panes) pane.outline(!this.#isBare);
    return this.#isBare;
  }

  dispose(): void {
    for (const pane of this.panes) pane.dispose();
  }

  /** Shows a slice as large as all panes, or all panes again. */
  #enlarge(plane: Plane): void {
    for (const pane of this.panes) pane.enlarge(pane.plane === plane && !pane.isLarge);
    this.#redraw();
  }
}
