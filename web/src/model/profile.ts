// Intensity against depth, from the surface inwards along the shortest way, beside the same of the mirrored point.

import { wayIn, type Depths } from "./isosurface.ts";
import type { Side } from "./midsagittal.ts";
import type { Sampler } from "./sampler.ts";
import type { Vec3 } from "./space.ts";

/** Intensity against depth along the shortest way in from the surface. */
export interface Profile {
  /** From 0, equally spaced. */
  readonly depth_mm: readonly number[];
  /** NaN outside the volume, and where the depth is unknown. */
  readonly intensity: readonly number[];
  /** The same at the mirrored point of the other hemisphere. */
  readonly mirrored: readonly number[];
}

/** Depths and values; NaN where there is none. */
export type Curve = readonly (readonly [number, number])[];

/** What the server measures at a point, and on the way in through it. */
export interface PointMeasured {
  /** About which gyrus it is in, where the server knows. */
  readonly gyrus?: string;
  readonly lobe?: string;
  readonly side: Side;
  readonly junction_width: { readonly verdict: string; readonly mm?: number };
  readonly samples: readonly {
    readonly depth_mm: number | null;
    /** The values of the layers, in their order. */
    readonly layers?: readonly (number | null)[];
  }[];
}

/** What the server measures at a point and at its mirrored one. */
export interface Measured {
  readonly own: PointMeasured;
  readonly mirrored?: PointMeasured;
  /** Why nothing is known of the junction. */
  readonly maps_undefined?: string;
  readonly layers?: readonly { readonly name: string; readonly unit: string; readonly labels?: readonly unknown[] }[];
}

/** Distance between the samples of a profile, in mm of depth. */
export const PROFILE_STEP_MM = 0.25;

/** The intensities on the shortest way in through a position. */
const intensitiesAlong = (depths: Depths, volume: Pick<Sampler, "atPatient">, position: Vec3): number[] =>
  wayIn(depths, position, PROFILE_STEP_MM).map((point) => volume.atPatient(point));

/** The curves at a position and at its mirrored one; null where no way leads in from the position. */
export function profileAt(
  depths: Depths,
  volume: Pick<Sampler, "atPatient">,
  position: Vec3,
  opposite: Vec3,
): Profile | null {
  const [own, other] = [position, opposite].map((point) => intensitiesAlong(depths, volume, point));
  // Outside the envelope there is a single place, without a way from it.
  if (!own || own.length < 2) return null;
  return {
    depth_mm: own.map((_, index) => index * PROFILE_STEP_MM),
    intensity: own,
    mirrored: own.map((_, index) => other?.[index] ?? NaN),
  };
}

/** A layer against depth on both sides. */
export interface SidedCurves {
  readonly name: string;
  readonly own: Curve;
  readonly mirrored: Curve;
}
