// What a slice's pane is given: what lies over the slice, and who hears of it.

import type { Sphere } from "../model/case.ts";
import type { Plane } from "../model/query.ts";
import type { SliceView } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { PointTool } from "./point-tool.ts";
import type { Surface } from "./surface.ts";

/** The larger side of a picture of the server. */
export const MOST_PIXELS = 768;
/** The larger side of a slice that is saved. */
export const MOST_SAVED_PIXELS = 4096;

/** Something that is drawn over a slice. */
export interface SliceLayer {
  readonly element: SVGSVGElement;
  /** `isShown`: outlines are not hidden. */
  show(view: SliceView, sphere: Sphere, isShown: boolean): void;
}

/** What a slice of the close-up shows. */
export interface SliceRole {
  /** Distinguishes it from the other slices in its plane. */
  readonly name: string;
  readonly isOpposite: boolean;
  /** Whether layers are shown, not the case alone. */
  readonly isLayer: boolean;
  /** The zoom at first. */
  readonly zoom: number;
  /** The side on which a place is. */
  words(position_in_patient: Vec3): string;
}

/** A slice across an axis, or the one across the sulcus. */
export type SliceName = Plane | "across";

export interface SliceListener {
  /** Slices have other sizes, after a double click in one or otherwise. */
  resized(isDoubleClick: boolean): void;
  /** A drag with the right button. */
  window(move: Vec2): void;
  /** A double click, or the button: as large as all panes, or not. */
  enlarge(plane: SliceName, isDoubleClick?: boolean): void;
  /** Who knows the points, and draws slices in the page. */
  surface(): Pick<Surface, "probe" | "isInHead" | "canSlice" | "slice">;
  /** Whether slices are enlarged together. */
  hasOneZoom(): boolean;
  /** A hand has enlarged the slice: the others follow. */
  zoomed(plane: SliceName, zoom: number): void;
  /** A hand has turned the slice across the sulcus. */
  turned(turn_deg: number): void;
  /** The cross is put here; `done` when the hand has left. */
  move(position_in_patient: Vec3, done: boolean): void;
  /** The wheel, a key or the slider brings another slice, and the cross with it. */
  scroll(position_in_patient: Vec3): void;
  /** What would have been marked is beside the head. */
  missed(): void;
  /** What sets points, while a reader measures. */
  tool(): PointTool | null;
  /** The intensities at a position, of all volumes that are shown, in words. */
  values(position_in_patient: Vec3): string;
  complain(problem: unknown): void;
}
