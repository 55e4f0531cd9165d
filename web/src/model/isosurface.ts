// The isosurface {depth = D} on the processor, for single points: what a line of sight meets, and the shortest way in.

import { samplerOf, type Sampler } from "./sampler.ts";
import { type Vec3, add, clamp, normalized, scale, transform } from "./space.ts";
import type { Block } from "./wire.ts";

/** Depths, in voxels, between which the smoothed field gives way to the field: `render::isosurface`. */
const SHALLOW = [3, 5] as const;

/** The share of the smoothed field in the isosurface at a depth in voxels, 0 to 1. */
export function smoothShare(depth_in_voxels: number): number {
  const share = (SHALLOW[1] - depth_in_voxels) / (SHALLOW[1] - SHALLOW[0]);
  return clamp(share, 0, 1);
}

/** The most that the trilinear depth changes in a length of 1, as in `trace.wgsl`. */
const STEEPEST = 1.75;
/** How near to the isosurface is on it, in mm of depth. */
const TOLERANCE_MM = 0.002;

/** Depth as a function of the position. */
export interface Depths {
  readonly voxel_mm: number;
  /** Signed depth at a position, in mm. */
  depthAt(position_in_patient: Vec3): number;
  /** The same of the smoothed field. */
  smoothAt(position_in_patient: Vec3): number;
  /** Whether a fence makes the depth at a position unknown; of the whole brain there is none. */
  isFenced?(position_in_patient: Vec3): boolean;
  /** The unit vector inwards, across the smoothed field; the null vector where there is none. */
  inwardAt(position_in_patient: Vec3): Vec3;
}

/** `smooth` and the fence lie on the grid of `field`; the grid lies along the patient's axes. */
export function depthsOf(field: Block, smooth: Block, fenced: Uint8Array<ArrayBuffer> | null = null): Depths {
  const [raw, soft] = [samplerOf(field), samplerOf(smooth)];
  const voxel_mm = Math.hypot(...[0, 1, 2].map((row) => field.patient_from_voxel[row]?.[0] ?? 0));
  const through = (sampler: Sampler, position: Vec3): number =>
    sampler.at(transform(sampler.voxel_from_patient, position));
  const smoothAt = (position: Vec3): number => through(soft, position);
  const fence = fenced && samplerOf({ ...field, voxels: fenced, format: "u8", scale: 1, offset: 0 });
  return {
    voxel_mm,
    ...(fence && { isFenced: (position: Vec3) => through(fence, position) >= 0.5 }),
    depthAt: (position) => through(raw, position),
    smoothAt,
    inwardAt([x, y, z]) {
      const step = voxel_mm;
      return normalized([
        smoothAt([x + step, y, z]) - smoothAt([x - step, y, z]),
        smoothAt([x, y + step, z]) - smoothAt([x, y - step, z]),
        smoothAt([x, y, z + step]) - smoothAt([x, y, z - step]),
      ]);
    },
  };
}

/** How far a position lies below the isosurface, in mm; negative above it. */
export function below(depths: Depths, position: Vec3, depth_mm: number): number {
  const smooth = smoothShare(depth_mm / depths.voxel_mm);
  const raw = smooth < 1 ? depths.depthAt(position) : 0;
  return (smooth > 0 ? raw + smooth * (depths.smoothAt(position) - raw) : raw) - depth_mm;
}

/** A straight way through the patient: `from`, then `reach_mm` along the unit vector `direction`. */
export interface Ray {
  readonly from: Vec3;
  readonly direction: Vec3;
  readonly reach_mm: number;
}

/** Where a ray first enters the isosurface; null where it does not. By safe steps (sphere tracing), then halving. */
export function firstHit(depths: Depths, { from, direction, reach_mm }: Ray, depth_mm: number): Vec3 | null {
  const at = (way: number): Vec3 => add(from, scale(direction, way));
  for (let way = 0; way <= reach_mm;) {
    const above = -below(depths, at(way), depth_mm);
    if (above <= TOLERANCE_MM) return at(way);
    // Near the surface a fixed least step passes it, so that a grazing ray ends.
    const step = Math.max(above / STEEPEST, 0.02 * depths.voxel_mm);
    if (below(depths, at(way + step), depth_mm) >= 0) return at(halved(depths, at, [way, way + step], depth_mm));
    way += step;
  }
  return null;
}

function halved(
  depths: Depths,
  at: (way: number) => Vec3,
  [high, low]: readonly [number, number],
  depth_mm: number,
): number {
  let [above, under] = [high, low];
  for (let round = 0; round < 24; round += 1) {
    const middle = (above + under) / 2;
    if (below(depths, at(middle), depth_mm) < 0) above = middle;
    else under = middle;
  }
  return (above + under) / 2;
}

/** A step of a walk along the gradient, in voxels. */
const WALK_STEP = 0.25;
/** A walk that gets less than this share of its step deeper has come to a ridge. */
const STALLED = 0.2;

/**
 * The shortest way in through a position: the points at the depths 0, `step_mm`, 2 `step_mm` … of the isosurface, up
 * to the ridge where the gradient stalls. Up and down the gradient of the smoothed depth, a quarter of a voxel at a
 * time.
 */
export function wayIn(depths: Depths, position: Vec3, step_mm: number): Vec3[] {
  const points: Vec3[] = [];
  let here = toEnvelope(depths, position);
  if (!here) return points;
  let depth = depths.depthAt(here);
  points.push(here);
  const step = WALK_STEP * depths.voxel_mm;
  let best = depth;
  let sinceBest = 0;
  for (let rounds = 0; rounds < 4096 && sinceBest < 8; rounds += 1) {
    const next: Vec3 = add(here, scale(depths.inwardAt(here), step));
    const deeper = depths.depthAt(next);
    for (let wanted = points.length * step_mm; deeper > depth && wanted <= deeper; wanted = points.length * step_mm) {
      const share = Math.max(0, (wanted - depth) / (deeper - depth));
      points.push(add(here, scale(add(next, scale(here, -1)), share)));
    }
    sinceBest = deeper > best + STALLED * step ? 0 : sinceBest + 1;
    best = Math.max(best, deeper);
    [here, depth] = [next, deeper];
  }
  return points;
}

/** Down the gradient from a position to depth 0; null where it does not get there. */
function toEnvelope(depths: Depths, position: Vec3): Vec3 | null {
  let here = position;
  for (let rounds = 0; rounds < 4096; rounds += 1) {
    const depth = depths.depthAt(here);
    if (Math.abs(depth) < 0.02 * depths.voxel_mm) return here;
    const outward = scale(depths.inwardAt(here), -1);
    if (outward.every((part) => part === 0)) return null;
    const step = Math.sign(depth) * Math.min(Math.abs(depth) * 0.7, WALK_STEP * depths.voxel_mm);
    here = add(here, scale(outward, step));
  }
  return here;
}
