// What a slice's pane is given: what lies over the slice, and who hears of it.

import type { Sphere } from "../model/case.ts";
import type { Plane } from "../model/query.ts";
import type { SliceView } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { Surface } from "./surface.ts";

/** Something that is drawn over a slice. */
export interface SliceLayer {
  readonly element: SVGSVGElement;
  /** `isShown`: outlines are not hidden. */
  show(view: SliceView, sphere: Sphere, isShown: boolean): void;
}

export interface SliceListener {
  /** A drag with the right button. */
  window(move: Vec2): void;
  /** A double click, or the button: as large as all panes, or not. */
  enlarge(plane: Plane, isDoubleClick?: boolean): void;
  /** Who knows the points, and draws slices in the page. */
  surface(): Pick<Surface, "probe" | "isInHead" | "canSlice" | "slice">;
  /** A hand has enlarged the slice: the others follow. */
  zoomed(plane: Plane, zoom: number): void;
  /** The cross is put here; `done` when the hand has left. */
  move(position_in_patient: Vec3, done: boolean): void;
  /** What would have been marked is beside the head. */
  missed(): void;
  /** The intensities at a position, of all volumes that are shown, in words. */
  values(position_in_patient: Vec3): string;
  complain(problem: unknown): void;
}
