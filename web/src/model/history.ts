// What was shown before and after, for undo and redo: pure.

import type { ViewState } from "./state.ts";

/** So many states are remembered. */
const MOST = 200;

export class StateHistory {
  #states: ViewState[];
  #at = 0;

  constructor(first: ViewState) {
    this.#states = [first];
  }

  /** Remembers a state, unless it is the one that is remembered last; what was undone is forgotten. */
  record(state: ViewState): void {
    if (isSame(state, this.#states[this.#at])) return;
    this.#states = [...this.#states.slice(0, this.#at + 1), state].slice(-MOST);
    this.#at = this.#states.length - 1;
  }

  get canUndo(): boolean {
    return this.#at > 0;
  }

  get canRedo(): boolean {
    return this.#at + 1 < this.#states.length;
  }

  /** The state before `now`, which can then be redone; null if there is none. */
  undo(now: ViewState): ViewState | null {
    this.record(now);
    if (!this.canUndo) return null;
    this.#at -= 1;
    return this.#states[this.#at] ?? null;
  }

  /** The state that was undone last; null where there is none. */
  redo(): ViewState | null {
    if (!this.canRedo) return null;
    this.#at += 1;
    return this.#states[this.#at] ?? null;
  }
}

/** What the server says of a layer is not of the state. */
const textOf = (state: ViewState | undefined): string =>
  JSON.stringify(state, (key, value: unknown) => (key === "intensity" || key === "about" ? undefined : value));

const isSame = (a: ViewState, b: ViewState | undefined): boolean => a === b || textOf(a) === textOf(b);
