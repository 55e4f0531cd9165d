// The pane that shows the cortex: what the page asks of whoever draws it. It holds its own canvas or picture, nothing
// else of the page; what stands on the picture (letters, scale, cursor) the page puts there.

import type { Centres } from "../model/flat-map.ts";
import type { Depths } from "../model/isosurface.ts";
import type { Picked, Points, Probed } from "../model/points.ts";
import type { Profile } from "../model/profile.ts";
import type { SliceView } from "../model/slice-geometry.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import type { ViewState, Way } from "../model/state.ts";
import type { SurfaceName } from "../model/surfaces.ts";
import type { Block } from "../model/wire.ts";

/** What is being fetched, in bytes. `total` is 0 until it is known. */
export interface LoadProgress {
  /** What for: the first picture, or all that the page draws with; then all is here, and is made ready. */
  readonly stage: "first" | "rest" | "ready";
  readonly loaded: number;
  readonly total: number;
}

/** The intensities that a file holds, in which a case is looked at without a server: with so many bits, and how far around the brain. */
export interface SharedVolume {
  readonly bits: 8 | 16;
  readonly extent: "envelope" | "whole";
}

/** Why the server draws though the page was asked to: the page says it in words. */
export type Fallback = "no-webgl2" | "context-lost" | "too-large" | "failed";

export interface SurfaceStatus {
  /** Who draws now; it differs from the state's way while that one is being fetched, or cannot be had. */
  readonly way: Exclude<Way, "auto">;
  readonly fallback: Fallback | null;
  /** A message if a picture could not be loaded; empty otherwise. */
  readonly trouble: string;
  /** Whether the page draws slices now. */
  readonly canSlice: boolean;
  /** The surface that is drawn now, or comes next. */
  readonly surface: SurfaceName;
}

export interface SurfaceOptions {
  /**
   * Hears of every picture in the same moment as it is put up, with the state that it shows: what the page writes on it
   * (letters, scale, cursor) is never of another picture. Null: none is up, until the surface of a part has come.
   */
  readonly onDrawn: (state: ViewState | null) => void;
  /** Called at first and with every change. */
  readonly onStatus: (status: SurfaceStatus) => void;
  readonly layer: (name: string) => Promise<Block>;
  /** Hears that a surface of a part cannot be shown, and why. */
  readonly noPart: (problem: unknown) => void;
  /** Only the server draws (`?renderer=server`). */
  readonly serverOnly: boolean;
  /** All that is drawn is in the file: there is no server. Null: there is one. */
  readonly shared: SharedVolume | null;
}

/**
 * In the layout `mirror` the pane is two halves of equal width: the left one shows the state's view, the right one the
 * other hemisphere's, mirrored (`camera.mirrored`, flipped left to right). Places are CSS pixels from the pane's top
 * left corner.
 */
export interface Surface {
  /** Null beside the surface, and where nothing here knows. */
  pick(state: ViewState, x: number, y: number): Picked | null;
  /** At the point of the surface nearest to the position; null where nothing here knows (yet). */
  profile(position_in_patient: Vec3): Profile | null;
  /** The surface's depth and intensity at a position; null where nothing here knows (yet). */
  probe(position_in_patient: Vec3): Probed | null;
  /** The depth as a function of the position; null where nothing here knows (yet). */
  readonly depths: Depths | null;
  /** The depth below the envelope of the whole brain, in mm, whichever surface is shown; null where nothing here knows (yet). */
  wholeDepth(position_in_patient: Vec3): number | null;
  /** What finds points of a surface; null until that is here. */
  pointsOf(surface: SurfaceName): Points | null;
  /** The greatest depth below the surface that is shown, if it is that of a part; else null. */
  readonly deepest_mm: number | null;
  /** Whether a position is within the head; true where nothing here knows (yet). */
  isInHead(position_in_patient: Vec3): boolean;
  /** Whether the page draws slices of a state now. */
  canSlice(state: ViewState): boolean;
  /** A slice with contours, drawn by the page; null if the server has to draw it, perhaps only for now. */
  slice(state: ViewState, view: SliceView, contours_mm: readonly number[]): Promise<ImageData | null>;
  /** The middles of the hemispheres; null where nothing here knows (yet). */
  readonly centres: Centres | null;
  /** Whether the page draws the flat map of a state now. */
  canMap(state: ViewState): boolean;
  /** The flat map in so many pixels, drawn by the page; null if the server has to draw it, perhaps only for now. */
  map(state: ViewState, size: Vec2): Promise<ImageData | null>;
  /** The voxels of a layer are others now. */
  forgetLayer(name: string): void;
}
