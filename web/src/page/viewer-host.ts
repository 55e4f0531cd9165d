import type { Case } from "../model/case.ts";
import type { Left } from "../model/memory.ts";
import type { ViewState } from "../model/state.ts";
import type { Preferences } from "./preferences.ts";

/** What the page around the viewer does for it. */
export interface ViewerHost {
  readonly preferences: () => Preferences;
  readonly announce: (words: string) => void;
  readonly help: () => void;
  readonly choose: (change: Partial<Preferences>) => void;
  /** A version of the case was made, or was there. */
  readonly made: (one: Case, wasThere: boolean) => void;
  /** The panes are laid out like this. */
  readonly laid: (state: ViewState) => void;
  readonly serverOnly: boolean;
  /** The case as it was left. */
  readonly left: Left;
}
