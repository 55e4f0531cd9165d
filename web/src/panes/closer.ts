// The close-up of the marked place: three slices of it beside those of the other side, flipped; with a layer, the case
// itself and the layer side by side.

import { effect } from "@preact/signals";

import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import type { ReadyCase } from "../model/case.ts";
import { reflected, sideOf } from "../model/midsagittal.ts";
import type { Marked } from "../model/marks.ts";
import { otherConvention } from "../model/slice-geometry.ts";
import { type Vec3, PLANE_NAMES, type Plane } from "../model/space.ts";
import { type ViewState, leftOf } from "../model/state.ts";
import { preferences } from "../store/preferences.ts";
import type { Store } from "../store/store.ts";
import type { Placed } from "./screenshot.ts";
import type { SliceRole } from "./slice-parts.ts";
import { SlicePane } from "./slices.ts";

/** How much of the head is seen at first, along the smaller side of a pane. */
const CLOSE_MM = 60;

interface ClosePane {
  readonly pane: SlicePane;
  readonly isLayer: boolean;
  readonly isOpposite: boolean;
}

export class Closer {
  readonly element = h("div", { class: "closer" });
  readonly #shown: ReadyCase;
  readonly #store: Store;
  #panes: readonly ClosePane[] = [];
  /** The mark and its mirror image: the same as long as the mark is the same. */
  #pair: readonly [Vec3, Vec3] | null = null;
  /** The mark, while a hand holds it on the other side: the sides change places when the hand has left. */
  #held: Vec3 | null = null;
  #isOutlined = true;
  readonly #end: () => void;
  #marked: readonly Marked[] = [];

  constructor(store: Store) {
    this.#shown = store.shown;
    this.#store = store;
    this.#end = effect(() => {
      const large = store.large.value;
      for (const { pane } of this.#panes) pane.enlarge(pane.name === large);
    });
  }

  /** Shows the place that is marked; the layers of the state beside the case itself. */
  show(state: ViewState): void {
    const hasLayer = state.beside !== null;
    if (this.#panes.length !== PLANE_NAMES.length * (hasLayer ? 4 : 2)) this.#lay(hasLayer);
    const [here, opposite] = this.#halves(state);
    for (const { pane, isLayer, isOpposite } of this.#panes) {
      const half = isOpposite ? opposite : here;
      pane.show(isLayer ? half : leftOf(half));
    }
  }

  outline(shown: boolean): void {
    this.#isOutlined = shown;
    for (const { pane } of this.#panes) pane.outline(shown);
  }

  mark(marked: readonly Marked[]): void {
    this.#marked = marked;
    for (const { pane } of this.#panes) pane.mark(marked);
  }

  /** The panes as they lie, with so many pixels to a CSS pixel. */
  async pictures(ratio: number): Promise<readonly Placed[]> {
    return (await Promise.all(this.#panes.map(({ pane }) => pane.placed(ratio)))).filter((one) => one !== null);
  }

  /** Shows all panes as they were at first. */
  center(): void {
    for (const { pane } of this.#panes) pane.center();
  }

  describe(words: string): void {
    for (const { pane } of this.#panes) pane.describe(words);
  }

  /** The panes are gone; the next ones show 60 mm again. */
  dispose(): void {
    this.#end();
    if (this.#panes.some(({ pane }) => pane.isLarge)) this.#store.large.value = null;
    for (const { pane } of this.#panes) pane.dispose();
    this.#panes = [];
    this.element.replaceChildren();
  }

  /** What is shown of the marked side, and of the other one: as if the patient were mirrored. */
  #halves(state: ViewState): readonly [ViewState, ViewState] {
    const { crosshair_mm: mark, convention } = state;
    if (!mark) return [state, { ...state, convention: otherConvention(convention) }];
    if (this.#pair?.[0] !== mark) this.#pair = [mark, reflected(mark, this.#shown.midsagittal)];
    const [here, opposite] = mark === this.#held ? [this.#pair[1], mark] : this.#pair;
    return [
      { ...state, crosshair_mm: here },
      { ...state, crosshair_mm: opposite, convention: otherConvention(convention) },
    ];
  }

  /** Lays out the panes; those of the case itself stay when a layer comes or goes. */
  #lay(hasLayer: boolean): void {
    const columns = (hasLayer ? [false, true] : [false]).flatMap((isLayer) => [
      { isLayer, isOpposite: false },
      { isLayer, isOpposite: true },
    ]);
    const before = this.#panes;
    const zoom = before[0]?.pane.zoom;
    this.#panes = PLANE_NAMES.flatMap((plane) =>
      columns.map((column) => {
        const isIt = (one: ClosePane): boolean =>
          one.pane.plane === plane && one.isLayer === column.isLayer && one.isOpposite === column.isOpposite;
        return before.find(isIt) ?? this.#made(plane, column);
      }),
    );
    for (const one of before) if (!this.#panes.includes(one)) one.pane.dispose();
    this.element.style.setProperty("--columns", String(columns.length));
    this.element.replaceChildren(...this.#panes.map(({ pane }) => pane.element));
    for (const one of this.#panes) {
      if (before.includes(one)) continue;
      one.pane.outline(this.#isOutlined);
      one.pane.mark(this.#marked);
      if (zoom !== undefined) one.pane.zoomTo(zoom);
    }
  }

  #made(plane: Plane, { isLayer, isOpposite }: Omit<ClosePane, "pane">): ClosePane {
    const store = this.#store;
    const place = isLayer ? "all" : "left";
    const role: SliceRole = {
      name: `${isOpposite ? "opposite" : "here"}${isLayer ? "-layer" : ""}`,
      isOpposite,
      isLayer,
      zoom: (2 * this.#shown.envelope_sphere.radius_mm) / CLOSE_MM,
      words: (mark) => this.#sideWords(mark, isOpposite),
      move: (position, isDone) => {
        this.#held = isOpposite && !isDone ? position : null;
        store.moveCross(position, isDone);
      },
      scroll: (position) => this.#scroll(position, isOpposite),
    };
    const pane = new SlicePane(plane, store, (_, { zoom }, isZoomed) => isZoomed && this.#zoom(zoom), {
      pane: place,
      role,
    });
    return { pane, isLayer, isOpposite };
  }

  #zoom(zoom: number): void {
    if (preferences.peek().linked_zoom) for (const { pane } of this.#panes) pane.zoomTo(zoom);
  }

  /** Which side a pane shows: of the other side it is flipped. */
  #sideWords(mark: Vec3, isOpposite: boolean): string {
    const side = sideOf(mark, this.#shown.midsagittal);
    if (side === "middle" || side === "unknown") return t(isOpposite ? "closer.flipped" : `side.${side}`);
    return t(`${isOpposite ? "flipped" : "mirror"}.${side}`);
  }

  /** The slices of both sides go together: on the other side the mark stays on its own. */
  #scroll(position: Vec3, isOpposite: boolean): void {
    if (isOpposite) this.#pair = [reflected(position, this.#shown.midsagittal), position];
    this.#store.moveCross(isOpposite && this.#pair ? this.#pair[0] : position, false);
  }
}
