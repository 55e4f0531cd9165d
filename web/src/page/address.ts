// The address follows the state: in place when the state rests, or as a step that Back undoes.

import type { ReadyCase } from "../model/case.ts";
import { writeAddress } from "../model/fragment.ts";
import type { ViewState } from "../model/state.ts";

/** How long the state rests before the address follows it and the depth is read out. */
const REST_MS = 350;

export class AddressFollower {
  readonly #shown: ReadyCase;
  readonly #state: () => ViewState;
  readonly #onRest: () => void;
  #timer = 0;

  /** `onRest` is called when nothing has changed for a while. */
  constructor(shown: ReadyCase, state: () => ViewState, onRest: () => void) {
    this.#shown = shown;
    this.#state = state;
    this.#onRest = onRest;
  }

  /** The state has changed. */
  stir(): void {
    clearTimeout(this.#timer);
    this.#timer = window.setTimeout(() => this.#onRest(), REST_MS);
  }

  push(): void {
    this.replace();
    history.pushState(null, "", location.hash);
  }

  replace(): void {
    history.replaceState(null, "", writeAddress(this.#state(), this.#shown));
  }

  stop(): void {
    clearTimeout(this.#timer);
  }
}
