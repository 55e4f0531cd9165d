// What the controls can ask for.

import type { Change, Command } from "../model/controls.ts";

export interface Actions {
  /** A change; `step` is one that Back undoes. */
  change(change: Change, step?: boolean): void;
  command(command: Command): void;
  turnToCross(): void;
  forgetCross(): void;
  depthOfCross(): void;
}
