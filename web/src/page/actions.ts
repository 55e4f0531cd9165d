// What the controls can ask for.

import type { Change, Command } from "../model/controls.ts";
import type { Vec3 } from "../model/space.ts";
import type { Layout } from "../model/state.ts";

export interface Actions {
  /** A change; `step` is one that Back undoes. */
  change(change: Change, step?: boolean): void;
  command(command: Command): void;
  /**
   * Brings a place to the viewer and marks it, in the layout that is shown or another: at its depth below the envelope, or at that
   * below the surface of the part that is shown.
   */
  bring(position: Vec3, depth_mm: number | null, layout?: Layout): void;
  turnToCross(): void;
  forgetCross(): void;
  depthOfCross(): void;
}
