// What a painter is given to draw.

import type { Vec2, Vec3 } from "../model/space.ts";
import type { Block } from "../model/wire.ts";
import type { Look, Maps } from "./uniforms.ts";

/** What is made of the depth field for the shaders. */
export interface FieldMaps {
  readonly field: Block<Int16Array<ArrayBuffer>>;
  /** On the field's grid; null where only the light is drawn with it. */
  readonly smoothed: Int16Array<ArrayBuffer> | null;
  readonly gradients: Int8Array<ArrayBuffer>;
  /** Where a fence makes the depth unknown, 1 or 0; null for the whole brain, which has none. */
  readonly fenced?: Uint8Array<ArrayBuffer> | null;
  readonly borderBox: readonly [Vec3, Vec3] | null;
}

/** A part of the picture: what it shows, and where it is, in pixels from the top left corner. */
export interface Pane {
  readonly look: Look;
  readonly left: number;
  readonly top: number;
  readonly size: Vec2;
  /** From where to where it is drawn, in shares of its width. */
  readonly clip: readonly [number, number];
}

/** A slice: how it is seen, through which position, and the depths of its contours. */
export interface SliceLook {
  readonly look: Look;
  readonly center_in_patient: Vec3;
  readonly contours_mm: readonly number[];
  /** Whether the overlay is drawn as its edges alone. */
  readonly has_edges: boolean;
}

export type Drawn = "mesh" | "exact";

/** How much a picture may cost. */
export interface Quality {
  /** Below 1, it is drawn so much smaller and then enlarged. */
  readonly share: number;
  /** Depths of the mesh along a pixel's side: with 2 its edges are soft. */
  readonly depths: 1 | 2;
}

export const FULL_QUALITY: Quality = { share: 1, depths: 2 };

/** What of the maps is the case's own. */
export type CaseMaps = Pick<Maps, "sphere" | "plane" | "native_spacing_mm" | "cuts" | "spacing_mm">;
