// How each case was left, as long as the page is open: pure.

import type { ReadyCase } from "./case.ts";
import { StateHistory } from "./history.ts";
import { type ViewState, boundOutlines, clampDepth, firstState } from "./state.ts";

export interface Left {
  readonly state: ViewState;
  readonly history: StateHistory;
}

export class ViewMemory {
  readonly #left = new Map<string, Left>();
  #latest: ViewState | null = null;

  keep(shown: Pick<ReadyCase, "id">, left: Left): void {
    this.#left.set(shown.id, left);
    this.#latest = left.state;
  }

  forget(id: string): void {
    this.#left.delete(id);
  }

  /** A case as it was left; one that is opened for the first time has angle, depth and layout of the one before. */
  of(shown: ReadyCase): Left {
    const left = this.#left.get(shown.id);
    if (left) return left;
    const state = this.#latest ? carriedOver(this.#latest, shown) : firstState(shown);
    return { state, history: new StateHistory(state) };
  }
}

/** The first state of a case, seen as another case was. */
function carriedOver(from: ViewState, shown: ReadyCase): ViewState {
  const { orientation, convention, way, averages_shallow } = from;
  // There is no mark yet to look at closely.
  const layout = from.layout === "closer" ? "both" : from.layout;
  return {
    ...firstState(shown),
    orientation,
    layout,
    convention,
    way,
    averages_shallow,
    outlines_mm: boundOutlines(from.outlines_mm, shown),
    depth_mm: clampDepth(from.depth_mm, shown),
  };
}
