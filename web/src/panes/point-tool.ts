// What clicks in the panes do while a reader measures or draws: they set points, and leave the cross where it is.

import type { Where } from "../model/measure.ts";
import type { Vec3 } from "../model/space.ts";

export interface PointTool {
  /** A point was set; where the last one is, it ends what is drawn. */
  add(position_in_patient: Vec3, where: Where): void;
  /** The pointer is here; null: nowhere. */
  hover(position_in_patient: Vec3 | null): void;
}
