// What is marked on a picture, at places of its pane.

import type { Vec2 } from "./space.ts";

/** A finding at places of a pane. */
export interface Mark {
  readonly number: number;
  readonly places: readonly Vec2[];
  readonly isClosed: boolean;
  readonly colour: string;
  /** It was marked at another depth than the one that is shown. */
  readonly isAway: boolean;
}
