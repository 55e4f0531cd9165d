// What was shown before and after, for undo and redo: pure.

import type { ViewState } from "./state.ts";

/** So many states are remembered. */
const MOST = 200;

export class StateHistory {
  #states: readonly { readonly state: ViewState; readonly at_ms: number }[];
  #at = 0;

  constructor(first: ViewState) {
    this.#states = [{ state: first, at_ms: 0 }];
  }

  /** Remembers a state and when it was reached, unless it is the one that is remembered last; what was undone is forgotten. */
  record(state: ViewState, at_ms = 0): void {
    if (isSame(state, this.#now)) return;
    this.#states = [...this.#states.slice(0, this.#at + 1), { state, at_ms }].slice(-MOST);
    this.#at = this.#states.length - 1;
  }

  get #now(): ViewState | undefined {
    return this.#states[this.#at]?.state;
  }

  /** When what can be undone was done, if `now` was reached at a time; null: nothing can be. */
  done_ms(now: ViewState, reached_ms: number): number | null {
    if (!isSame(now, this.#now)) return reached_ms;
    return this.canUndo ? (this.#states[this.#at]?.at_ms ?? null) : null;
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
    return this.#now ?? null;
  }

  /** The state that was undone last; null where there is none. */
  redo(): ViewState | null {
    if (!this.canRedo) return null;
    this.#at += 1;
    return this.#now ?? null;
  }
}

/** What the server says of a layer is not of the state. */
const textOf = (state: ViewState | undefined): string =>
  JSON.stringify(state, (key, value: unknown) => (key === "intensity" || key === "about" ? undefined : value));

const isSame = (a: ViewState, b: ViewState | undefined): boolean => a === b || textOf(a) === textOf(b);
