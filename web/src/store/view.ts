// How a case is seen, and what was seen before: one state, which everything else follows.

import { type ReadonlySignal, type Signal, batch, computed, signal } from "@preact/signals";

import type { ReadyCase, Window } from "../model/case.ts";
import type { Change } from "../model/controls.ts";
import { t } from "../base/i18n.ts";
import { writeAddress } from "../model/fragment.ts";
import type { Plane } from "../model/space.ts";
import type { Left } from "../model/memory.ts";
import type { StateHistory } from "../model/history.ts";
import {
  type HalfLook,
  MOST_SHOWN,
  type Place,
  type ViewState,
  allLayersOf,
  clampDepth,
  lookAt,
  placeOf,
  withLook,
} from "../model/state.ts";
import { note } from "./announce.ts";

export class View {
  readonly shown: ReadyCase;
  readonly state: Signal<ViewState>;
  readonly depth_mm: ReadonlySignal<number>;
  /** The pane that a hand or the focus was in last; null: none yet. */
  readonly pane = signal<Place | null>(null);
  /** The plane of the slice that a hand was in last. */
  readonly slice = signal<Plane>("axial");
  /** Whose look controls show and change. */
  readonly place: ReadonlySignal<Place>;
  /** The state with that look. */
  readonly seen: ReadonlySignal<ViewState>;
  readonly canUndo = signal(false);
  readonly canRedo = signal(false);
  /** The window that each texture was left with, by the id of its layer; that of the case itself has none. */
  readonly windows = new Map<string, Window>();
  readonly #history: StateHistory;
  /** When the view changed last. */
  #changed_ms = 0;

  constructor(shown: ReadyCase, first: ViewState, history: StateHistory) {
    this.shown = shown;
    this.#history = history;
    this.state = signal(this.#paired(first));
    this.depth_mm = computed(() => this.state.value.depth_mm);
    this.place = computed(() => ownPlace(this.state.value, ofControls(this.pane.value)));
    this.seen = computed(() => {
      const [state, place] = [this.state.value, this.place.value];
      return place === "all" ? state : { ...state, ...lookAt(state, place) };
    });
    this.#record(first);
  }

  /** The state; who calls this does not follow it. */
  get now(): ViewState {
    return this.state.peek();
  }

  get left(): Left {
    return { state: this.now, history: this.#history };
  }

  /** A change; `step` is one that Back undoes. False, and said, if it would show too many layers. */
  change(change: Change, step = false): boolean {
    const state = { ...this.now, ...change };
    if (hasTooMany(state)) {
      note(t("strip.too-many"));
      return false;
    }
    batch(() => {
      if (step) {
        this.#record(this.now);
        this.#replaceAddress();
        history.pushState(null, "", location.hash);
      }
      this.#changed_ms = performance.now();
      this.state.value = this.#paired(state);
      if (!step) return;
      this.#record(this.now);
      this.#replaceAddress();
    });
    return true;
  }

  /** Changes what is seen in a pane, or in the one that a hand was in last: its own look, or that of all. */
  changeLook(change: Partial<HalfLook>, step = false, pane = ofControls(this.pane.peek())): void {
    const place = ownPlace(this.now, pane);
    this.change(withLook(this.now, place, { ...lookAt(this.now, place), ...change }), step);
  }

  /** Shows a whole state, which is no step of the way that is being gone. */
  take(state: ViewState): void {
    this.state.value = this.#paired(state);
  }

  goToDepth(depth_mm: number): void {
    this.change({ depth_mm: clampDepth(depth_mm, this.shown) }, true);
  }

  /** Nothing changes any more: the address says what is shown, and what was shown before can be undone. */
  rest(): void {
    this.#replaceAddress();
    this.#record(this.now);
  }

  /** When what can be undone was done; null: there is nothing. */
  get done_ms(): number | null {
    return this.#history.done_ms(this.now, this.#changed_ms);
  }

  /** Undoes the last step, or does it again; whether there was one. */
  goTo(which: "undo" | "redo"): boolean {
    const state = this.#history[which](this.now);
    if (state) this.take(state);
    this.#tellWays();
    this.#replaceAddress();
    return state !== null;
  }

  /** What is seen of a state without its layers. */
  own({ layer, window, colormap }: ViewState): HalfLook {
    const own = layer ? (this.windows.get("") ?? this.shown.intensity.window) : window;
    return { layer: null, overlay: null, window: own, colormap };
  }

  /** A close-up with layers has the case itself beside them, each with its own window. */
  #paired(state: ViewState): ViewState {
    // An address may name more.
    if (hasTooMany(state)) return this.#paired({ ...state, panes: {} });
    if (state.layout !== "closer") return state;
    const hasLayers = state.layer !== null || state.overlay !== null;
    if (hasLayers === (state.beside !== null) && !state.swipe) return state;
    return { ...state, beside: hasLayers ? (state.beside ?? this.own(state)) : null, swipe: null };
  }

  #record(state: ViewState): void {
    this.#history.record(state, this.#changed_ms);
    this.#tellWays();
  }

  #replaceAddress(): void {
    history.replaceState(null, "", writeAddress(this.now, this.shown));
  }

  #tellWays(): void {
    this.canUndo.value = this.#history.canUndo;
    this.canRedo.value = this.#history.canRedo;
  }
}

const hasTooMany = (state: ViewState): boolean => allLayersOf(state).length > MOST_SHOWN;

/** What is chosen is of the right half. */
const ofControls = (pane: Place | null): Place | null => (pane === "left" ? null : pane);

/** Where a control changes what a pane shows: without a series of its own it shows what all show. */
function ownPlace(state: ViewState, pane: Place | null): Place {
  const place = placeOf(state, pane);
  return place === "all" || place === "left" || state.panes[place] ? place : "all";
}
