// The address follows the state: in place when the state rests, or as a step that Back undoes.

import type { ReadyCase } from "../model/case.ts";
import { writeAddress } from "../model/fragment.ts";
import type { ViewState } from "../model/state.ts";

export function replaceAddress(state: ViewState, shown: ReadyCase): void {
  history.replaceState(null, "", writeAddress(state, shown));
}

export function pushAddress(state: ViewState, shown: ReadyCase): void {
  replaceAddress(state, shown);
  history.pushState(null, "", location.hash);
}
